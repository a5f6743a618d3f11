#include "surface/outside.hpp"

#include <algorithm>
#include <cmath>

#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

/// At three in four points the largest empty disc has a radius of `usual` spacings at the most:
/// 0.6 in a regular mesh, 0.85 in blue noise, 1.2 in independent random samples. Beyond these
/// bounds it says more about the shape than about the sampling.
constexpr double kUsualLow = 0.6, kUsualHigh = 1.3;

/// The outside spreads into discs larger than this, in spacings, and than the usual ones. A regular
/// triangle's disc has a radius of 0.58, a square's of 0.71.
constexpr double kSpread = 0.8;

/// How many times the first decile the ninth one is. Of the distance to the last of `kCompared`
/// neighbors: 1.1 in a regular mesh, 1.2 in blue noise, 1.5 in random samples, 2 and more where
/// vertices are dense in a face and sparse on the soles of feet. Of the spacing itself: 1.1, 1.4,
/// 2.2, and as much as of that distance where it varies from place to place.
constexpr double kUneven = 1.75, kScattered = 2.0;
constexpr std::size_t kCompared = 12;

/// Of more points than this, one in so many tells what is usual.
constexpr Index kEnough = 20000, kEvery = 8;

/// What is shown to be narrower than so much of a limit is narrower also by rounding.
constexpr double kSurely = 1.0 - 1e-6;

double quantile(std::vector<float> values, double share) {
    const auto nth =
        values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
    std::ranges::nth_element(values, nth);
    return *nth;
}

}  // namespace

Outside::Outside(const SampledSurface& surface, double opening, Progress& progress)
    : positions_(surface.positions),
      normals_(surface.normals),
      nearest_(surface.nearest),
      progress_(progress),
      star_of_(to_size(positions_.rows()), -1) {
    open(opening);
    spread();
}

std::vector<Passage> Outside::passages() const {
    std::vector<Passage> result;
    for (std::size_t s = 0; s < stars_.size(); ++s)
        for (std::size_t k = 0; k < stars_[s].size; ++k) {
            if (!spoke(s, k).outside || spoke(s, before(s, k)).outside) continue;
            std::size_t end = k;
            while (spoke(s, end).outside) end = after(s, end);
            result.push_back({stars_[s].point, spoke(s, k).neighbor, spoke(s, end).neighbor});
        }
    std::ranges::stable_sort(result, {}, &Passage::point);
    return result;
}

void Outside::open(double opening) {
    const Index count = nearest_.size();
    // What is usual, some of the points tell; of the others it's enough to know that they aren't
    // wide.
    const Index step = count > kEnough ? kEvery : 1;
    const Index sampled = (count + step - 1) / step;
    std::vector<float> spacings(to_size(sampled)), reaches(to_size(sampled)),
        radii(to_size(sampled));  // of the largest discs, relative
    const auto reach = [&](Index i) {
        const auto near = nearest_[i].first(std::min(nearest_[i].size(), kCompared));
        return near.empty() ? 0.0 : (positions_.row(near.back()) - positions_.row(i)).norm();
    };
    const auto relative_radius = [](const StarBuilder& star) {
        const double spacing = star.spacing();
        return spacing > 0.0 ? star.largest_radius() / spacing : 0.0;
    };
    parallel_for(
        sampled, progress_,
        [&](Index begin, Index end) {
            StarBuilder builder(positions_, normals_);
            for (Index k = begin; k < end; ++k) {
                builder.build(k * step, nearest_[k * step]);
                spacings[to_size(k)] = static_cast<float>(builder.spacing());
                reaches[to_size(k)] = static_cast<float>(reach(k * step));
                radii[to_size(k)] = static_cast<float>(relative_radius(builder));
            }
        },
        0.0, 0.2);
    const auto varies = [](const std::vector<float>& values, double factor) {
        return quantile(values, 0.9) > factor * quantile(values, 0.1);
    };
    is_scattered_ = varies(spacings, kScattered);
    is_uneven_ = is_scattered_ && varies(reaches, kUneven);
    const double usual = std::clamp(quantile(radii, 0.75), kUsualLow, kUsualHigh);
    spread_ = std::max(kSpread, 0.95 * usual);

    std::vector<char> opens(to_size(count), 0);
    parallel_for(
        count, progress_,
        [&](Index begin, Index end) {
            StarBuilder builder(positions_, normals_);
            for (Index i = begin; i < end; ++i) {
                double radius;
                if (i % step == 0) {
                    radius = radii[to_size(i / step)];
                } else {
                    if (builder.is_surrounded(i, nearest_[i], kSurely * opening * usual)) continue;
                    builder.build(i, nearest_[i]);
                    radius = static_cast<float>(relative_radius(builder));
                }
                opens[to_size(i)] = radius > opening * usual;
            }
        },
        0.2, 0.6);
    std::vector<Index> wide;
    for (Index i = 0; i < count; ++i)
        if (opens[to_size(i)]) wide.push_back(i);
    find_reverse_neighbors(wide);
    require(wide);
    const std::size_t end = stars_.size();
    require_around(0, end);
    for (std::size_t s = 0; s < end; ++s)
        for (std::size_t k = 0; k < stars_[s].size; ++k)
            if (is_wide(s, k, opening * usual)) mark(s, k);
}

void Outside::spread() {
    while (!front_.empty()) {
        const std::vector<Gap> front = std::exchange(front_, {});
        std::vector<Index> rows;
        for (const Gap& gap : front)
            for (std::size_t k = 0; k < stars_[gap.star].size; ++k)
                rows.push_back(spoke(gap.star, k).neighbor);
        require(std::move(rows));
        for (const auto& [s, k] : front) {
            for (const std::size_t m : {before(s, k), after(s, k)})
                if (is_wide(s, m, spread_)) mark(s, m);
            // The stars of a and b see the same gap, or, where the tangent planes differ much,
            // another one beside the same edge.
            const Index i = stars_[s].point;
            const Index a = spoke(s, k).neighbor, b = spoke(s, after(s, k)).neighbor;
            const bool closed = std::isfinite(spoke(s, k).radius);
            mark_after(b, i, closed, a);
            mark_before(a, i, closed, b);
            if (closed) {
                mark_after(a, b, closed, i);
                mark_before(b, a, closed, i);
            }
        }
    }
}

bool Outside::is_wide(std::size_t s, std::size_t k, double factor) const {
    const Index a = spoke(s, k).neighbor, b = spoke(s, after(s, k)).neighbor;
    return spoke(s, k).radius > factor * std::max({stars_[s].spacing, spacing(a), spacing(b)});
}

std::optional<Outside::Gap> Outside::find_spoke(Index point, Index neighbor) const {
    if (star_of_[to_size(point)] < 0) return {};
    const std::size_t s = to_size(star_of_[to_size(point)]);
    for (std::size_t k = 0; k < stars_[s].size; ++k)
        if (spoke(s, k).neighbor == neighbor) return Gap{s, k};
    return {};
}

void Outside::mark_after(Index point, Index neighbor, bool closed, Index opposite) {
    if (const auto gap = find_spoke(point, neighbor)) {
        const auto [s, k] = *gap;
        const bool same = closed && spoke(s, after(s, k)).neighbor == opposite;
        if (same || is_wide(s, k, spread_)) mark(s, k);
    }
}

void Outside::mark_before(Index point, Index neighbor, bool closed, Index opposite) {
    if (const auto gap = find_spoke(point, neighbor)) {
        const std::size_t s = gap->star, k = before(s, gap->spoke);
        const bool same = closed && spoke(s, k).neighbor == opposite;
        if (same || is_wide(s, k, spread_)) mark(s, k);
    }
}

void Outside::find_reverse_neighbors(const std::vector<Index>& rows) {
    std::vector<char> wanted(star_of_.size(), 0);
    for (const Index i : rows) wanted[to_size(i)] = 1;
    for (Index i = 0; i < nearest_.size(); ++i)
        for (const Index j : nearest_[i])
            if (wanted[to_size(j)]) reverse_.emplace_back(j, i);
    std::ranges::sort(reverse_);
}

void Outside::require_around(std::size_t first, std::size_t last) {
    std::vector<Index> rows;
    for (std::size_t s = first; s < last; ++s)
        for (std::size_t k = 0; k < stars_[s].size; ++k) rows.push_back(spoke(s, k).neighbor);
    require(std::move(rows));
}

void Outside::require(std::vector<Index> rows) {
    std::erase_if(rows, [&](Index i) { return star_of_[to_size(i)] >= 0; });
    std::ranges::sort(rows);
    rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
    std::vector<std::pair<double, std::vector<Spoke>>> built(rows.size());
    parallel_for(
        to_index(rows.size()), progress_,
        [&](Index begin, Index end) {
            StarBuilder builder(positions_, normals_);
            std::vector<std::pair<double, Index>> sorted;
            std::vector<Index> around;
            for (Index m = begin; m < end; ++m) {
                const Index i = rows[to_size(m)];
                if (has_lower_twin(i)) continue;
                if (!builder.build(i, nearest_[i])) {
                    farther_neighbors(i, builder.squared_reach(), sorted, around);
                    builder.extend(around);
                }
                const auto spokes = builder.spokes();
                built[to_size(m)] = {builder.spacing(), {spokes.begin(), spokes.end()}};
            }
        },
        0.6, 0.9, 64);
    for (std::size_t m = 0; m < rows.size(); ++m) {
        const auto& [spacing, spokes] = built[m];
        star_of_[to_size(rows[m])] = to_index(stars_.size());
        stars_.push_back({rows[m], spacing, spokes_.size(), spokes.size()});
        spokes_.insert(spokes_.end(), spokes.begin(), spokes.end());
    }
}

bool Outside::has_lower_twin(Index i) const {
    for (const Index j : nearest_[i]) {
        if (positions_.row(j) != positions_.row(i)) return false;
        if (j < i) return true;
    }
    return false;
}

void Outside::farther_neighbors(Index i, double squared_limit,
                                std::vector<std::pair<double, Index>>& sorted,
                                std::vector<Index>& rows) const {
    const auto squared_distance = [&](Index j) {
        return (positions_.row(j) - positions_.row(i)).squaredNorm();
    };
    sorted.clear();
    const double known = squared_distance(nearest_[i].back());
    const auto add = [&](Index j) {
        const double squared = squared_distance(j);
        if (squared >= known && squared < squared_limit) sorted.emplace_back(squared, j);
    };
    for (const Index j : nearest_[i])
        for (const Index k : nearest_[j]) add(k);
    for (auto r = std::ranges::lower_bound(reverse_, std::pair(i, Index{0}));
         r != reverse_.end() && r->first == i; ++r)
        add(r->second);
    std::ranges::sort(sorted);
    rows.clear();
    for (const auto& [squared, j] : sorted)
        if (rows.empty() || rows.back() != j) rows.push_back(j);
}

}  // namespace pointmorph

#include "pointmorph/surface/boundary.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <queue>
#include <unordered_map>
#include <utility>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Neighbors whose normals' product is below this lie on the other side of a thin sheet.
constexpr double kOpposed = -0.2;

/// At three in four points the largest empty disc has a radius of `usual` spacings at the most:
/// 0.6 in a regular mesh, 0.85 in blue noise, 1.2 in independent random samples. Beyond these
/// bounds it says more about the shape than about the sampling.
constexpr double kUsualLow = 0.6, kUsualHigh = 1.3;

/// The outside spreads into discs larger than this, in spacings, and than the usual ones. A regular
/// triangle's disc has a radius of 0.58, a square's of 0.71.
constexpr double kSpread = 0.8;

/// Where the ninth decile of the spacing is this many times the first, it varies so much that flat
/// gaps are taken for surface: 1.1 in a regular mesh, 1.4 in blue noise, 2.2 in random samples.
constexpr double kUneven = 2.0;

/// Mean product of a loop's normals and the normal of the disc that would close it, from which on
/// that disc continues the surface.
constexpr double kFlat = 0.65;

/// Area over length of a loop, in spacings, below which it runs along a crease and back: normals
/// on both sides differ too much for the stars to reach across. A round hole of radius r has r / 2.
constexpr double kThin = 0.6;

/// The share of a loop's points at a fold from which on the surface goes on behind it.
constexpr double kFold = 0.25;

/// The share of a loop's length that may have been bridged where stars disagree.
constexpr double kBridged = 0.12;

/// How far a bridge may lead, in lengths of the spokes where the chain ends.
constexpr double kBridgeReach = 5.0;

/// A neighbor in a Delaunay star, and the gap between it and the next one anticlockwise.
struct Spoke {
    Index neighbor;
    double radius;  ///< of the empty disc that touches point and both; infinite if there is none
    bool outside = false;
};

double quantile(std::vector<float> values, double share) {
    const auto nth =
        values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
    std::ranges::nth_element(values, nth);
    return *nth;
}

/// Delaunay stars of single points in their tangent planes. Holds scratch memory: one a thread.
class StarBuilder {
public:
    StarBuilder(const Positions& positions, const Normals& normals)
        : positions_(positions), normals_(normals) {}

    /// The star of point i among `rows`, which are ascending by distance. Returns true if no point
    /// farther away than all of them can change it.
    ///
    /// The Voronoi cell of i is cut out of a square by one bisector after the other. Its corners
    /// are the centers of the empty discs, and a neighbor more than twice as far as the farthest
    /// corner can't cut it.
    bool build(Index i, std::span<const Index> rows) {
        cell_.clear();
        point_ = positions_.row(i);
        normal_ = normals_.row(i);
        const double farthest =
            rows.empty() ? 0.0 : (positions_.row(rows.back()).transpose() - point_).norm();
        if (farthest == 0.0) return true;
        const double side = 16.0 * farthest;
        cell_ = {{-side, -side, -1}, {side, -side, -1}, {side, side, -1}, {-side, side, -1}};
        reach_ = 8.0 * side * side;

        // An orthonormal frame around the normal without a special case (Duff et al. 2017).
        const Vector3& n = normal_;
        const double sign = std::copysign(1.0, n[2]);
        const double a = -1.0 / (sign + n[2]), b = n[0] * n[1] * a;
        u_ = {1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]};
        v_ = {b, sign + n[1] * n[1] * a, -n[1]};
        return extend(rows);
    }

    /// Adds points farther away, again ascending by distance.
    bool extend(std::span<const Index> rows) {
        for (const Index j : rows) {
            const Vector3 d = positions_.row(j).transpose() - point_;
            const double squared = d.squaredNorm();
            if (squared >= reach_) return true;
            if (squared == 0.0 || normals_.row(j).dot(normal_) < kOpposed) continue;
            // The direction as seen in the tangent plane, the distance as in space: the surface,
            // unrolled. A point right above or below has no direction.
            const double x = d.dot(u_), y = d.dot(v_);
            const double flat = x * x + y * y;
            if (flat < 0.04 * squared) continue;
            const double stretch = std::sqrt(squared / flat);
            cut(x * stretch, y * stretch, squared, j);
        }
        return false;
    }

    /// The squared distance from which on no neighbor changes the star.
    double squared_reach() const { return reach_; }

    /// Anticlockwise seen from outside; valid until the next star is built.
    std::span<const Spoke> spokes() {
        spokes_.clear();
        for (std::size_t k = 0; k < cell_.size(); ++k) {
            const Corner& end = cell_[k + 1 < cell_.size() ? k + 1 : 0];
            if (cell_[k].row < 0) continue;
            const double radius =
                end.row < 0 ? kInfinity : std::sqrt(end.x * end.x + end.y * end.y);
            spokes_.push_back({cell_[k].row, radius});
        }
        return spokes_;
    }

    /// Length of the third shortest spoke (the longest of fewer; 0 without any): the spacing
    /// around the point, also where points stand in rows, or spokes reach across a hole.
    double spacing() const {
        std::array<double, 3> shortest = {kInfinity, kInfinity, kInfinity};
        for (const Corner& corner : cell_) {
            double squared = corner.squared;
            if (corner.row < 0) continue;
            for (double& s : shortest)
                if (squared < s) std::swap(squared, s);
        }
        for (std::size_t k = 3; k-- > 0;)
            if (shortest[k] < kInfinity) return std::sqrt(shortest[k]);
        return 0.0;
    }

    /// Radius of the largest empty disc that touches the point; infinite on the cloud's hull.
    double largest_radius() const {
        for (const Corner& corner : cell_)
            if (corner.row < 0) return kInfinity;
        return std::sqrt(0.25 * reach_);
    }

private:
    struct Corner {
        double x, y;
        Index row;  ///< whose bisector leads from this corner to the next; −1 for the square
        double squared = 0.0;  ///< distance of that row
    };

    void cut(double x, double y, double squared, Index row) {
        const auto beyond = [&](const Corner& c) { return c.x * x + c.y * y - 0.5 * squared; };
        // Points that coincide, or lie on one circle up to rounding, share a corner.
        const double tolerance = 1e-12 * squared;
        cut_.clear();
        double here = beyond(cell_.front());
        bool changed = false;
        for (std::size_t k = 0; k < cell_.size(); ++k) {
            const Corner& c = cell_[k];
            const Corner& next = cell_[k + 1 < cell_.size() ? k + 1 : 0];
            const double there = beyond(next);
            const bool here_stays = here <= tolerance, there_stays = there <= tolerance;
            if (here_stays) cut_.push_back(c);
            if (here_stays != there_stays) {
                const double t = here / (here - there);
                Corner corner = here_stays ? Corner{0.0, 0.0, row, squared} : c;
                corner.x = c.x + t * (next.x - c.x);
                corner.y = c.y + t * (next.y - c.y);
                cut_.push_back(corner);
                changed = true;
            }
            here = there;
        }
        if (!changed) return;
        cell_.swap(cut_);
        double farthest = 0.0;
        for (const Corner& c : cell_) farthest = std::max(farthest, c.x * c.x + c.y * c.y);
        reach_ = 4.0 * farthest;
    }

    const Positions& positions_;
    const Normals& normals_;
    std::vector<Corner> cell_, cut_;
    std::vector<Spoke> spokes_;
    Vector3 point_, normal_, u_, v_;
    double reach_ = 0.0;
};

/// A way past a point with the outside on the right: from `before` to `point` to `after`.
struct Passage {
    Index point, before, after;
};

/// The outside of a cloud: stars of the points at it, and which of their gaps belong to it.
class Outside {
public:
    Outside(const Positions& positions, const Normals& normals, const Neighborhoods& nearest,
            double opening, Progress& progress)
        : positions_(positions),
          normals_(normals),
          nearest_(nearest),
          progress_(progress),
          star_of_(to_size(positions.rows()), -1) {
        open(opening);
        spread();
    }

    /// See kUneven.
    bool is_uneven() const { return is_uneven_; }

    /// Spacing around a point that has a star, else 0.
    double spacing(Index i) const {
        return star_of_[to_size(i)] < 0 ? 0.0 : stars_[to_size(star_of_[to_size(i)])].spacing;
    }

    /// The star of a point, if it was needed.
    std::span<const Spoke> star(Index i) const {
        if (star_of_[to_size(i)] < 0) return {};
        const Star& star = stars_[to_size(star_of_[to_size(i)])];
        return {spokes_.data() + star.first, star.size};
    }

    /// One for each run of neighboring gaps outside, sorted by point.
    std::vector<Passage> passages() const {
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

private:
    struct Star {
        Index point;
        double spacing;
        std::size_t first, size;  ///< in `spokes_`
    };
    struct Gap {
        std::size_t star, spoke;
    };

    const Spoke& spoke(std::size_t s, std::size_t k) const { return spokes_[stars_[s].first + k]; }
    std::size_t after(std::size_t s, std::size_t k) const {
        return k + 1 < stars_[s].size ? k + 1 : 0;
    }
    std::size_t before(std::size_t s, std::size_t k) const {
        return (k > 0 ? k : stars_[s].size) - 1;
    }

    /// Marks the gaps that lie outside by their size alone.
    void open(double opening) {
        const Index count = nearest_.size();
        std::vector<float> spacings(to_size(count)),
            radii(to_size(count));  // of the largest discs, relative
        parallel_for(
            count, progress_,
            [&](Index begin, Index end) {
                StarBuilder builder(positions_, normals_);
                for (Index i = begin; i < end; ++i) {
                    builder.build(i, nearest_[i]);
                    const double spacing = builder.spacing();
                    spacings[to_size(i)] = static_cast<float>(spacing);
                    radii[to_size(i)] = static_cast<float>(
                        spacing > 0.0 ? builder.largest_radius() / spacing : 0.0);
                }
            },
            0.0, 0.6);
        is_uneven_ = quantile(spacings, 0.9) > kUneven * quantile(spacings, 0.1);
        const double usual = std::clamp(quantile(radii, 0.75), kUsualLow, kUsualHigh);
        spread_ = std::max(kSpread, 0.95 * usual);

        std::vector<Index> wide;
        for (Index i = 0; i < count; ++i)
            if (radii[to_size(i)] > opening * usual) wide.push_back(i);
        find_reverse_neighbors(wide);
        require(wide);
        const std::size_t end = stars_.size();
        require_around(0, end);
        for (std::size_t s = 0; s < end; ++s)
            for (std::size_t k = 0; k < stars_[s].size; ++k)
                if (is_wide(s, k, opening * usual)) mark(s, k);
    }

    /// From gap to gap across shared edges. Stars are made as they are needed.
    void spread() {
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

    bool is_wide(std::size_t s, std::size_t k, double factor) const {
        const Index a = spoke(s, k).neighbor, b = spoke(s, after(s, k)).neighbor;
        return spoke(s, k).radius > factor * std::max({stars_[s].spacing, spacing(a), spacing(b)});
    }

    void mark(std::size_t s, std::size_t k) {
        Spoke& gap = spokes_[stars_[s].first + k];
        if (!std::exchange(gap.outside, true)) front_.push_back({s, k});
    }

    std::optional<Gap> find_spoke(Index point, Index neighbor) const {
        if (star_of_[to_size(point)] < 0) return {};
        const std::size_t s = to_size(star_of_[to_size(point)]);
        for (std::size_t k = 0; k < stars_[s].size; ++k)
            if (spoke(s, k).neighbor == neighbor) return Gap{s, k};
        return {};
    }

    /// The gap in the star of `point` that follows the spoke to `neighbor`.
    void mark_after(Index point, Index neighbor, bool closed, Index opposite) {
        if (const auto gap = find_spoke(point, neighbor)) {
            const auto [s, k] = *gap;
            const bool same = closed && spoke(s, after(s, k)).neighbor == opposite;
            if (same || is_wide(s, k, spread_)) mark(s, k);
        }
    }

    /// The gap that precedes it.
    void mark_before(Index point, Index neighbor, bool closed, Index opposite) {
        if (const auto gap = find_spoke(point, neighbor)) {
            const std::size_t s = gap->star, k = before(s, gap->spoke);
            const bool same = closed && spoke(s, k).neighbor == opposite;
            if (same || is_wide(s, k, spread_)) mark(s, k);
        }
    }

    /// Where the spacing jumps, a point's neighbors across the jump are not among its nearest,
    /// but it is among theirs.
    void find_reverse_neighbors(const std::vector<Index>& rows) {
        std::vector<char> wanted(star_of_.size(), 0);
        for (const Index i : rows) wanted[to_size(i)] = 1;
        for (Index i = 0; i < nearest_.size(); ++i)
            for (const Index j : nearest_[i])
                if (wanted[to_size(j)]) reverse_.emplace_back(j, i);
        std::ranges::sort(reverse_);
    }

    void require_around(std::size_t first, std::size_t last) {
        std::vector<Index> rows;
        for (std::size_t s = first; s < last; ++s)
            for (std::size_t k = 0; k < stars_[s].size; ++k) rows.push_back(spoke(s, k).neighbor);
        require(std::move(rows));
    }

    /// Makes the stars of those points that have none yet.
    void require(std::vector<Index> rows) {
        std::erase_if(rows, [&](Index i) { return star_of_[to_size(i)] >= 0; });
        std::ranges::sort(rows);
        rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
        std::vector<std::pair<double, std::vector<Spoke>>> built(rows.size());
        parallel_for(
            static_cast<Index>(rows.size()), progress_,
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
            star_of_[to_size(rows[m])] = static_cast<Index>(stars_.size());
            stars_.push_back({rows[m], spacing, spokes_.size(), spokes.size()});
            spokes_.insert(spokes_.end(), spokes.begin(), spokes.end());
        }
    }

    /// Whether the point coincides with one of a lower row, which stands for both.
    bool has_lower_twin(Index i) const {
        for (const Index j : nearest_[i]) {
            if (positions_.row(j) != positions_.row(i)) return false;
            if (j < i) return true;
        }
        return false;
    }

    /// Neighbors' neighbors and reverse neighbors that are farther away than the nearest, but
    /// closer than a given distance, ascending.
    void farther_neighbors(Index i, double squared_limit,
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

    const Positions& positions_;
    const Normals& normals_;
    const Neighborhoods& nearest_;
    Progress& progress_;
    bool is_uneven_ = false;
    double spread_ = 0.0;
    std::vector<Index> star_of_;  ///< #points, −1 where there is none
    std::vector<Star> stars_;
    std::vector<Spoke> spokes_;
    std::vector<Gap> front_;  ///< marked, not spread yet
    std::vector<std::pair<Index, Index>> reverse_;
};

/// Which passage follows which, and what lies between where the stars of their points disagree.
struct Links {
    std::vector<Index> next;              ///< #passages, −1 at an end
    std::vector<std::vector<Index>> via;  ///< points between a passage and the next
};

/// A short way over the cloud from one end of a chain of passages to the start of another.
struct Bridge {
    double cost;
    Index from, to;  ///< passages
    std::vector<Index> via;
};

/// The cheapest way from the end of passage `from` to the start of a chain close by, if there is
/// one. The cost of a way is its sum of squared lengths, so that it takes small steps.
std::optional<Bridge> find_bridge(const Positions& positions, const Normals& normals,
                                  const Outside& outside, const Neighborhoods& nearest,
                                  std::span<const Passage> passages, std::span<const char> is_start,
                                  Index from) {
    using Entry = std::pair<double, Index>;
    struct Reached {
        double cost;
        Index before;
    };
    const auto squared_distance = [&](Index i, Index j) {
        return (positions.row(i) - positions.row(j)).squaredNorm();
    };
    const Passage& end = passages[to_size(from)];
    const double limit =
        kBridgeReach * kBridgeReach *
        std::max(squared_distance(end.point, end.before), squared_distance(end.point, end.after));
    std::unordered_map<Index, Reached> reached{{end.point, {0.0, -1}}};
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
    queue.emplace(0.0, end.point);
    while (!queue.empty()) {
        const auto [cost, i] = queue.top();
        queue.pop();
        if (cost > reached[i].cost) continue;
        const auto range = std::ranges::equal_range(passages, i, {}, &Passage::point);
        for (auto p = range.begin(); p != range.end(); ++p) {
            const auto to = static_cast<Index>(p - passages.begin());
            if (!is_start[to_size(to)]) continue;
            Bridge bridge{cost, from, to, {}};
            for (Index k = reached[i].before; k >= 0 && k != end.point; k = reached[k].before)
                bridge.via.push_back(k);
            std::ranges::reverse(bridge.via);
            return bridge;
        }
        const auto step = [&](Index j) {
            if (normals.row(j).dot(normals.row(i)) < kOpposed ||
                squared_distance(end.point, j) > limit)
                return;
            const double there = cost + squared_distance(i, j);
            const auto [known, is_new] = reached.try_emplace(j, Reached{there, i});
            if (!is_new && known->second.cost <= there) return;
            known->second = {there, i};
            queue.emplace(there, j);
        };
        for (const Index j : nearest[i]) step(j);
        for (const Spoke& spoke : outside.star(i)) step(spoke.neighbor);
    }
    return {};
}

Links link(const Positions& positions, const Normals& normals, const Neighborhoods& nearest,
           const Outside& outside, std::span<const Passage> passages, Progress& progress) {
    Links links{std::vector<Index>(passages.size(), -1),
                std::vector<std::vector<Index>>(passages.size())};
    std::vector<char> is_start(passages.size(), 1);
    for (std::size_t m = 0; m < passages.size(); ++m) {
        const auto range =
            std::ranges::equal_range(passages, passages[m].after, {}, &Passage::point);
        const auto next = std::ranges::find(range, passages[m].point, &Passage::before);
        if (next == range.end()) continue;
        links.next[m] = static_cast<Index>(next - passages.begin());
        is_start[to_size(links.next[m])] = 0;
    }

    // Two ends may want the same start: the shorter bridge is built, and the other end tries again.
    for (bool built = true; built;) {
        std::vector<Bridge> bridges;
        for (std::size_t m = 0; m < passages.size(); ++m) {
            if (links.next[m] >= 0) continue;
            progress.report(0.9 +
                            0.1 * static_cast<double>(m) / static_cast<double>(passages.size()));
            if (auto bridge = find_bridge(positions, normals, outside, nearest, passages, is_start,
                                          static_cast<Index>(m)))
                bridges.push_back(std::move(*bridge));
        }
        built = !bridges.empty();
        std::ranges::stable_sort(bridges, {}, &Bridge::cost);
        for (Bridge& bridge : bridges) {
            if (!is_start[to_size(bridge.to)]) continue;
            links.next[to_size(bridge.from)] = bridge.to;
            links.via[to_size(bridge.from)] = std::move(bridge.via);
            is_start[to_size(bridge.to)] = 0;
        }
    }
    return links;
}

/// Cuts a closed walk into closed walks that pass each point once.
std::vector<BoundaryLoop> simple_loops(std::span<const Index> walk) {
    std::vector<BoundaryLoop> loops;
    std::unordered_map<Index, std::size_t> place;
    BoundaryLoop path;
    for (const Index i : walk) {
        if (const auto known = place.find(i); known != place.end()) {
            const auto first = path.begin() + static_cast<std::ptrdiff_t>(known->second);
            loops.emplace_back(first, path.end());
            for (auto k = first; k != path.end(); ++k) place.erase(*k);
            path.erase(first, path.end());
        }
        place.emplace(i, path.size());
        path.push_back(i);
    }
    loops.push_back(std::move(path));
    return loops;
}

/// The closed walks along chains that close, each with no more bridges than may be.
std::vector<BoundaryLoop> close_chains(const Positions& positions,
                                       std::span<const Passage> passages, const Links& links) {
    const auto distance = [&](Index i, Index j) {
        return (positions.row(i) - positions.row(j)).norm();
    };
    std::vector<BoundaryLoop> loops;
    std::vector<char> seen(passages.size(), 0);
    for (std::size_t first = 0; first < passages.size(); ++first) {
        BoundaryLoop walk;
        double length = 0.0, bridged = 0.0;
        std::size_t m = first;
        while (!seen[m]) {
            seen[m] = 1;
            if (links.next[m] < 0) break;
            walk.push_back(passages[m].point);
            walk.insert(walk.end(), links.via[m].begin(), links.via[m].end());
            const std::size_t next = to_size(links.next[m]);
            const double step = distance(passages[m].point, passages[next].point);
            length += step;
            if (passages[m].after != passages[next].point ||
                passages[next].before != passages[m].point)
                bridged += step;
            m = next;
        }
        // Every passage has one before it at most: only what comes back to its first is closed.
        if (walk.empty() || m != first || bridged > kBridged * length) continue;
        std::ranges::move(simple_loops(walk), std::back_inserter(loops));
    }
    return loops;
}

/// The vector area that a loop spans.
Vector3 vector_area(const Positions& positions, std::span<const Index> loop) {
    const Vector3 origin = positions.row(loop.front());
    Vector3 twice = Vector3::Zero();
    for (std::size_t k = 1; k + 1 < loop.size(); ++k) {
        const Vector3 a = positions.row(loop[k]).transpose() - origin;
        const Vector3 b = positions.row(loop[k + 1]).transpose() - origin;
        twice += a.cross(b);
    }
    return 0.5 * twice;
}

/// Whether the surface goes on behind a loop, with opposed normals: round a sharp rim, where the
/// neighbors on the other side take the loop for outside as well, or flat, where normals were
/// estimated with the wrong sign.
bool is_fold(const Positions& positions, const Normals& normals, const Neighborhoods& nearest,
             std::span<const Passage> passages, const BoundaryLoop& loop) {
    std::size_t count = 0;
    for (std::size_t k = 0; k < loop.size(); ++k) {
        const Index i = loop[k];
        const Vector3 along = positions.row(loop[k + 1 < loop.size() ? k + 1 : 0]) -
                              positions.row(loop[k > 0 ? k - 1 : loop.size() - 1]);
        const Vector3 normal = normals.row(i), right = along.cross(normal).normalized();
        const auto near = nearest[i].first(std::min<std::size_t>(nearest[i].size(), 8));
        const auto is_opposed = [&](Index j) { return normals.row(j).dot(normal) < kOpposed; };
        const auto is_beyond = [&](Index j) {
            const Vector3 d = positions.row(j) - positions.row(i);
            return d.dot(right) > 0.5 * d.norm() && std::abs(d.dot(normal)) < 0.3 * d.norm();
        };
        const auto is_passed = [&](Index j) {
            return std::ranges::binary_search(passages, j, {}, &Passage::point);
        };
        count +=
            std::ranges::any_of(near, [&](Index j) { return is_opposed(j) && is_beyond(j); }) ||
            std::ranges::any_of(nearest[i], [&](Index j) { return is_opposed(j) && is_passed(j); });
    }
    return static_cast<double>(count) > kFold * static_cast<double>(loop.size());
}

/// Whether a loop bounds the surface, and not just a gap in its sampling.
bool is_boundary(const Positions& positions, const Normals& normals, const Neighborhoods& nearest,
                 const Outside& outside, std::span<const Passage> passages,
                 const BoundaryLoop& loop, double min_loop) {
    if (loop.size() < 3) return false;
    double length = 0.0, relative_length = 0.0;  // the latter in local spacings
    for (std::size_t k = 0; k < loop.size(); ++k) {
        const Index i = loop[k], j = loop[k + 1 < loop.size() ? k + 1 : 0];
        const double step = (positions.row(i) - positions.row(j)).norm();
        const double spacing = std::max(outside.spacing(i), outside.spacing(j));
        length += step;
        if (spacing > 0.0) relative_length += step / spacing;
    }
    if (relative_length < min_loop) return false;

    const Vector3 area = vector_area(positions, loop);
    const double spacing = length / relative_length;
    if (area.norm() < kThin * spacing * length) return false;
    if (is_fold(positions, normals, nearest, passages, loop)) return false;
    if (!outside.is_uneven()) return true;
    // A hole is walked round clockwise: its area points inwards.
    double along = 0.0;
    for (const Index i : loop) along -= normals.row(i).dot(area);
    return along <= kFlat * area.norm() * static_cast<double>(loop.size());
}

}  // namespace

std::vector<BoundaryLoop> find_boundary_loops(const Positions& positions, const Normals& normals,
                                              const Neighborhoods& nearest,
                                              const BoundaryOptions& options, Progress& progress) {
    if (positions.rows() < 3) return {};
    const Outside outside(positions, normals, nearest, options.opening, progress);
    const std::vector<Passage> passages = outside.passages();
    const Links links = link(positions, normals, nearest, outside, passages, progress);
    std::vector<BoundaryLoop> loops = close_chains(positions, passages, links);
    std::erase_if(loops, [&](const BoundaryLoop& loop) {
        return !is_boundary(positions, normals, nearest, outside, passages, loop, options.min_loop);
    });
    for (BoundaryLoop& loop : loops) std::ranges::rotate(loop, std::ranges::min_element(loop));
    std::ranges::sort(loops, [&](const BoundaryLoop& a, const BoundaryLoop& b) {
        const double la = loop_length(positions, a), lb = loop_length(positions, b);
        return la != lb ? la > lb : a.front() < b.front();
    });
    return loops;
}

BoundaryLoop oriented_loop(const Positions& positions, const Normals& normals,
                           const Neighborhoods& nearest, BoundaryLoop loop,
                           const std::string& name) {
    const std::string subject = "boundary of " + name;
    if (loop.size() < 3)
        throw FeatureError(subject, "at least three points", std::to_string(loop.size()),
                           "Give the whole loop, point by point.");
    std::vector<char> taken(to_size(static_cast<Index>(positions.rows())), 0);
    for (const Index i : loop) {
        if (i < 0 || i >= positions.rows())
            throw FeatureError(subject, "rows from 0 to " + std::to_string(positions.rows() - 1),
                               std::to_string(i), "Count the points from 0.");
        if (std::exchange(taken[to_size(i)], 1))
            throw FeatureError(subject, "every point once", "point " + std::to_string(i) + " twice",
                               "Leave out the repetition; the loop closes by itself.");
    }
    // The surface is where the neighbors are.
    double left = 0.0;
    for (std::size_t k = 0; k < loop.size(); ++k) {
        const Index i = loop[k];
        const Vector3 along = (positions.row(loop[k + 1 < loop.size() ? k + 1 : 0]) -
                               positions.row(loop[k > 0 ? k - 1 : loop.size() - 1]))
                                  .transpose();
        const Vector3 normal = normals.row(i);
        Vector3 around = Vector3::Zero();
        for (const Index j : nearest[i])
            if (normals.row(j).dot(normals.row(i)) >= kOpposed)
                around += (positions.row(j) - positions.row(i)).transpose();
        left += normal.cross(along).normalized().dot(around.normalized());
    }
    if (left < 0.0) std::reverse(loop.begin() + 1, loop.end());
    return loop;
}

double loop_length(const Positions& positions, std::span<const Index> loop) {
    double length = 0.0;
    for (std::size_t k = 0; k < loop.size(); ++k)
        length +=
            (positions.row(loop[k + 1 < loop.size() ? k + 1 : 0]) - positions.row(loop[k])).norm();
    return length;
}

}  // namespace pointmorph

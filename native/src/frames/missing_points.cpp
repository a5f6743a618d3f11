#include "frames/missing_points.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>

#include "base/compiler.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

/// Distance of the samples that are tried, in the spacing of new points.
constexpr double kStep = 0.3;

/// So many samples are tried in a frame, and no more, where points that lie close together go far
/// apart.
constexpr double kMostSamples = 2e4, kMostSamplesByPair = 300.0;  // at a spacing of 1

/// Fraction of the progress at which the sparse rows are known.
constexpr double kTested = 0.25;

/// What identifies a row at all times: the pair, or the number of pairs plus the id.
Index number_of(const FrameSample& sample, Index row) {
    return row < sample.pairs ? row : sample.pairs + sample.ids[to_size(row - sample.pairs)];
}

/// −1 if it isn't there any more.
Index row_of(const FrameSample& sample, Index number) {
    return number < sample.pairs ? number : sample.rows[to_size(number - sample.pairs)];
}

/// The k nearest of a row and itself.
struct Nearest {
    std::array<Index, Resampling::kDensityNeighbors + 1> rows;
    std::array<double, Resampling::kDensityNeighbors + 1> squared_distances;
    Index found;

    Nearest(const FrameSample& sample, Index row)
        : found(sample.tree->nearest(sample.positions.row(row).data(), rows, squared_distances)) {}

    double density() const {
        const double squared = found > 0 ? squared_distances[to_size(found - 1)] : 0.0;
        return squared > 0.0 ? (found - 1) / squared : std::numeric_limits<double>::infinity();
    }
};

/// Has places and normals of a triangle brought into the caches.
void fetch_corners(const FrameSample& sample, const GapTriangle& corners) {
    for (const Index corner : corners) {
        fetch_early(sample.positions.data() + 3 * to_size(corner));
        fetch_early(sample.normals.data() + 3 * to_size(corner));
    }
}

}  // namespace

FrameSample::FrameSample(double time, const OrientedPoints& frame, const Resampling& resampling,
                         std::vector<InsertedPoint> alive, std::vector<Index> their_ids,
                         std::size_t count)
    : t(time),
      unit(normalization(frame.positions)),
      pairs(to_index(frame.positions.rows())),
      points(std::move(alive)),
      ids(std::move(their_ids)),
      rows(count, -1),
      spacing(pairs),
      positions(pairs + static_cast<Eigen::Index>(points.size()), 3),
      normals(positions.rows(), 3),
      rough(to_size(positions.rows())) {
    for (std::size_t i = 0; i < ids.size(); ++i) rows[to_size(ids[i])] = pairs + to_index(i);
    const auto put_rough = [&](Index row, double at) {
        const auto place = positions.row(row).cast<float>();
        rough[to_size(row)] = {place[0], place[1], place[2], static_cast<float>(at)};
    };
    Progress silent;
    parallel_for(pairs, silent, [&](Index begin, Index end) {
        const Index some = end - begin;
        positions.middleRows(begin, some) =
            (frame.positions.middleRows(begin, some).rowwise() - unit.center.transpose()) /
            unit.scale;
        normals.middleRows(begin, some) = frame.normals.middleRows(begin, some);
        for (Index row = begin; row < end; ++row) {
            spacing[row] = resampling.options().spacing * resampling.spacing(row, t) / unit.scale;
            put_rough(row, spacing[row]);
        }
    });
    parallel_for(to_index(points.size()), silent, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const InsertedPoint& point = points[to_size(i)];
            positions.row(pairs + i) = blend(positions, point).transpose();
            normals.row(pairs + i) = gap_triangle_normal(positions, normals, point).transpose();
            put_rough(pairs + i, 0.0);
        }
    });
}

double FrameSample::spacing_at(const InsertedPoint& point) const {
    return blend(point, [&](Index pair) { return spacing[pair]; });
}

double density(const FrameSample& sample, Index row) {
    return Nearest(sample, row).density();
}

MissingPoints::MissingPoints(const Resampling& resampling, std::span<const IndexPair> pairs,
                             const EndSamples& source, const EndSamples& target,
                             const std::vector<Place>& chosen, Progress& progress)
    : resampling_(resampling),
      pairs_(pairs),
      source_(source),
      target_(target),
      chosen_(chosen),
      triangles_(gap_triangles(source, target, pairs, progress)),
      covering_(triangles_.size()) {
    for (auto& numbers : covering_) numbers.fill(-1);
}

std::vector<OpenTriangle> MissingPoints::open_triangles(const FrameSample& sample,
                                                        const std::function<void()>& meanwhile,
                                                        Progress& progress) const {
    constexpr Index kChunk = 4096, kAtOnce = to_index(kTrianglesAtOnce);
    const auto count = to_index(triangles_.size());
    std::vector<std::vector<OpenTriangle>> found(to_size((count + kChunk - 1) / kChunk));
    const auto look = [&](Index begin, Index end) {
        for (Index first = begin; first < end; first += kAtOnce) {
            const auto some = std::span(triangles_)
                                  .subspan(to_size(first), to_size(std::min(kAtOnce, end - first)));
            const std::uint64_t all = ~std::uint64_t{0} >> (kTrianglesAtOnce - some.size());
            std::uint64_t open =
                all & ~surely_narrow(sample.rough, some, static_cast<float>(kEmpty));
            for (std::uint64_t soon = open; soon != 0; soon &= soon - 1)
                fetch_corners(sample, some[to_size(std::countr_zero(soon))]);
            for (; open != 0; open &= open - 1) {
                const Index i = first + std::countr_zero(open);
                const GapTriangle& corners = triangles_[to_size(i)];
                const Wideness wideness(sample.positions, corners);
                const auto [a, b, c] = corners;
                const double mean =
                    (sample.spacing[a] + sample.spacing[b] + sample.spacing[c]) / 3.0;
                if (!wideness.is_more_than(kEmpty * mean) ||
                    !shows_front(sample.positions, sample.normals, corners))
                    continue;
                const bool is_gap = wideness.is_more_than(kGap * mean);
                found[to_size(begin / kChunk)].push_back(
                    {i, is_gap, is_gap ? samples_wanted(sample, corners) : 0.0});
            }
        }
    };
    // One of the threads does the first chunk, and others go on with the triangles.
    const auto look_or_do_else = [&](Index begin, Index end) {
        if (begin == 0)
            meanwhile();
        else
            look(begin - kChunk, end - kChunk);
    };
    parallel_for(kChunk + count, progress, look_or_do_else, 0.0, 1.0, kChunk);
    std::vector<OpenTriangle> result;
    for (const auto& some : found) result.insert(result.end(), some.begin(), some.end());
    return result;
}

/// As many as there are where samples lie as close as they should.
double MissingPoints::samples_wanted(const FrameSample& sample, const GapTriangle& corners) const {
    return BoundingRectangle(corners, sample.positions).samples({step_in(sample, corners)});
}

/// Whether a density, as k/r², fails the test at a row.
bool MissingPoints::is_too_low(const FrameSample& sample, double density, Index row) const {
    const auto wanted_at = [&](Index pair) { return resampling_.wanted_density(pair, sample.t); };
    const double wanted = row < sample.pairs
                              ? wanted_at(row)
                              : blend(sample.points[to_size(row - sample.pairs)], wanted_at);
    const double area = resampling_.unit_area(sample.t) / (sample.unit.scale * sample.unit.scale);
    return density * area < resampling_.options().omega * wanted;
}

/// Whether a row passes the test by points that may be near; the k nearest are no farther.
bool MissingPoints::is_dense_by(const FrameSample& sample, Index row, const Numbers& near) const {
    std::array<Index, kNearest> rows;
    float rough = 0.0F;
    const RoughCorner& here = sample.rough[to_size(row)];
    for (std::size_t k = 0; k < kNearest; ++k) {
        rows[k] = row_of(sample, near[k]);
        if (rows[k] < 0) return false;
        const RoughCorner& there = sample.rough[to_size(rows[k])];
        const float x = there[0] - here[0], y = there[1] - here[1], z = there[2] - here[2];
        rough = std::max(rough, x * x + y * y + z * z);
    }
    // Mostly they are near enough even if they are a little farther than it seems.
    const double farthest = 1.000001 * std::sqrt(static_cast<double>(rough)) + kRoughness;
    const auto is_near_enough = [&](double squared) {
        return !is_too_low(sample, static_cast<double>(kNearest) / squared, row);
    };
    if (is_near_enough(farthest * farthest)) return true;
    double squared = 0.0;
    for (const Index there : rows) {
        const auto away = sample.positions.row(there) - sample.positions.row(row);
        squared = std::max(squared, away.squaredNorm());
    }
    return is_near_enough(squared);
}

/// The same by those that were near when it was last asked, else by those around the row on one of
/// the models, which are remembered if it does.
bool MissingPoints::is_dense(const FrameSample& sample, Index row) {
    Numbers& known = nearest_[to_size(number_of(sample, row))];
    if (known.front() >= 0 && is_dense_by(sample, row, known)) return true;
    if (row >= sample.pairs) return false;
    const auto around = [&](const EndSamples& end, Index at) {
        const auto near = end.nearest[at];
        if (near.size() < kNearest) return false;
        Numbers numbers;
        for (std::size_t k = 0; k < kNearest; ++k) numbers[k] = end.pairs[to_size(near[k])];
        if (!is_dense_by(sample, row, numbers)) return false;
        known = numbers;
        return true;
    };
    const auto [s, d] = pairs_[to_size(row)];
    return around(source_, s) || around(target_, d);
}

bool MissingPoints::is_sparse(const FrameSample& sample, Index row) {
    if (is_dense(sample, row)) return false;
    const Nearest nearest(sample, row);
    if (to_size(nearest.found) > kNearest) {
        // Where points coincide, the row itself isn't always the first.
        std::size_t count = 0;
        for (const Index other : nearest.rows)
            if (other != row && count < kNearest)
                nearest_[to_size(number_of(sample, row))][count++] = number_of(sample, other);
    }
    return is_too_low(sample, nearest.density(), row);
}

/// Which rows fail the test: corners of `open` triangles, and new points.
std::vector<char> MissingPoints::sparse_rows(const FrameSample& sample,
                                             std::span<const OpenTriangle> open,
                                             std::span<const char> dead, Progress& progress) {
    const Index rows = sample.tree->size();
    std::vector<char> sparse(to_size(rows));
    for (const OpenTriangle& triangle : open)
        for (const Index corner : triangles_[to_size(triangle.number)]) sparse[to_size(corner)] = 1;
    for (std::size_t a = 0; a < dead.size(); ++a) sparse[to_size(sample.pairs) + a] = !dead[a];
    UnsetVector<Index> asked(sparse.size());
    std::size_t count = 0;
    for (Index row = 0; row < rows; ++row) {
        asked[count] = row;
        count += sparse[to_size(row)] != 0;
    }
    constexpr std::size_t kSoon = 6, kSooner = 3;
    const auto test = [&](Index begin, Index end) {
        for (std::size_t i = to_size(begin); i < to_size(end); ++i) {
            if (i + kSoon < to_size(end))
                fetch_early(&nearest_[to_size(number_of(sample, asked[i + kSoon]))]);
            if (i + kSooner < to_size(end))
                for (const Index number : nearest_[to_size(number_of(sample, asked[i + kSooner]))])
                    if (number >= 0 && number < sample.pairs)
                        fetch_early(&sample.rough[to_size(number)]);
            sparse[to_size(asked[i])] = is_sparse(sample, asked[i]);
        }
    };
    parallel_for(to_index(count), progress, test, 0.0, kTested);
    return sparse;
}

/// Triangles that may take points. Finds by how much samples along both sides must be fewer, so
/// that there aren't too many.
std::vector<MissingPoints::Gap> MissingPoints::gaps(const FrameSample& sample,
                                                    std::span<const OpenTriangle> open,
                                                    std::span<const char> dead,
                                                    Progress& progress) {
    const std::vector<char> sparse = sparse_rows(sample, open, dead, progress);
    std::vector<char> holds_sparse(triangles_.size());
    for (std::size_t a = 0; a < sample.ids.size(); ++a)
        if (sparse[to_size(sample.pairs) + a])
            holds_sparse[to_size(chosen_[to_size(sample.ids[a])].triangle)] = 1;
    std::vector<Gap> result;
    double all = 0.0;
    for (const auto& [number, leaves_gap, samples] : open) {
        const GapTriangle& corners = triangles_[to_size(number)];
        const bool lacks_points =
            holds_sparse[to_size(number)] ||
            std::ranges::any_of(corners, [&](Index row) { return sparse[to_size(row)]; });
        if (!lacks_points && !leaves_gap) continue;
        result.push_back({number, lacks_points});
        all += leaves_gap ? samples : samples_wanted(sample, corners);
    }
    const double finer = 1.0 / resampling_.options().spacing;
    const double most =
        kMostSamples + kMostSamplesByPair * finer * finer * static_cast<double>(sample.pairs);
    coarser_ = std::sqrt(std::max(1.0, all / most));
    return result;
}

/// How far apart samples of a triangle should lie.
double MissingPoints::step_in(const FrameSample& sample, const GapTriangle& corners) const {
    const InsertedPoint middle{corners, {1.0 / 3, 1.0 / 3, 1.0 / 3}, {}};
    return kStep * sample.spacing_at(middle);
}

/// Whether one of the models has a sample there; a gap that both have stays.
bool MissingPoints::is_covered_at_an_end(const InsertedPoint& point, NeighborSearch& find) const {
    const auto covers = [&](const EndSamples& end, Index IndexPair::*side) {
        InsertedPoint there = point;
        for (Index& row : there.pairs) row = pairs_[to_size(row)].*side;
        const double spacing = blend(there, [&](Index row) { return end.spacing[row]; });
        return find.any(end.tree, end.normals, blend(end.positions, there),
                        gap_triangle_normal(end.positions, end.normals, there), kGap * spacing);
    };
    return covers(source_, &IndexPair::source) || covers(target_, &IndexPair::target);
}

/// Calls `take(point)` at samples of a triangle that have no point on their side within `radius`
/// (in the spacing of new points), until it returns false.
void MissingPoints::each_empty(const FrameSample& sample, Index triangle, double radius,
                               std::span<const char> dead, NeighborSearch& find,
                               const std::function<bool(const InsertedPoint&)>& take) {
    const GapTriangle& corners = triangles_[to_size(triangle)];
    auto& covering = covering_[to_size(triangle)];
    const auto counts = [&](Index row) {
        return row < sample.pairs || !dead[to_size(row - sample.pairs)];
    };
    // Where the corners' normals are this close, the normal at any place lies between them, and the
    // triangle's own doesn't count: what is on the side of all three is on its side.
    constexpr double kAlike = 0.75;   // cosine
    constexpr double kSurely = 0.04;  // more than rounding takes away
    const auto [a, b, c] = corners;
    const auto& normals = sample.normals;
    const bool are_alike = normals.row(a).dot(normals.row(b)) > kAlike &&
                           normals.row(b).dot(normals.row(c)) > kAlike &&
                           normals.row(c).dot(normals.row(a)) > kAlike;
    const auto is_empty = [&](const InsertedPoint& point, bool is_near_corner) {
        const Vector3 place = blend(sample.positions, point);
        const double distance = radius * sample.spacing_at(point);
        std::optional<Vector3> normal;
        const auto normal_there = [&]() -> const Vector3& {
            if (!normal) normal = gap_triangle_normal(sample.positions, normals, point);
            return *normal;
        };
        const auto agrees_with = [&](Index row, Index corner) {
            return normals.row(row).dot(normals.row(corner)) > kSurely;
        };
        const auto covers = [&](Index row) {
            const Vector3 away = sample.positions.row(row).transpose() - place;
            if (!(away.squaredNorm() < distance * distance)) return false;
            if (are_alike && agrees_with(row, a) && agrees_with(row, b) && agrees_with(row, c))
                return true;
            return normals.row(row).dot(normal_there()) > 0.0;
        };
        if (is_near_corner && std::ranges::any_of(corners, covers)) return false;
        const auto still_covers = [&](Index number) {
            const Index row = number < 0 ? -1 : row_of(sample, number);
            return row >= 0 && counts(row) && covers(row);
        };
        if (std::ranges::any_of(covering, still_covers)) return false;
        Index number = -1;
        for (const Index corner : corners) {
            const Numbers& near = nearest_[to_size(corner)];
            const auto found = std::ranges::find_if(near, still_covers);
            if (found == near.end()) continue;
            number = *found;
            break;
        }
        if (number < 0) {
            const Index row = find.nearest(sample, place, normal_there(), distance, counts);
            if (row < 0) return true;
            number = number_of(sample, row);
        }
        std::ranges::rotate(covering, covering.end() - 1);
        covering.front() = number;
        return false;
    };
    each_few_samples(corners, sample.positions, {step_in(sample, corners), coarser_},
                     [&](const SomeSamples& some) {
                         SampledCorners at;
                         for (std::size_t k = 0; k < 3; ++k) {
                             at.places[k] = sample.positions.row(some.corners[k]).transpose();
                             at.spacing[k] = sample.spacing[some.corners[k]];
                         }
                         const std::uint64_t near = near_corners(at, some, radius);
                         std::uint64_t rest =
                             ~std::uint64_t{0} >> (SomeSamples::kMost - some.count);
                         if (are_alike) rest &= ~near;
                         for (; rest != 0; rest &= rest - 1) {
                             const int i = std::countr_zero(rest);
                             const InsertedPoint point = some[to_size(i)];
                             if (is_empty(point, ((near >> i) & 1) != 0) && !take(point))
                                 return false;
                         }
                         return true;
                     });
}

std::vector<MissingPoints::Place> MissingPoints::operator()(const FrameSample& sample,
                                                            std::span<const OpenTriangle> open,
                                                            std::span<const char> dead,
                                                            Progress& progress) {
    Numbers none;
    none.fill(-1);
    nearest_.resize(pairs_.size() + chosen_.size(), none);
    constexpr Index kChunk = 64, kAhead = 4;
    const std::vector<Gap> found_gaps = gaps(sample, open, dead, progress);
    const auto count = to_index(found_gaps.size());
    std::vector<std::vector<Place>> found(to_size((count + kChunk - 1) / kChunk));
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            NeighborSearch find;
            auto& taken = found[to_size(begin / kChunk)];
            for (Index i = begin; i < end; ++i) {
                if (i + kAhead < end)
                    fetch_corners(sample,
                                  triangles_[to_size(found_gaps[to_size(i + kAhead)].triangle)]);
                const auto [triangle, lacks_points] = found_gaps[to_size(i)];
                bool is_needed = lacks_points;
                if (!is_needed)
                    each_empty(sample, triangle, kGap, dead, find, [&](const InsertedPoint& point) {
                        is_needed = is_covered_at_an_end(point, find);
                        return !is_needed;
                    });
                if (is_needed)
                    each_empty(sample, triangle, kEmpty, dead, find,
                               [&](const InsertedPoint& point) {
                                   taken.push_back({triangle, point});
                                   return true;
                               });
            }
        },
        kTested, 1.0, kChunk);
    std::vector<Place> places;
    for (const auto& some : found) places.insert(places.end(), some.begin(), some.end());
    return places;
}

}  // namespace pointmorph

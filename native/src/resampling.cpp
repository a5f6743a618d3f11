#include "pointmorph/resampling.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "pointmorph/error.hpp"
#include "pointmorph/kd_tree.hpp"
#include "pointmorph/neighborhoods.hpp"
#include "pointmorph/parallel.hpp"
#include "pointmorph/subset.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t slot(Index i) {
    return static_cast<std::size_t>(i);
}

/// Times at which points come and go, evenly over the morph.
constexpr int kKeys = 16;

constexpr Index kNeighbors = 16;
/// Largest circle through a triangle's corners, in spacings: wider gaps are holes of the model.
constexpr double kReach = 2.0;
/// Spacings below this share of the cloud's mean are rounding or doubled points.
constexpr double kFinest = 0.05;

// In the spacing of new points. Where no point lies within kGap, discs of one spacing leave a gap;
// where every place has one within kEmpty they don't. The samples that are tried lie kStep apart.
constexpr double kEmpty = 0.75, kStep = 0.3, kCrowded = 0.4, kGap = 1.0;
constexpr double kMostSteps = 256.0;  // along either side of one rectangle

// Corners of a triangle that lie this many spacings apart are no longer samples of one smooth
// piece: from the first on the MLS surface counts less, from the second on not at all.
constexpr double kCoherent = 2.0, kTorn = 4.0, kWidest = 1.5;

Vector3 blend(const Positions& rows, const InsertedPoint& point) {
    Vector3 sum = Vector3::Zero();
    for (std::size_t c = 0; c < 3; ++c)
        sum += point.weights[c] * rows.row(point.pairs[c]).transpose();
    return sum;
}

/// Twice a triangle's area, along the normal of the side from which its corners are seen to go
/// round to the left.
Vector3 facing(const Positions& positions, const Triangle& corners) {
    const Vector3 origin = positions.row(corners[0]).transpose();
    return (positions.row(corners[1]).transpose() - origin)
        .cross(positions.row(corners[2]).transpose() - origin);
}

/// Whether a triangle shows its front where its corners do. One that doesn't is folded over, or
/// leads through the inside of a shape: a sheet there would show its back. A line has no front: its
/// ends must agree.
bool shows_front(const Positions& positions, const Normals& normals, const Triangle& corners) {
    const Vector3 faces = facing(positions, corners);
    const auto [a, b, c] = corners;
    if (!(faces.squaredNorm() > 0.0)) return normals.row(a).dot(normals.row(c)) >= 0.0;
    return (normals.row(a) + normals.row(b) + normals.row(c)).dot(faces) >= 0.0;
}

/// The corners' mean normal; the less they agree, the more the side to which the triangle faces.
Vector3 blend_normals(const Positions& positions, const Normals& normals,
                      const InsertedPoint& point) {
    constexpr double kAgreeing = 0.9, kCancelled = 1e-6;
    Vector3 sum = blend(normals, point);
    if (const double length = sum.norm(); length < kAgreeing) {
        const Vector3 faces = facing(positions, point.pairs);
        if (const double area = faces.norm(); area > 0.0)
            sum += (1.0 - length / kAgreeing) / area * faces;
    }
    if (const double length = sum.norm(); length > kCancelled) return sum / length;
    const auto most = std::ranges::max_element(point.weights) - point.weights.begin();
    return normals.row(point.pairs[static_cast<std::size_t>(most)]).transpose();
}

/// Root of the mean squared length of a triangle's edges.
double edge_length(const Positions& positions, const std::array<Index, 3>& corners) {
    double sum = 0.0;
    for (std::size_t c = 0; c < 3; ++c)
        sum += (positions.row(corners[c]) - positions.row(corners[(c + 1) % 3])).squaredNorm();
    return std::sqrt(sum / 3.0);
}

/// Whether some place of a triangle is farther than `radius` from all corners.
bool is_wider(const Positions& positions, const std::array<Index, 3>& corners, double radius) {
    std::array<double, 3> squares;  // of the edge opposite to a corner
    for (std::size_t c = 0; c < 3; ++c)
        squares[c] = (positions.row(corners[(c + 1) % 3]) - positions.row(corners[(c + 2) % 3]))
                         .squaredNorm();
    const double largest = std::max({squares[0], squares[1], squares[2]});
    // No place is farther than in the triangle whose edges are all as long as the longest.
    if (!(largest > 3.0 * radius * radius)) return false;
    std::ranges::sort(squares);
    const auto [a, b, c] = squares;
    if (a + b > c) {  // acute: the centre of the circle through the corners
        const double area = 2.0 * (a * b + b * c + c * a) - a * a - b * b - c * c;
        return a * b * c > radius * radius * area;
    }
    // Obtuse: on the longest edge, where the middle line of the second longest meets it.
    return b * std::sqrt(c) > radius * (b + c - a);
}

/// Room for what decides on a density: the point itself and the k nearest.
struct Nearest {
    std::array<Index, Resampling::kDensityNeighbors + 1> rows;
    std::array<double, Resampling::kDensityNeighbors + 1> squared_distances;
};

/// ρ = k/r² at a point of the tree.
double density(const KdTree<3>& tree, Index row, Nearest& nearest) {
    const Index found =
        tree.nearest(tree.points().row(row).data(), nearest.rows, nearest.squared_distances);
    const double radius = found > 0 ? nearest.squared_distances[slot(found - 1)] : 0.0;
    return radius > 0.0 ? (found - 1) / radius : std::numeric_limits<double>::infinity();
}

/// What one cloud says: by row, in its own unit ball.
struct Samples {
    Normalization unit;
    Positions positions;
    Normals normals;
    KdTree<3> tree;
    Values spacing;
    Values density;  ///< per share of the surface
    double size;     ///< √area, as given
    Neighborhoods nearest;
    std::vector<Triangle> triangles;
    std::vector<Index> pairs;  ///< by row, the pair that stands for it
    /// The nearest of every row, nearest first; kDensityNeighbors of each, or all others.
    Neighborhoods around;

    Samples(const Cloud& cloud, std::vector<Index> standing, Progress& progress, double first,
            double last)
        : unit(normalization(cloud.positions)),
          positions(unit.apply(cloud.positions)),
          normals(cloud.normals.rowwise().normalized()),
          tree(positions),
          pairs(std::move(standing)) {
        const Progress::Part part(progress, first, last);
        nearest = nearest_neighbors(tree, kNeighbors, progress);
        const double area = estimated_area(tree);
        const auto count = static_cast<double>(positions.rows());
        spacing = local_spacing(positions, nearest).cwiseMax(kFinest * std::sqrt(area / count));
        triangles = local_triangles(positions, normals, nearest, spacing, kReach, progress);
        density.resize(positions.rows());
        for (Index i = 0; i < positions.rows(); ++i) {
            const auto near = nearest[i];
            const auto k = std::min(near.size(), slot(Resampling::kDensityNeighbors));
            const double radius = std::max((positions.row(near[k - 1]) - positions.row(i)).norm(),
                                           kFinest * std::sqrt(area / count));
            density[i] = static_cast<double>(k) / (radius * radius) * area;
        }
        size = std::sqrt(area) * unit.scale;
    }
};

/// By row of one cloud, the pair that stands for it: its partner lies nearest to the mean of all
/// its partners on the other cloud.
std::vector<Index> standing_for(std::span<const IndexPair> pairs, Index IndexPair::*side,
                                Index IndexPair::*other_side, const Cloud& cloud,
                                const Cloud& other) {
    Positions mean = Positions::Zero(cloud.size(), 3);
    Values count = Values::Zero(cloud.size());
    for (const IndexPair& pair : pairs) {
        mean.row(pair.*side) += other.positions.row(pair.*other_side);
        count[pair.*side] += 1.0;
    }
    std::vector<Index> result(slot(cloud.size()), -1);
    Values best(cloud.size());
    for (std::size_t i = 0; i < pairs.size(); ++i) {
        const Index row = pairs[i].*side;
        const double off =
            (other.positions.row(pairs[i].*other_side) - mean.row(row) / count[row]).stableNorm();
        if (result[slot(row)] >= 0 && !(off < best[row])) continue;
        result[slot(row)] = static_cast<Index>(i);
        best[row] = off;
    }
    return result;
}

/// Finds a point on the same side of the surface within a radius. One object a thread.
class NeighborSearch {
public:
    /// The nearest row for which `counts(row)` is true.
    template <class Counts>
    std::optional<Index> operator()(const KdTree<3>& tree, const Normals& normals,
                                    const Vector3& place, const Vector3& normal, double radius,
                                    Counts&& counts) {
        tree.within(place.data(), radius, ball_);
        for (const auto& [row, squared] : ball_)
            if (normals.row(row).dot(normal) > 0.0 && counts(row)) return row;
        return std::nullopt;
    }

private:
    std::vector<std::pair<Index, double>> ball_;
};

}  // namespace

double Life::share(double t) const {
    if (t <= born || t >= gone) return 0.0;
    const double x = t < full     ? (t - born) / (full - born)
                     : t > fading ? (gone - t) / (gone - fading)
                                  : 1.0;
    return x * x * (3.0 - 2.0 * x);
}

/// Goes through the times in order and keeps what lives.
class ResamplingBuilder {
public:
    ResamplingBuilder(Resampling& result, std::span<const IndexPair> pairs, const Samples& source,
                      const Samples& target, std::vector<Triangle> triangles)
        : result_(result),
          options_(result.options_),
          pairs_(pairs),
          source_(source),
          target_(target),
          triangles_(std::move(triangles)),
          nearest_(pairs.size(), kNone) {
        covering_.resize(triangles_.size());
        for (auto& rows : covering_) rows.fill(-1);
    }

    void step(int key, const Resampling::FrameAt& frame_at, Progress& progress) {
        const double t = static_cast<double>(key) / kKeys;
        const auto first = static_cast<double>(key - 1) / kKeys;
        const Progress::Part part(progress, 0.3 + 0.7 * first, 0.3 + 0.7 * t);
        LiftedCloud frame = frame_at(t);
        unit_ = normalization(frame.positions);
        frame.positions = unit_.apply(frame.positions);
        t_ = t;
        key_ = key;
        spacing_ =
            ((1.0 - t) * result_.source_spacing_ + t * result_.target_spacing_) / unit_.scale;
        const std::vector<Index> open = open_triangles(frame, progress);
        if (!options_.crowding && open.empty() && alive_.empty()) return;

        // The pairs, then what is alive.
        const auto pairs = static_cast<Index>(frame.positions.rows());
        const auto rows = pairs + static_cast<Index>(alive_.size());
        Positions positions(rows, 3);
        Normals normals(rows, 3);
        positions.topRows(pairs) = frame.positions;
        normals.topRows(pairs) = frame.normals;
        for (std::size_t a = 0; a < alive_.size(); ++a) {
            positions.row(pairs + static_cast<Index>(a)) =
                blend(frame.positions, point(alive_[a])).transpose();
            normals.row(pairs + static_cast<Index>(a)) =
                blend_normals(frame.positions, frame.normals, point(alive_[a])).transpose();
        }
        const KdTree<3> tree(positions);
        row_.assign(result_.points_.size(), -1);
        for (std::size_t a = 0; a < alive_.size(); ++a)
            row_[slot(alive_[a])] = pairs + static_cast<Index>(a);
        const std::vector<char> dead = end_crowded(tree, normals, pairs);
        if (options_.crowding) hide_crowded(tree, normals, pairs, progress);
        const std::vector<char> sparse = sparse_rows(open, tree, pairs, dead, progress);
        std::vector<char> holds_sparse(triangles_.size());
        for (std::size_t a = 0; a < alive_.size(); ++a)
            if (sparse[slot(pairs) + a]) holds_sparse[slot(triangle_[slot(alive_[a])])] = 1;
        const auto is_sparse = [&](Index row) { return sparse[slot(row)] != 0; };
        std::vector<Gap> gaps;
        for (const Index i : open) {
            const bool lacks_points =
                holds_sparse[slot(i)] || std::ranges::any_of(triangles_[slot(i)], is_sparse);
            if (lacks_points || may_leave_gap(i, frame)) gaps.push_back({i, lacks_points});
        }
        insert(gaps, frame, tree, normals, pairs, dead, progress);

        std::vector<Index> living;
        for (std::size_t a = 0; a < alive_.size(); ++a)
            if (!dead[a]) living.push_back(alive_[a]);
        living.insert(living.end(), born_.begin(), born_.end());
        alive_ = std::move(living);
        for (const Index id : alive_) last_key_[slot(id)] = key;
        born_.clear();
    }

    void finish() {
        for (std::size_t i = 0; i < result_.points_.size(); ++i)
            result_.points_[i].life = life(first_key_[i], last_key_[i]);
    }

private:
    static constexpr std::size_t kNearest = slot(Resampling::kDensityNeighbors), kRemembered = 4;
    static constexpr std::array<Index, kNearest> kNone{-1};

    static Life life(int first, int last) {
        const auto time = [](int key) { return static_cast<double>(key) / kKeys; };
        return {time(first - 1), time(first), time(last), time(last + 1)};
    }

    const InsertedPoint& point(Index id) const { return result_.points_[slot(id)]; }

    double spacing(Index pair) const { return spacing_[pair]; }
    double spacing(const InsertedPoint& point) const {
        double sum = 0.0;
        for (std::size_t c = 0; c < 3; ++c) sum += point.weights[c] * spacing(point.pairs[c]);
        return options_.spacing * sum;
    }

    /// Triangles with corners so far apart that discs around them may leave a gap.
    std::vector<Index> open_triangles(const LiftedCloud& frame, Progress& progress) const {
        std::vector<char> is_open(triangles_.size());
        parallel_for(static_cast<Index>(triangles_.size()), progress, [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                const auto& corners = triangles_[slot(i)];
                const double wanted =
                    (spacing(corners[0]) + spacing(corners[1]) + spacing(corners[2])) / 3.0;
                is_open[slot(i)] =
                    is_wider(frame.positions, corners, kEmpty * options_.spacing * wanted) &&
                    shows_front(frame.positions, frame.normals, corners);
            }
        });
        std::vector<Index> result;
        for (Index i = 0; i < static_cast<Index>(is_open.size()); ++i)
            if (is_open[slot(i)]) result.push_back(i);
        return result;
    }

    bool may_leave_gap(Index triangle, const LiftedCloud& frame) const {
        const auto& corners = triangles_[slot(triangle)];
        const InsertedPoint middle{corners, {1.0 / 3, 1.0 / 3, 1.0 / 3}, {}};
        return is_wider(frame.positions, corners, kGap * spacing(middle));
    }

    /// Points that are no longer needed: others have come close.
    std::vector<char> end_crowded(const KdTree<3>& tree, const Normals& normals,
                                  Index pairs) const {
        std::vector<char> dead(alive_.size());
        NeighborSearch find;
        for (std::size_t a = 0; a < alive_.size(); ++a) {
            const Index row = pairs + static_cast<Index>(a);
            const auto counts = [&](Index other) {
                return other < pairs || (other < row && !dead[slot(other - pairs)]);
            };
            dead[a] =
                find(tree, normals, tree.points().row(row).transpose(),
                     normals.row(row).transpose(), kCrowded * spacing(point(alive_[a])), counts)
                    .has_value();
        }
        return dead;
    }

    /// Whether a density, as k/r² in the frame, fails the test at a pair or an inserted point.
    bool is_too_low(double density, Index row, Index pairs) const {
        double wanted = 0.0;
        if (row < pairs) {
            wanted = result_.wanted_density(row, t_);
        } else {
            const InsertedPoint& inserted = point(alive_[slot(row - pairs)]);
            for (std::size_t c = 0; c < 3; ++c)
                wanted += inserted.weights[c] * result_.wanted_density(inserted.pairs[c], t_);
        }
        const double area = result_.unit_area(t_) / (unit_.scale * unit_.scale);
        return density * area < options_.omega * wanted;
    }

    /// What a row of the tree keeps for all times: the pair, or the number of pairs plus the id.
    Index number_of(Index row) const {
        const auto pairs = static_cast<Index>(pairs_.size());
        return row < pairs ? row : pairs + alive_[slot(row - pairs)];
    }
    /// −1 where it's in the tree no more.
    Index row_of(Index number) const {
        const auto pairs = static_cast<Index>(pairs_.size());
        return number < pairs ? number : row_[slot(number - pairs)];
    }

    /// Whether the density at a row of the tree passes the test by points that are known to be
    /// near: its k nearest of the last time, and those around it on the models.
    bool is_dense(Index row, const Positions& positions) const {
        const auto pairs = static_cast<Index>(pairs_.size());
        const auto suffice = [&](std::span<const Index> near, auto&& row_at) {
            if (near.size() < kNearest) return false;
            double squared = 0.0;
            for (const Index other : near.first(kNearest)) {
                const Index there = row_at(other);
                if (there < 0) return false;
                squared =
                    std::max(squared, (positions.row(there) - positions.row(row)).squaredNorm());
            }
            return !is_too_low(Resampling::kDensityNeighbors / squared, row, pairs);
        };
        const auto& known = nearest_[slot(number_of(row))];
        if (known.front() >= 0) return suffice(known, [&](Index number) { return row_of(number); });
        if (row >= pairs) return false;
        const auto around = [&](const Samples& end, Index at) {
            return suffice(end.nearest[at], [&](Index other) { return end.pairs[slot(other)]; });
        };
        const auto [s, d] = pairs_[slot(row)];
        return around(source_, s) || around(target_, d);
    }

    /// Whether the density at a row of the tree fails the test.
    bool is_sparse(Index row, const KdTree<3>& tree) {
        if (is_dense(row, tree.points())) return false;
        Nearest nearest;
        const double found = density(tree, row, nearest);
        if (tree.size() > Resampling::kDensityNeighbors)
            std::ranges::transform(std::span(nearest.rows).last(kNearest),
                                   nearest_[slot(number_of(row))].begin(),
                                   [&](Index other) { return number_of(other); });
        return is_too_low(found, row, static_cast<Index>(pairs_.size()));
    }

    /// Which rows of the tree fail the test: corners of `open` triangles, then what is alive.
    std::vector<char> sparse_rows(std::span<const Index> open, const KdTree<3>& tree, Index pairs,
                                  std::span<const char> dead, Progress& progress) {
        const Index rows = tree.size();
        std::vector<char> sparse(slot(rows));
        for (const Index i : open)
            for (const Index corner : triangles_[slot(i)]) sparse[slot(corner)] = 1;
        for (Index row = pairs; row < rows; ++row) sparse[slot(row)] = !dead[slot(row - pairs)];
        parallel_for(rows, progress, [&](Index begin, Index end) {
            for (Index row = begin; row < end; ++row)
                sparse[slot(row)] = sparse[slot(row)] && is_sparse(row, tree);
        });
        return sparse;
    }

    /// Whether one of the models has a sample there: a gap that both have stays one.
    bool is_covered_at_an_end(const InsertedPoint& point, NeighborSearch& find) const {
        const auto covers = [&](const Samples& end, Index IndexPair::*side) {
            InsertedPoint there = point;
            double spacing = 0.0;
            for (std::size_t c = 0; c < 3; ++c) {
                there.pairs[c] = pairs_[slot(point.pairs[c])].*side;
                spacing += point.weights[c] * end.spacing[there.pairs[c]];
            }
            return find(end.tree, end.normals, blend(end.positions, there),
                        blend_normals(end.positions, end.normals, there), kGap * spacing,
                        [](Index) { return true; })
                .has_value();
        };
        return covers(source_, &IndexPair::source) || covers(target_, &IndexPair::target);
    }

    /// Most samples are, and so needn't be looked for in the tree.
    bool is_near_corner(const LiftedCloud& frame, const InsertedPoint& candidate,
                        const Vector3& place, const Vector3& normal, double radius) const {
        return std::ranges::any_of(candidate.pairs, [&](Index pair) {
            return (frame.positions.row(pair).transpose() - place).squaredNorm() <
                       radius * radius &&
                   frame.normals.row(pair).dot(normal) > 0.0;
        });
    }

    /// A triangle that may take points.
    struct Gap {
        Index triangle;
        bool lacks_points;  ///< by the density; else only if discs leave a gap in it
    };
    struct Candidate {
        Index triangle;
        InsertedPoint point;
    };

    /// Uniform samples of a triangle's bounding rectangle in its plane, those inside, until `take`
    /// returns false.
    template <class Take>
    void sample(Index triangle, const Positions& positions, Take&& take) const {
        auto corners = triangles_[slot(triangle)];
        // The longest edge first: the rectangle's base.
        const auto length = [&](std::size_t c) {
            return (positions.row(corners[(c + 1) % 3]) - positions.row(corners[c])).squaredNorm();
        };
        std::size_t longest = 0;
        for (std::size_t c = 1; c < 3; ++c)
            if (length(c) > length(longest)) longest = c;
        std::ranges::rotate(corners, corners.begin() + static_cast<std::ptrdiff_t>(longest));
        const Vector3 origin = positions.row(corners[0]).transpose();
        const Vector3 base = positions.row(corners[1]).transpose() - origin;
        const Vector3 apex = positions.row(corners[2]).transpose() - origin;
        const double width = base.norm();
        if (!(width > 0.0)) return;
        const double along = apex.dot(base) / width;  // 0 to width, the base being the longest
        const double height = (apex - along / width * base).norm();

        InsertedPoint candidate{corners, {1.0 / 3, 1.0 / 3, 1.0 / 3}, {}};
        const double step = kStep * spacing(candidate);
        const auto count = [&](double side) {
            return std::clamp(std::ceil(side / step), 1.0, kMostSteps);
        };
        const double columns = count(width), rows = count(height);
        for (double j = 0.5; j < rows; ++j) {
            const double up = height > 0.0 ? j / rows : 0.0;
            for (double i = 0.5; i < columns; ++i) {
                const double right = i / columns - up * along / width;
                if (right < 0.0 || right + up > 1.0) continue;
                candidate.weights = {1.0 - right - up, right, up};
                if (!take(candidate)) return;
            }
        }
    }

    /// Fills triangles of which a corner, or a point that was put into them, fails the test, and
    /// those in which discs leave a gap that not both models have.
    void insert(std::span<const Gap> gaps, const LiftedCloud& frame, const KdTree<3>& tree,
                const Normals& normals, Index pairs, std::span<const char> dead,
                Progress& progress) {
        constexpr Index kChunk = 64;
        const auto count = static_cast<Index>(gaps.size());
        std::vector<std::vector<Candidate>> found(slot((count + kChunk - 1) / kChunk));
        const auto counts = [&](Index row) { return row < pairs || !dead[slot(row - pairs)]; };
        parallel_for(
            count, progress,
            [&](Index begin, Index end) {
                NeighborSearch find;
                auto& taken = found[slot(begin / kChunk)];
                for (Index i = begin; i < end; ++i) {
                    const auto [triangle, lacks_points] = gaps[slot(i)];
                    const auto each_empty = [&](double radius, auto&& take) {
                        sample(triangle, frame.positions, [&](const InsertedPoint& candidate) {
                            const Vector3 place = blend(frame.positions, candidate);
                            const Vector3 normal =
                                blend_normals(frame.positions, frame.normals, candidate);
                            const double distance = radius * spacing(candidate);
                            if (is_near_corner(frame, candidate, place, normal, distance))
                                return true;
                            auto& covering = covering_[slot(triangle)];
                            const auto still_covers = [&](Index number) {
                                const Index row = number < 0 ? -1 : row_of(number);
                                if (row < 0 || !counts(row)) return false;
                                const Vector3 there = tree.points().row(row).transpose();
                                return (there - place).squaredNorm() < distance * distance &&
                                       normals.row(row).dot(normal) > 0.0;
                            };
                            if (std::ranges::any_of(covering, still_covers)) return true;
                            const auto row = find(tree, normals, place, normal, distance, counts);
                            if (!row) return take(candidate);
                            std::ranges::rotate(covering, covering.end() - 1);
                            covering.front() = number_of(*row);
                            return true;
                        });
                    };
                    bool is_needed = lacks_points;
                    if (!is_needed)
                        each_empty(kGap, [&](const InsertedPoint& candidate) {
                            is_needed = is_covered_at_an_end(candidate, find);
                            return !is_needed;
                        });
                    if (is_needed)
                        each_empty(kEmpty, [&](const InsertedPoint& candidate) {
                            taken.push_back({triangle, candidate});
                            return true;
                        });
                }
            },
            0.0, 1.0, kChunk);
        std::vector<Candidate> candidates;
        for (auto& some : found) candidates.insert(candidates.end(), some.begin(), some.end());
        if (candidates.empty()) return;

        // First come, first served.
        const auto size = static_cast<Index>(candidates.size());
        Positions places(size, 3);
        Normals directions(size, 3);
        for (Index c = 0; c < size; ++c) {
            places.row(c) = blend(frame.positions, candidates[slot(c)].point).transpose();
            directions.row(c) =
                blend_normals(frame.positions, frame.normals, candidates[slot(c)].point)
                    .transpose();
        }
        const KdTree<3> among(places);
        std::vector<char> covered(slot(size));
        std::vector<std::pair<Index, double>> near;
        for (Index c = 0; c < size; ++c) {
            if (c % 256 == 0) progress.report(static_cast<double>(c) / size);
            if (covered[slot(c)]) continue;
            const InsertedPoint& taken = candidates[slot(c)].point;
            born_.push_back(static_cast<Index>(result_.points_.size()));
            nearest_.push_back(kNone);
            result_.points_.push_back(taken);
            triangle_.push_back(candidates[slot(c)].triangle);
            first_key_.push_back(key_);
            last_key_.push_back(key_);
            among.within(places.row(c).data(), kEmpty * spacing(taken), near);
            for (const auto& [other, squared] : near)
                if (directions.row(other).dot(directions.row(c)) > 0.0) covered[slot(other)] = 1;
        }
    }

    /// Pairs that have one that stays close by, where points crowd.
    void hide_crowded(const KdTree<3>& tree, const Normals& normals, Index pairs,
                      Progress& progress) {
        const double area = result_.unit_area(t_) / (unit_.scale * unit_.scale);
        std::vector<char> crowded(slot(pairs));
        parallel_for(pairs, progress, [&](Index begin, Index end) {
            Nearest nearest;
            for (Index i = begin; i < end; ++i)
                crowded[slot(i)] = density(tree, i, nearest) * area >
                                   *options_.crowding * std::max(result_.source_density_[i],
                                                                 result_.target_density_[i]);
        });
        hidden_since_.resize(slot(pairs), 0);
        std::vector<char> stays(slot(pairs), 1);
        NeighborSearch find;
        // Those that are hidden already first, so that they stay so.
        for (const bool was_hidden : {true, false})
            for (Index i = 0; i < pairs; ++i) {
                if ((hidden_since_[slot(i)] > 0) != was_hidden || !crowded[slot(i)]) continue;
                const auto counts = [&](Index other) {
                    return other != i && other < pairs && stays[slot(other)];
                };
                stays[slot(i)] = !find(tree, normals, tree.points().row(i).transpose(),
                                       normals.row(i).transpose(), kCrowded * spacing(i), counts);
            }
        for (Index i = 0; i < pairs; ++i) show_or_hide(i, !stays[slot(i)]);
    }

    void show_or_hide(Index pair, bool hide) {
        int& since = hidden_since_[slot(pair)];
        if (hide && since == 0) since = key_;
        const bool ends = !hide || key_ == kKeys - 1;
        if (since == 0 || !ends) return;
        result_.hidden_.push_back({pair, life(since, hide ? key_ : key_ - 1)});
        since = 0;
    }

    Resampling& result_;
    const ResamplingOptions& options_;
    std::span<const IndexPair> pairs_;
    const Samples &source_, &target_;
    std::vector<Triangle> triangles_;  ///< of rows of the pairing
    std::vector<Index> alive_, born_;  ///< ids
    std::vector<Index> triangle_;      ///< by id
    std::vector<int> first_key_, last_key_;
    std::vector<int> hidden_since_;  ///< by pair, the key; 0: shown
    // Who lay near at the last time that it was asked, as numbers (see number_of): most of them
    // still do, and then the tree needn't be asked again.
    std::vector<std::array<Index, kRemembered>> covering_;  ///< by triangle, some of its samples
    std::vector<std::array<Index, kNearest>> nearest_;      ///< by number, the k nearest
    std::vector<Index> row_;                                ///< by id, in the tree; −1: in none
    Normalization unit_{};
    Values spacing_;  ///< by pair
    double t_ = 0.0;
    int key_ = 0;
};

Resampling::Resampling(const Cloud& source, const Cloud& target, std::span<const IndexPair> pairs,
                       const FrameAt& frame_at, const ResamplingOptions& options,
                       Progress& progress)
    : options_(options) {
    const auto check = [](double value, double least, double most, const char* name) {
        if (!(value >= least && value <= most))
            throw OptionError(
                name, "a number from " + std::to_string(least) + " to " + std::to_string(most),
                std::to_string(value), "Choose a value from that range.");
    };
    check(options.omega, 0.0, 2.0, "omega");
    check(options.spacing, 0.25, 4.0, "resample_spacing");
    if (options.crowding) check(*options.crowding, 1.5, 100.0, "crowding");

    const Samples from(source,
                       standing_for(pairs, &IndexPair::source, &IndexPair::target, source, target),
                       progress, 0.0, 0.15);
    const Samples to(target,
                     standing_for(pairs, &IndexPair::target, &IndexPair::source, target, source),
                     progress, 0.15, 0.3);
    const std::vector<Index>&by_source = from.pairs, &by_target = to.pairs;
    source_size_ = from.size;
    target_size_ = to.size;
    const auto count = static_cast<Index>(pairs.size());
    for (Values* values : {&source_spacing_, &target_spacing_, &source_density_, &target_density_})
        values->resize(count);
    std::vector<Triangle> triangles;
    triangles.reserve(from.triangles.size() + to.triangles.size() + pairs.size() / 2);
    // The lowest row first, the way round as it is. One that goes round the other way on the other
    // model is in twice: either is made where it shows its front.
    const auto add = [&](Triangle corners) {
        const auto [lowest, highest] = std::ranges::minmax(corners);
        if (lowest == highest) return;
        const auto& [a, b, c] = corners;
        if (a == b || b == c || c == a)
            corners = {lowest, lowest, highest};
        else
            std::ranges::rotate(corners, std::ranges::min_element(corners));
        triangles.push_back(corners);
    };
    for (Index i = 0; i < count; ++i) {
        const auto [s, d] = pairs[slot(i)];
        source_spacing_[i] = from.spacing[s] * from.unit.scale;
        target_spacing_[i] = to.spacing[d] * to.unit.scale;
        source_density_[i] = from.density[s];
        target_density_[i] = to.density[d];
        // A point with several partners holds all of them together.
        const Index a = by_source[slot(s)], b = by_target[slot(d)];
        add({i, a, b});
        add({i, b, a});
    }
    for (const Samples* end : {&from, &to})
        for (Triangle corners : end->triangles) {
            if (!shows_front(end->positions, end->normals, corners))
                std::swap(corners[1], corners[2]);
            for (Index& corner : corners) corner = end->pairs[slot(corner)];
            add(corners);
        }
    std::ranges::sort(triangles);
    const auto unique = std::ranges::unique(triangles);
    triangles.erase(unique.begin(), unique.end());

    if (options.omega == 0.0 && !options.crowding) return;
    ResamplingBuilder builder(*this, pairs, from, to, std::move(triangles));
    for (int key = 1; key < kKeys; ++key) builder.step(key, frame_at, progress);
    builder.finish();
}

double Resampling::unit_area(double t) const {
    const double size = (1.0 - t) * source_size_ + t * target_size_;
    return size * size;
}

Resampling::Alive Resampling::at(double t, const LiftedCloud& frame, Progress& progress) const {
    Alive alive;
    for (std::size_t i = 0; i < points_.size(); ++i)
        if (points_[i].life.share(t) > 0.0) alive.ids.push_back(static_cast<Index>(i));
    const auto count = static_cast<Index>(alive.ids.size());
    alive.share.resize(count);
    alive.positions.resize(count, 3);
    alive.normals.resize(count, 3);
    if (count == 0) return alive;

    const Normalization unit = normalization(frame.positions);
    const Positions positions = unit.apply(frame.positions);
    const KdTree<3> tree(positions);
    MlsOptions mls = options_.mls;
    if (mls.width) *mls.width /= unit.scale;
    constexpr Index kChunk = 32;
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            MlsProjection project(tree, frame.normals, mls);
            for (Index i = begin; i < end; ++i) {
                const InsertedPoint& point = points_[slot(alive.ids[slot(i)])];
                Vector3 place = blend(positions, point);
                Vector3 normal = blend_normals(positions, frame.normals, point);
                double wanted = 0.0;
                for (std::size_t c = 0; c < 3; ++c)
                    wanted += point.weights[c] * spacing(point.pairs[c], t) / unit.scale;
                const double apart = edge_length(positions, point.pairs);
                const double coherence =
                    std::clamp((kTorn - apart / wanted) / (kTorn - kCoherent), 0.0, 1.0);
                if (coherence > 0.0) {
                    const MlsFoot foot =
                        project(place, normal, std::clamp(apart, wanted, kWidest * wanted));
                    place += coherence * (foot.position - place);
                    normal = (normal + coherence * (foot.normal - normal)).normalized();
                }
                alive.share[i] = point.life.share(t);
                alive.positions.row(i) = (place * unit.scale + unit.center).transpose();
                alive.normals.row(i) = normal.transpose();
            }
        },
        0.0, 1.0, kChunk);
    return alive;
}

Values Resampling::pair_shares(double t) const {
    Values shares = Values::Ones(source_spacing_.size());
    for (const HiddenPair& hidden : hidden_)
        shares[hidden.pair] = std::min(shares[hidden.pair], 1.0 - hidden.life.share(t));
    return shares;
}

}  // namespace pointmorph

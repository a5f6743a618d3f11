// Where points are missing in one frame of a morph. Internal.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "base/unset.hpp"
#include "cloud/moving_tree.hpp"
#include "frames/gap_triangles.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/frames/resampling.hpp"

namespace pointmorph {

/// A frame at one time, in a unit ball: rows are all pairs, then the inserted points that are
/// alive.
struct FrameSample {
    double t;
    Normalization unit;
    Index pairs;                        ///< how many rows are pairs
    std::vector<InsertedPoint> points;  ///< those of the rows after the pairs
    std::vector<Index> ids;             ///< of the points
    std::vector<Index> rows;            ///< by id; −1: not alive
    Values spacing;                     ///< of new points, by pair
    Positions positions;
    Normals normals;
    UnsetVector<RoughCorner> rough;    ///< places, with spacings of pairs
    const MovingTree* tree = nullptr;  ///< over the rows, once it has followed them

    /// `points` are alive and have these `ids`, of `count` in all.
    FrameSample(double t, const OrientedPoints& frame, const Resampling& resampling,
                std::vector<InsertedPoint> points, std::vector<Index> ids, std::size_t count);
    FrameSample(FrameSample&&) = delete;

    double spacing_at(const InsertedPoint& point) const;
};

/// Finds a point on the same side of the surface within a radius. One object per thread.
class NeighborSearch {
public:
    /// Whether there is one.
    bool any(const KdTree<3>& tree, const Normals& normals, const Vector3& place,
             const Vector3& normal, double radius) {
        tree.within_unsorted(place.data(), radius, ball_);
        return std::ranges::any_of(
            ball_, [&](const auto& found) { return normals.row(found.first).dot(normal) > 0.0; });
    }

    /// The nearest row for which `counts(row)` is true, −1 where there is none.
    template <class Counts>
    Index nearest(const FrameSample& sample, const Vector3& place, const Vector3& normal,
                  double radius, Counts&& counts) {
        return sample.tree->nearest_of(
            place.data(), radius,
            [&](Index row) { return sample.normals.row(row).dot(normal) > 0.0 && counts(row); },
            ball_);
    }

private:
    std::vector<std::pair<Index, double>> ball_;
};

/// In the spacing of new points: discs of one spacing leave a gap where no point lies within kGap,
/// and none where every place has a point within kEmpty.
constexpr double kEmpty = 0.85, kGap = 1.0;

/// k/r² at a row, with the distance r to its k-th nearest.
double density(const FrameSample& sample, Index row);

/// One with corners so far apart that discs around them may leave a gap.
struct OpenTriangle {
    Index number;
    bool leaves_gap;  ///< discs of one spacing may, too
    double samples;   ///< to be tried in it, if so
};

/// Finds empty places: in triangles of which a corner, or an inserted point, fails the density
/// test, and in those in which discs leave a gap that not both models have. Remembers what lay
/// near, and so is quick where consecutive frames differ little.
class MissingPoints {
public:
    struct Place {
        Index triangle;
        InsertedPoint point;
    };

    /// Keeps references to all. `chosen`, by id, are the points that there have been so far.
    MissingPoints(const Resampling& resampling, std::span<const IndexPair> pairs,
                  const EndSamples& source, const EndSamples& target,
                  const std::vector<Place>& chosen, Progress& progress);

    /// Needs no tree. One of the threads first does what is to be done `meanwhile`.
    std::vector<OpenTriangle> open_triangles(const FrameSample& sample,
                                             const std::function<void()>& meanwhile,
                                             Progress& progress) const;

    /// `open` are the open triangles. Points marked `dead` (by row after the pairs) cover no place
    /// any more.
    std::vector<Place> operator()(const FrameSample& sample, std::span<const OpenTriangle> open,
                                  std::span<const char> dead, Progress& progress);

private:
    static constexpr std::size_t kNearest = to_size(Resampling::kDensityNeighbors);
    static constexpr std::size_t kRemembered = 4;

    /// Of points: the pair, or the number of pairs plus the id.
    using Numbers = std::array<Index, kNearest>;

    struct Gap {
        Index triangle;
        bool lacks_points;  ///< by the density test; else by the gap that discs leave
    };

    double samples_wanted(const FrameSample& sample, const GapTriangle& corners) const;
    bool is_too_low(const FrameSample& sample, double density, Index row) const;
    bool is_dense_by(const FrameSample& sample, Index row, const Numbers& near) const;
    bool is_dense(const FrameSample& sample, Index row);
    bool is_sparse(const FrameSample& sample, Index row);
    std::vector<char> sparse_rows(const FrameSample& sample, std::span<const OpenTriangle> open,
                                  std::span<const char> dead, Progress& progress);
    std::vector<Gap> gaps(const FrameSample& sample, std::span<const OpenTriangle> open,
                          std::span<const char> dead, Progress& progress);
    double step_in(const FrameSample& sample, const GapTriangle& corners) const;
    bool is_covered_at_an_end(const InsertedPoint& point, NeighborSearch& find) const;
    void each_empty(const FrameSample& sample, Index triangle, double radius,
                    std::span<const char> dead, NeighborSearch& find,
                    const std::function<bool(const InsertedPoint&)>& take);

    const Resampling& resampling_;
    std::span<const IndexPair> pairs_;
    const EndSamples &source_, &target_;
    const std::vector<Place>& chosen_;
    std::vector<GapTriangle> triangles_;
    double coarser_ = 1.0;  ///< than elsewhere, samples in triangles lie
    // What lay near when it was last asked, as pairs, or the number of pairs plus the id. Most
    // still does, and then the tree needn't be asked again. −1: none.
    std::vector<std::array<Index, kRemembered>>
        covering_;                  ///< by triangle, for some of its samples
    std::vector<Numbers> nearest_;  ///< by pair, then id: k that are near
};

}  // namespace pointmorph

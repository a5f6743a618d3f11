// Where points are missing in one frame of a morph. Not a part of the library.
#pragma once

#include <array>
#include <span>
#include <utility>
#include <vector>

#include "frames/gap_triangles.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/frames/resampling.hpp"

namespace pointmorph {

/// All pairs at a time, then the new points that are alive, as rows in a unit ball.
struct Moment {
    double t;
    Normalization unit;
    Index pairs;                        ///< that many rows are pairs
    std::vector<InsertedPoint> points;  ///< of the rows after them
    std::vector<Index> ids;             ///< of these
    std::vector<Index> rows;            ///< by id; −1: not alive
    Values spacing;                     ///< of new points, by pair
    Positions positions;
    Normals normals;
    KdTree<3> tree;  ///< over the rows

    /// `points` are those alive, `ids` theirs, of `count` in all.
    Moment(double t, const OrientedPoints& frame, const Resampling& resampling,
           std::vector<InsertedPoint> points, std::vector<Index> ids, std::size_t count);
    Moment(Moment&&) = delete;  // the tree refers to the positions

    double spacing_at(const InsertedPoint& point) const;
};

/// Finds a point on the same side of the surface within a radius. One object a thread.
class NeighborSearch {
public:
    /// The nearest row for which `counts(row)` is true, −1 where there is none.
    template <class Counts>
    Index operator()(const KdTree<3>& tree, const Normals& normals, const Vector3& place,
                     const Vector3& normal, double radius, Counts&& counts) {
        tree.within(place.data(), radius, ball_);
        for (const auto& [row, squared] : ball_)
            if (normals.row(row).dot(normal) > 0.0 && counts(row)) return row;
        return -1;
    }

private:
    std::vector<std::pair<Index, double>> ball_;
};

/// In the spacing of new points: where no point lies within kGap, discs of one spacing leave a gap;
/// where every place has one within kEmpty they don't.
constexpr double kEmpty = 0.85, kGap = 1.0;

/// k/r² at a row, with the distance r to its k-th nearest.
double density(const Moment& moment, Index row);

/// Finds empty places in triangles of which a corner, or a point that was put into them, fails the
/// test of the density, and in those in which discs leave a gap that not both models have.
/// Remembers who was near, and so is quick where moments that follow each other differ little.
class MissingPoints {
public:
    struct Place {
        Index sheet;  ///< which triangle
        InsertedPoint point;
    };

    /// Keeps references to all. `chosen`, by id, are the points that there have been so far.
    MissingPoints(const Resampling& resampling, std::span<const IndexPair> pairs,
                  const EndSamples& source, const EndSamples& target,
                  const std::vector<Place>& chosen);

    /// Of the points that are alive some may be `dead` (by row after the pairs): they cover no
    /// place any more.
    std::vector<Place> operator()(const Moment& moment, std::span<const char> dead,
                                  Progress& progress);

private:
    static constexpr std::size_t kNearest = to_size(Resampling::kDensityNeighbors);
    static constexpr std::size_t kRemembered = 4;

    struct Gap {
        Index sheet;
        bool lacks_points;  ///< by the density; else only if discs leave a gap in it
    };

    std::vector<Index> open_sheets(const Moment& moment, Progress& progress) const;
    bool is_wider_than(const Moment& moment, Index sheet, double radius) const;
    bool is_too_low(const Moment& moment, double density, Index row) const;
    bool is_dense(const Moment& moment, Index row) const;
    bool is_sparse(const Moment& moment, Index row);
    std::vector<char> sparse_rows(const Moment& moment, std::span<const Index> open,
                                  std::span<const char> dead, Progress& progress);
    std::vector<Gap> gaps(const Moment& moment, std::span<const char> dead, Progress& progress);
    bool is_covered_at_an_end(const InsertedPoint& point, NeighborSearch& find) const;
    template <class Take>
    void each_empty(const Moment& moment, Index sheet, double radius, std::span<const char> dead,
                    NeighborSearch& find, Take&& take);

    const Resampling& resampling_;
    std::span<const IndexPair> pairs_;
    const EndSamples &source_, &target_;
    const std::vector<Place>& chosen_;
    std::vector<Sheet> sheets_;
    // Who lay near when it was last asked, as pairs, or the number of pairs plus the id: most of
    // them still do, and then the tree needn't be asked again. −1: none.
    std::vector<std::array<Index, kRemembered>> covering_;  ///< by sheet, some of its samples
    std::vector<std::array<Index, kNearest>> nearest_;      ///< by pair, then id: the k nearest
};

}  // namespace pointmorph

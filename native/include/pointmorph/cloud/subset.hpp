// Stage `subset`: evenly spread points of a cloud that stand for all of it.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// Surface area that the samples of a cloud stand for, from the distance to their 12th neighbor;
/// measured at no more than some hundred points. 0 only where all points coincide.
double estimated_area(const KdTree<3>& tree);

/// The same where the nearest neighbors of every point, 12 or more and ascending by distance, are
/// known.
double estimated_area(const Positions& positions, const Neighborhoods& nearest);

/// Points of a cloud no two of which on the same side of the surface lie closer than `radius`,
/// while every point has one that close.
struct Subset {
    std::vector<Index> rows;  ///< `required` first, in their order; then ascending
    double radius = 0.0;      ///< plain distance
};

/// Poisson-disk sampling (dart throwing over the cloud's own points) with the radius that gives
/// about `count` points. `required` rows are always in it, however close, each once. Two points
/// whose normals are opposed don't keep each other away: both sides of an ear get their own.
/// Where the cloud has no more than `count` points, all places, each once, and the radius that
/// would spread as many evenly. `nearest`, where they are known, are the nearest neighbors of
/// every point, 12 or more and ascending by distance; the result is the same.
Subset poisson_disk_subset(const KdTree<3>& tree, const Normals& normals,
                           std::span<const Index> required, Index count, Progress& progress,
                           const Neighborhoods* nearest = nullptr);

/// A subset, and which of its points is the nearest one of each point of the cloud: its place in
/// `subset.rows`; -1 where that can't be told without looking closely, as several are as near, or
/// points whose normals are opposed lie within the radius.
struct SubsetCells {
    Subset subset;
    std::vector<Index> nearest;
};

/// poisson_disk_subset(), which comes by what is nearest.
SubsetCells poisson_disk_cells(const KdTree<3>& tree, const Normals& normals,
                               std::span<const Index> required, Index count, Progress& progress);

}  // namespace pointmorph

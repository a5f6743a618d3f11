// Stage `subset`: evenly spread points of a cloud that stand for all of it.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "pointmorph/kd_tree.hpp"
#include "pointmorph/neighborhoods.hpp"
#include "pointmorph/progress.hpp"
#include "pointmorph/types.hpp"

namespace pointmorph {

/// Surface area that the samples of a cloud stand for, from the distance to their 12th neighbour;
/// measured at no more than some hundred points. 0 only where all points coincide.
double estimated_area(const KdTree<3>& tree);

/// The same where the nearest neighbours of every point, 12 or more and ascending by distance, are
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
/// would spread as many evenly. `area`, where it is known, is estimated_area().
Subset blue_noise_subset(const KdTree<3>& tree, const Normals& normals,
                         std::span<const Index> required, Index count, Progress& progress,
                         std::optional<double> area = std::nullopt);

}  // namespace pointmorph

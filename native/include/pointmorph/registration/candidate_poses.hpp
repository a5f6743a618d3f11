// A part of stage `pose`: the poses that two shapes are registered from.
#pragma once

#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/pose.hpp"

namespace pointmorph {

/// Rotations of the target onto the source, both of unit area, with the translations between their
/// middles: the 24 that take principal axes to principal axes, as far as the spreads along them
/// agree, none, and the least rotation or best fit by two or more features. None that contradicts
/// the features. At least one.
std::vector<Similarity> candidate_poses(const CoarsePair& shapes, const PoseOptions& options);

/// Rotations by `angle` to either side about each of a shape's principal axes.
std::vector<Similarity> tilts(const CoarseShape& shape, double angle);

}  // namespace pointmorph

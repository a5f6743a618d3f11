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

/// Half a turn about each of a shape's principal axes, brought to where it takes the shape closest
/// to itself: a person's chest to its back, its head to its feet.
std::vector<Similarity> half_turns(const CoarseShape& shape);

/// Those of the poses that bring the features about as close together as the best of them does.
std::vector<Similarity> agreeing_with_features(const CoarsePair& shapes,
                                               std::vector<Similarity> poses,
                                               const PoseOptions& options);

}  // namespace pointmorph

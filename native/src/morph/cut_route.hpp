// The paper's way from two closed shapes to pairs of points: each cut into two patches, patches
// onto disks, disks aligned, merged and paired.
#pragma once

#include "morph/prepared_shape.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/morph/morph.hpp"

namespace pointmorph {

/// Both disks of a shape, glued along their rims, are the unit sphere: the left patch above, the
/// right one below, the curve on the equator (inverse stereographic projection).
struct CutRoute {
    KdTree<3>::Points source, target;  ///< on the unit sphere, rows of the sides
    Pairing pairs;
};

/// `features`, in canonical order, are rows of the sides; see point_features(). Fills in what the
/// report says of the curves, parameterization and alignment. Throws FeatureError for a loop that
/// can't cut, TopologyError, and the errors of the stages.
CutRoute match_in_patches(Side& source, Side& target, const MorphInput& input,
                          std::span<const Feature> features, const MorphOptions& options,
                          MorphReport& report, Progress& progress);

}  // namespace pointmorph

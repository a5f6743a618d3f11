// Stage `lift`: from the images of some points of a cloud to those of all its points.
#pragma once

#include "pointmorph/coarse_shape.hpp"
#include "pointmorph/deformation.hpp"
#include "pointmorph/progress.hpp"
#include "pointmorph/types.hpp"

namespace pointmorph {

/// Where all points of a cloud go, and their normals.
struct LiftedCloud {
    Positions positions;  ///< #points by 3
    Normals normals;      ///< #points by 3, unit length
};

/// Every point follows the affine maps of the nearest coarse points on its side of the surface,
/// with weights that fall with the distance and fade to 0 at the farthest, so that the result is
/// continuous; a coarse point goes where `coarse` has it, up to about a hundredth of a spacing.
/// `shape` has been made from the cloud.
LiftedCloud lifted(const CoarseShape& shape, const DeformedCloud& coarse,
                   const Positions& positions, const Normals& normals, Progress& progress);

}  // namespace pointmorph

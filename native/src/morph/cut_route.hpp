// The paper's route from two closed shapes to pairs of points: each cut into two patches, patches
// onto disks, disks aligned, merged and paired. Not for callers of the library.
#pragma once

#include <span>
#include <string>

#include "morph/patch_cloud.hpp"
#include "morph/route_result.hpp"
#include "pointmorph/disk/decomposition.hpp"

namespace pointmorph {

struct CutRouteOptions {
    DecompositionOptions decomposition;
    PatchOptions patches;
};

/// Along the features called `loop`, in this order. The common domain is the unit sphere, to which
/// both disks are glued along their rims: the left patch above, the right one below, the curve on
/// the equator (inverse stereographic projection). Throws FeatureError for a loop that can't cut,
/// TopologyError, and the errors of the stages.
RouteResult match_in_patches(const RouteInput& input, std::span<const std::string> loop,
                             const CutRouteOptions& options, Progress& progress);

}  // namespace pointmorph

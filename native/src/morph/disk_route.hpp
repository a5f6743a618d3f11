// The paper's route from two open patches to pairs of points: both onto the unit disk, aligned
// there, merged and paired. Not for callers of the library.
#pragma once

#include "morph/route_result.hpp"
#include "pointmorph/disk/alignment.hpp"
#include "pointmorph/disk/parameterization.hpp"

namespace pointmorph {

struct DiskRouteOptions {
    ParameterizationOptions parameterization;
    AlignmentOptions alignment;
    PairingOptions pairing;
};

/// A shape with estimated normals counts as inside out where the features show that they point
/// inward. Throws TopologyError for closed surfaces, and the errors of the stages.
RouteResult match_in_disk(const RouteInput& input, const Boundary& source_boundary,
                          const Boundary& target_boundary, const DiskRouteOptions& options,
                          Progress& progress);

}  // namespace pointmorph

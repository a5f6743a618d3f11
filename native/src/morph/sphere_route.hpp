// The route from two closed shapes of genus 0 to pairs of points without a cut (the paper's future
// work): both onto the unit sphere, aligned there, merged and paired. Not for callers of the
// library.
#pragma once

#include "morph/route_result.hpp"
#include "pointmorph/sphere/spherical_alignment.hpp"
#include "pointmorph/sphere/spherical_parameterization.hpp"

namespace pointmorph {

struct SphereRouteOptions {
    SphericalOptions parameterization;
    SphericalAlignmentOptions alignment;
    PairingOptions pairing;
};

/// Throws the errors of the stages.
RouteResult match_on_sphere(const RouteInput& input, const SphereRouteOptions& options,
                            Progress& progress);

}  // namespace pointmorph

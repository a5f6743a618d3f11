// What one cloud lacks of the other, and no image comes near: the map back folds it onto what lies
// there, and here it joins the border where it is missing. Not for callers of the library.
#pragma once

#include <span>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "pointmorph/surface/features.hpp"
#include "pointmorph/surface/sampled_surface.hpp"

namespace pointmorph {

/// A cloud, and the rows along borders where it ends while the other one goes on.
struct EndingCloud {
    const SampledSurface& surface;
    std::span<const Index> ends;
};

/// How many points joined an end.
struct LostPoints {
    Index of_source = 0, of_target = 0;
};

/// Changes what one of the clouds lacks: points of the other that no image comes near, next to what
/// lies at an end. They go to that end, and are paired with it. What has a feature stays. Without
/// ends, nothing changes; else the stage "missing parts" is entered, and goes on. Throws Cancelled.
LostPoints send_lost_parts_to_ends(Refinement& map, const EndingCloud& source,
                                   const EndingCloud& target, std::span<const Feature> features,
                                   Progress& progress);

}  // namespace pointmorph

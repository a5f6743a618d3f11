// Settings for tests of whole maps that also run where sanitizers watch every access.
#pragma once

#include "pointmorph/registration/refinement.hpp"
#include "watched.hpp"

namespace pointmorph {

/// Coarser shapes than by default, and fewer poses that are followed further: the same code, run
/// less often.
inline RefinementOptions lighter_refinement() {
    RefinementOptions options;
    options.coarse = {400, {30, 100}, {}};
    options.pose.points = 300;
    options.pose.semifinalists = 4;
    options.pose.effort.variants = options.pose.second_effort.variants = 4;
    return options;
}

/// The defaults, but lighter_refinement() where sanitizers watch.
inline RefinementOptions lighter_where_watched() {
    return is_watched() ? lighter_refinement() : RefinementOptions{};
}

}  // namespace pointmorph

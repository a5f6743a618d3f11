// Settings for tests of whole maps that also run where sanitizers watch every access.
#pragma once

#include "pointmorph/registration/refinement.hpp"
#include "watched.hpp"

namespace pointmorph {

/// The defaults, but with coarser shapes where sanitizers watch, and fewer poses that are followed
/// further: the same code, run less often.
inline RefinementOptions lighter_where_watched() {
    RefinementOptions options;
    if (!is_watched()) return options;
    options.coarse = {400, {30, 100}, {}};
    options.pose.points = 300;
    options.pose.semifinalists = 4;
    options.pose.effort.variants = options.pose.second_effort.variants = 4;
    return options;
}

}  // namespace pointmorph

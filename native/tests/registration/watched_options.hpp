// Settings for tests of whole maps that also run where sanitizers watch every access.
#pragma once

#include "pointmorph/registration/refinement.hpp"
#include "watched.hpp"

namespace pointmorph {

/// The defaults, but with coarser shapes where sanitizers watch: the same code, run less often.
inline RefinementOptions lighter_where_watched() {
    RefinementOptions options;
    if (is_watched()) options.coarse = {600, {40, 150}, {}};
    return options;
}

}  // namespace pointmorph

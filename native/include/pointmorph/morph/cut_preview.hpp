// The cut of a closed shape along a loop, to look at before it is used.
#pragma once

#include <span>
#include <string>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/disk/decomposition.hpp"
#include "pointmorph/morph/morph_options.hpp"

namespace pointmorph {

/// `loop`: given rows, called `names`. The result is in given rows and lengths. Normals are
/// estimated where there are none. Throws what Morph throws for this cloud and loop.
Decomposition preview_cut(const Cloud& cloud, std::span<const Index> loop,
                          std::span<const std::string> names, const MorphOptions& options,
                          Progress& progress);

}  // namespace pointmorph

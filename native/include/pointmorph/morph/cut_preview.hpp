// The cut of a closed shape along a loop, to look at before it is used.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/disk/decomposition.hpp"
#include "pointmorph/morph/morph_options.hpp"

namespace pointmorph {

/// Given rows and lengths; see Decomposition.
struct CutPreview {
    SurfaceCurve curve;
    std::vector<Index> corners;
    std::vector<Patch> patches;
};

/// `loop`: given rows, called `names`. Normals are estimated where there are none. Throws what
/// Morph throws for this cloud and loop.
CutPreview preview_cut(const Cloud& cloud, std::span<const Index> loop,
                       std::span<const std::string> names, const MorphOptions& options,
                       Progress& progress);

}  // namespace pointmorph

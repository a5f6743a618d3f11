// Coarse shapes for the tests of poses.
#pragma once

#include <vector>

#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/coarse_shape.hpp"

namespace pointmorph {

/// Of 1,500 points at most; `required` rows are among them.
inline CoarseShape coarse_of_cloud(const Positions& positions, const Normals& normals,
                                   const std::vector<Index>& required = {}) {
    Progress progress;
    CoarseShapeOptions options;
    options.points = 1500;
    return coarse_shape(KdTree<3>(positions), normals, required, options, progress);
}

}  // namespace pointmorph

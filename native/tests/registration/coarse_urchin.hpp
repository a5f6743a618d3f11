// A ball with spikes as a coarse shape, for the tests of extremities and anchors.
#pragma once

#include <vector>

#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "shapes.hpp"

namespace pointmorph {

/// 2,000 of `count` points: so many that they are even on the spikes too.
inline CoarseShape coarse_urchin(Index count, const std::vector<Vector3>& spikes, unsigned seed) {
    const shapes::Urchin urchin(count, spikes, seed);
    Progress progress;
    CoarseShapeOptions options;
    options.points = 2000;
    return coarse_shape(KdTree<3>(urchin.positions), urchin.normals, {}, options, progress);
}

}  // namespace pointmorph

// Where a coarse shape ends while the other one goes on, and what of the other lies beyond. Not for
// callers of the library.
#pragma once

#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/deformation.hpp"

namespace pointmorph {

/// The coarse rows that CoarseShape::ends marks.
std::vector<Index> end_rows(const CoarseShape& shape);

/// 1 for nodes that no image of the other shape's points comes near to, where they hang together
/// with the images of its ends (`rim`): it stops there, and this one goes on. `nodes` are their
/// positions.
std::vector<char> beyond_rim(const DeformationGraph& graph, const Positions& nodes,
                             const Positions& images, const Positions& rim);

}  // namespace pointmorph

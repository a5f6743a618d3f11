// Memory for neighborhoods, which the thread that asks for it touches first: for large clouds, that
// takes as long as a tenth of the search, so it is worth doing beside something else. Not for
// callers of the library.
#pragma once

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// What nearest_neighbors() fills for `count` points.
Neighborhoods room_for_neighbors(Index count, Index k);

/// As nearest_neighbors() without `room`, which is that for the points of the tree.
Neighborhoods nearest_neighbors(const KdTree<3>& tree, Neighborhoods room, Progress& progress);

}  // namespace pointmorph

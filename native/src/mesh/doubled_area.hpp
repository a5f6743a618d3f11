// Area and direction of a triangle at once. Not for callers of the library.
#pragma once

#include <Eigen/Geometry>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Along the normal of the triangle of three rows, twice as long as its area.
inline Eigen::RowVector3d doubled_area(const Positions& p, Index a, Index b, Index c) {
    const Eigen::RowVector3d u = p.row(b) - p.row(a), v = p.row(c) - p.row(a);
    return u.cross(v);
}

}  // namespace pointmorph

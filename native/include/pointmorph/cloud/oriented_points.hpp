// Points of a surface and which way it faces at them.
#pragma once

#include "pointmorph/base/types.hpp"

namespace pointmorph {

struct OrientedPoints {
    Positions positions;  ///< #points by 3
    Normals normals;      ///< #points by 3, unit length
};

/// Refers to them: the caller keeps them alive.
struct OrientedView {
    const Positions& positions;  ///< #points by 3
    const Normals& normals;      ///< #points by 3, unit length
};

/// Of anything that has positions and normals.
template <class Shape>
OrientedView oriented(const Shape& shape) {
    return {shape.positions, shape.normals};
}

}  // namespace pointmorph

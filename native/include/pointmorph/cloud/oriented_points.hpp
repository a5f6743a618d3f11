// Points of a surface and which way it faces at them.
#pragma once

#include "pointmorph/base/types.hpp"

namespace pointmorph {

struct OrientedPoints {
    Positions positions;  ///< #points by 3
    Normals normals;      ///< #points by 3, unit length
};

}  // namespace pointmorph

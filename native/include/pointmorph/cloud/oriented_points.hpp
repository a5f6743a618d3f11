// Points of a surface and which way it faces at them.
#pragma once

#include <array>
#include <cmath>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// A closed surface of unit area that encloses less than this, up to its sign, doesn't say where
/// its inside is; a ball encloses 0.09.
inline constexpr double kSomeVolume = 0.005;

/// Whether the normals of a closed surface face its inside, by its volume, which is negative then.
inline bool faces_inside(double volume, double area) {
    return volume <= -kSomeVolume * area * std::sqrt(area);
}

struct OrientedPoints {
    Positions positions;  ///< #points by 3
    Normals normals;      ///< #points by 3, unit length
};

/// A point and its normal side by side, for those who read points in any order.
struct OrientedPoint {
    std::array<double, 3> position;
    std::array<float, 4> normal;  ///< of unit length; the last is 0
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

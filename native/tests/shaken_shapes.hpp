// Shapes that nothing lies even on: points moved at random, with a seed.
#pragma once

#include <cmath>
#include <random>

#include "pointmorph/base/types.hpp"
#include "shapes.hpp"

namespace pointmorph::shapes {

/// `grid(side)` with each point moved within its plane by up to `by` of 1 / side.
inline Positions shaken_grid(Index side, double by) {
    Positions points = grid(side);
    std::mt19937_64 random(2);
    std::uniform_real_distribution<double> shake(-by / side, by / side);
    for (Index i = 0; i < points.rows(); ++i)
        points.row(i).head<2>() += Eigen::RowVector2d(shake(random), shake(random));
    return points;
}

/// The normals of a plane z = const.
inline Normals up(Eigen::Index rows) {
    return Eigen::RowVector3d(0, 0, 1).replicate(rows, 1);
}

/// Smooth noise: sines of size `size`, of about `frequency` radians a unit.
inline Positions waved(const Positions& places, double size, unsigned seed, int waves,
                       double frequency) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    Positions result = places;
    for (int wave = 0; wave < waves; ++wave) {
        const Vector3 way(normal(random), normal(random), normal(random));
        const Vector3 along = frequency * Vector3(normal(random), normal(random), normal(random));
        const double phase = 3.0 * normal(random);
        for (Index v = 0; v < places.rows(); ++v)
            result.row(v) += size * std::sin(along.dot(places.row(v)) + phase) * way.transpose();
    }
    return result;
}

}  // namespace pointmorph::shapes

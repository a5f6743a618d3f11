// Analytic shapes that the tests sample, with a fixed seed.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph::shapes {

/// #u·#v points of the grid [−1, 1]², z = 0; row u·side + v. Its border is a closed loop.
inline Positions grid(Index side) {
    Positions p(side * side, 3);
    for (Index u = 0; u < side; ++u)
        for (Index v = 0; v < side; ++v)
            p.row(u * side + v) << 2.0 * u / (side - 1) - 1.0, 2.0 * v / (side - 1) - 1.0, 0.0;
    return p;
}

/// Normals of a plane seen from +z.
inline Normals upward(Index count) {
    return Vector3::UnitZ().transpose().replicate(count, 1);
}

/// Rows of the border of `grid(side)`, anticlockwise seen from +z.
inline std::vector<Index> grid_border(Index side) {
    std::vector<Index> loop;
    for (Index u = 0; u < side - 1; ++u) loop.push_back(u * side);
    for (Index v = 0; v < side - 1; ++v) loop.push_back((side - 1) * side + v);
    for (Index u = side - 1; u > 0; --u) loop.push_back(u * side + side - 1);
    for (Index v = side - 1; v > 0; --v) loop.push_back(v);
    return loop;
}

/// An even spiral of points on the unit sphere from the pole down to height `lowest`
/// (−1: all of it; 0: the upper half).
inline Positions sphere(Index count, double lowest = -1.0) {
    Positions p(count, 3);
    const double golden = std::numbers::pi * (3.0 - std::sqrt(5.0));
    for (Index i = 0; i < count; ++i) {
        const double z = 1.0 - (1.0 - lowest) * (i + 0.5) / count;
        const double r = std::sqrt(std::max(0.0, 1.0 - z * z));
        p.row(i) << r * std::cos(golden * i), r * std::sin(golden * i), z;
    }
    return p;
}

/// Points uniform by area on the torus with radii 1 and `tube`.
inline Positions torus(Index count, double tube, unsigned seed = 1) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    Positions p(count, 3);
    for (Index i = 0; i < count;) {
        const double a = 2 * std::numbers::pi * uniform(random);
        const double b = 2 * std::numbers::pi * uniform(random);
        if (uniform(random) * (1 + tube) > 1 + tube * std::cos(b)) continue;
        const double r = 1 + tube * std::cos(b);
        p.row(i++) << r * std::cos(a), r * std::sin(a), tube * std::sin(b);
    }
    return p;
}

/// Two tori side by side, merged: points inside the other one are left out.
inline Positions double_torus(Index count, unsigned seed = 1) {
    const auto inside = [](double x, double y, double z) {
        const double ring = std::hypot(x, y) - 1.0;
        return ring * ring + z * z < 0.3 * 0.3 - 1e-9;
    };
    std::vector<Eigen::RowVector3d> rows;
    for (const double side : {-1.1, 1.1}) {
        const Positions ring_points = torus(count, 0.3, side < 0 ? seed : seed + 1);
        for (Eigen::Index i = 0; i < ring_points.rows(); ++i)
            if (!inside(ring_points(i, 0) + 2 * side, ring_points(i, 1), ring_points(i, 2)))
                rows.emplace_back(ring_points.row(i) + Eigen::RowVector3d(side, 0, 0));
    }
    Positions all(static_cast<Eigen::Index>(rows.size()), 3);
    for (std::size_t i = 0; i < rows.size(); ++i) all.row(static_cast<Eigen::Index>(i)) = rows[i];
    return all;
}

/// Independent uniform points of the cube [−1, 1]³.
inline Positions cube_noise(Index count, unsigned seed = 1) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    Positions p(count, 3);
    for (Index i = 0; i < count; ++i) p.row(i) << uniform(random), uniform(random), uniform(random);
    return p;
}

/// A random rotation.
inline Matrix3 rotation(unsigned seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    const Eigen::Quaterniond q(normal(random), normal(random), normal(random), normal(random));
    return q.normalized().toRotationMatrix();
}

/// A random permutation of 0 … count − 1.
inline std::vector<Index> permutation(Index count, unsigned seed) {
    std::vector<Index> order(to_size(count));
    for (Index i = 0; i < count; ++i) order[to_size(i)] = i;
    std::mt19937_64 random(seed);
    for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random() % i]);
    return order;
}

/// A ball of radius ½ with a spike in the direction of each of `spikes`, as long as that is, and
/// roughly its normals.
struct Urchin {
    Positions positions;
    Normals normals;

    Urchin(Index count, const std::vector<Vector3>& spikes, unsigned seed)
        : positions(sphere(count) * rotation(seed).transpose()), normals(positions) {
        for (Index i = 0; i < count; ++i) {
            double radius = 0.5;
            for (const Vector3& spike : spikes)
                radius += spike.norm() *
                          std::exp((positions.row(i).dot(spike.normalized()) - 1.0) / 0.03);
            positions.row(i) *= radius;
        }
    }
};

/// The row of the point that is nearest to `q`, by looking at all.
inline Index nearest_row(const Positions& p, const Vector3& q) {
    Index best;
    (p.rowwise() - q.transpose()).rowwise().squaredNorm().minCoeff(&best);
    return best;
}

}  // namespace pointmorph::shapes

// Meshes that the tests use, with polygons as modelers make them.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <initializer_list>
#include <map>
#include <numbers>
#include <utility>
#include <vector>

#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph::mesh_shapes {

inline void add_face(Polygons& faces, const std::vector<Index>& corners) {
    faces.corners.insert(faces.corners.end(), corners.begin(), corners.end());
    faces.offsets.push_back(static_cast<std::int64_t>(faces.corners.size()));
}

/// Eight vertices, six squares, from −1 to 1.
inline Cloud cube() {
    Cloud cloud;
    cloud.name = "cube";
    cloud.positions.resize(8, 3);
    for (Index v = 0; v < 8; ++v)
        cloud.positions.row(v) << (v & 1) * 2.0 - 1.0, (v >> 1 & 1) * 2.0 - 1.0,
            (v >> 2 & 1) * 2.0 - 1.0;
    for (const std::vector<Index>& face : {std::vector<Index>{0, 2, 3, 1},
                                           {4, 5, 7, 6},
                                           {0, 1, 5, 4},
                                           {2, 6, 7, 3},
                                           {0, 4, 6, 2},
                                           {1, 3, 7, 5}})
        add_face(cloud.faces, face);
    return cloud;
}

/// #(side + 1)² vertices of [−1, 1]², z = height(x, y), squares facing up.
template <class Height>
Cloud terrain(Index side, Height&& height) {
    Cloud cloud;
    cloud.name = "terrain";
    cloud.positions.resize((side + 1) * (side + 1), 3);
    for (Index u = 0; u <= side; ++u)
        for (Index v = 0; v <= side; ++v) {
            const double x = 2.0 * u / side - 1.0, y = 2.0 * v / side - 1.0;
            cloud.positions.row(u * (side + 1) + v) << x, y, height(x, y);
        }
    for (Index u = 0; u < side; ++u)
        for (Index v = 0; v < side; ++v) {
            const Index a = u * (side + 1) + v, b = a + side + 1;
            add_face(cloud.faces, {a, b, b + 1, a + 1});
        }
    return cloud;
}

inline Cloud grid(Index side) {
    return terrain(side, [](double, double) { return 0.0; });
}

/// Radius 1: an icosahedron whose triangles are cut in four `levels` times.
inline Cloud icosphere(int levels) {
    const double g = std::numbers::phi;
    std::vector<Vector3> p{{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0},
                           {0, -1, g}, {0, 1, g}, {0, -1, -g}, {0, 1, -g},
                           {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
    for (Vector3& x : p) x.normalize();
    std::vector<std::array<Index, 3>> t{
        {0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
        {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
        {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
    for (int level = 0; level < levels; ++level) {
        std::map<std::pair<Index, Index>, Index> middles;
        const auto middle = [&](Index a, Index b) {
            const auto [entry, is_new] = middles.try_emplace(std::minmax(a, b), 0);
            if (is_new) {
                entry->second = to_index(p.size());
                p.push_back((p[to_size(a)] + p[to_size(b)]).normalized());
            }
            return entry->second;
        };
        std::vector<std::array<Index, 3>> finer;
        for (const auto& [a, b, c] : t) {
            const Index ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
            finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
        }
        t = std::move(finer);
    }
    Cloud cloud;
    cloud.name = "icosphere";
    cloud.positions.resize(static_cast<Eigen::Index>(p.size()), 3);
    for (std::size_t v = 0; v < p.size(); ++v)
        cloud.positions.row(static_cast<Eigen::Index>(v)) = p[v].transpose();
    for (const auto& [a, b, c] : t) add_face(cloud.faces, {a, b, c});
    return cloud;
}

/// Radius 1 from z = −1 to 1; both caps are single polygons.
inline Cloud cylinder(Index corners) {
    Cloud cloud;
    cloud.name = "cylinder";
    cloud.positions.resize(2 * corners, 3);
    std::vector<Index> bottom, top;
    for (Index k = 0; k < corners; ++k) {
        const double angle = 2.0 * std::numbers::pi * k / corners;
        cloud.positions.row(2 * k) << std::cos(angle), std::sin(angle), -1.0;
        cloud.positions.row(2 * k + 1) << std::cos(angle), std::sin(angle), 1.0;
        const Index next = 2 * ((k + 1) % corners);
        add_face(cloud.faces, {2 * k, next, next + 1, 2 * k + 1});
        top.push_back(2 * k + 1);
        bottom.insert(bottom.begin(), 2 * k);
    }
    add_face(cloud.faces, bottom);
    add_face(cloud.faces, top);
    return cloud;
}

/// Radius 1: triangles around one vertex in the middle, the last one.
inline Cloud fan(Index count) {
    Cloud cloud;
    cloud.name = "fan";
    cloud.positions.resize(count + 1, 3);
    cloud.positions.row(count).setZero();
    for (Index k = 0; k < count; ++k) {
        const double angle = 2.0 * std::numbers::pi * k / count;
        cloud.positions.row(k) << std::cos(angle), std::sin(angle), 0.0;
        add_face(cloud.faces, {count, k, (k + 1) % count});
    }
    return cloud;
}

/// Radius 1 about the z axis: `around` times `along` quads about a tube.
inline Cloud torus(Index around, Index along, double tube) {
    Cloud cloud;
    cloud.name = "torus";
    cloud.positions.resize(around * along, 3);
    for (Index u = 0; u < around; ++u)
        for (Index v = 0; v < along; ++v) {
            const double a = 2.0 * std::numbers::pi * u / around,
                         b = 2.0 * std::numbers::pi * v / along, radius = 1.0 + tube * std::cos(b);
            cloud.positions.row(u * along + v) << radius * std::cos(a), radius * std::sin(a),
                tube * std::sin(b);
            const Index next_u = (u + 1) % around * along, next_v = (v + 1) % along;
            add_face(cloud.faces, {u * along + v, next_u + v, next_u + next_v, u * along + next_v});
        }
    return cloud;
}

/// Both in one cloud, vertices of the second last.
inline Cloud together(const Cloud& a, const Cloud& b) {
    Cloud cloud;
    cloud.name = a.name + " and " + b.name;
    cloud.positions.resize(a.size() + b.size(), 3);
    cloud.positions << a.positions, b.positions;
    for (Index f = 0; f < a.faces.size(); ++f)
        add_face(cloud.faces, {a.faces[f].begin(), a.faces[f].end()});
    for (Index f = 0; f < b.faces.size(); ++f) {
        std::vector<Index> corners(b.faces[f].begin(), b.faces[f].end());
        for (Index& corner : corners) corner += a.size();
        add_face(cloud.faces, corners);
    }
    return cloud;
}

/// Every face with vertices of its own, as importers leave them.
inline Cloud split(const Cloud& cloud) {
    Cloud result;
    result.name = cloud.name;
    result.positions.resize(static_cast<Eigen::Index>(cloud.faces.corners.size()), 3);
    result.faces.offsets = cloud.faces.offsets;
    for (std::size_t k = 0; k < cloud.faces.corners.size(); ++k) {
        result.positions.row(static_cast<Eigen::Index>(k)) =
            cloud.positions.row(cloud.faces.corners[k]);
        result.faces.corners.push_back(to_index(k));
    }
    return result;
}

/// Faces numbered f with `which(f)` the other way round.
template <class Which>
Cloud reversed(Cloud cloud, Which&& which) {
    for (Index f = 0; f < cloud.faces.size(); ++f)
        if (which(f))
            std::reverse(cloud.faces.corners.begin() + cloud.faces.offsets[to_size(f)],
                         cloud.faces.corners.begin() + cloud.faces.offsets[to_size(f) + 1]);
    return cloud;
}

inline Cloud moved(Cloud cloud, const Matrix3& linear, const Vector3& shift) {
    cloud.positions =
        (cloud.positions * linear.transpose()).rowwise() + Eigen::RowVector3d(shift.transpose());
    return cloud;
}

}  // namespace pointmorph::mesh_shapes

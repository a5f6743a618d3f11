#include "mesh/facing.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "base/angle.hpp"
#include "base/grouped.hpp"
#include "pointmorph/cloud/oriented_points.hpp"

namespace pointmorph {

namespace {

void reverse(Mesh& mesh, Index f) {
    std::swap(mesh.triangles(f, 1), mesh.triangles(f, 2));
    std::swap(mesh.vertices(f, 1), mesh.vertices(f, 2));
}

Index part_of(const Mesh& mesh, Index f) {
    return mesh.parts[to_size(mesh.triangles(f, 0))];
}

Vector3 corner_of(const Mesh& mesh, Index f, Index k) {
    return mesh.positions.row(mesh.triangles(f, k)).transpose();
}

/// What a part of a mesh is as a solid.
struct Solid {
    bool is_closed = true;
    double volume = 0.0;  ///< below 0 where the faces show the inside
    double area = 0.0;
    Eigen::AlignedBox3d box;
    Vector3 start = Vector3::Zero();  ///< one of its places
    bool is_lining = false;           ///< the back of a surface that is there twice

    bool shows_inside() const { return is_closed && faces_inside(volume, area); }
    bool has_room() const { return is_closed && (shows_inside() || faces_inside(-volume, area)); }
};

std::vector<Solid> solids_of(const MeshEdges& edges, const Mesh& mesh) {
    std::vector<Solid> solids(to_size(mesh.part_areas.size()));
    for (std::size_t p = 0; p < solids.size(); ++p) solids[p].area = mesh.part_areas[to_index(p)];
    for (Index e = 0; e < edges.size(); ++e)
        if (edges[e].size() != 2)
            solids[to_size(part_of(mesh, edges[e].front().triangle))].is_closed = false;
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
        Solid& solid = solids[to_size(part_of(mesh, f))];
        if (solid.box.isEmpty()) solid.start = corner_of(mesh, f, 0);
        for (Index k = 0; k < 3; ++k) solid.box.extend(corner_of(mesh, f, k));
        const auto from_start = [&](Index k) -> Vector3 {
            return corner_of(mesh, f, k) - solid.start;
        };
        solid.volume += from_start(0).dot(from_start(1).cross(from_start(2))) / 6.0;
    }
    return solids;
}

/// Finds the linings: of the same size, in the same place, the other way round.
void find_linings(std::vector<Solid>& solids) {
    constexpr double kSame = 1e-6;  // of the length of the unit ball, and of volumes
    const auto are_same = [&](const Solid& one, const Solid& other) {
        return std::abs(one.volume + other.volume) <= kSame * std::abs(other.volume) &&
               (one.box.min() - other.box.min()).norm() <= kSame &&
               (one.box.max() - other.box.max()).norm() <= kSame;
    };
    for (Solid& solid : solids)
        solid.is_lining = solid.shows_inside() && std::ranges::any_of(solids, [&](const Solid& s) {
                              return s.has_room() && !s.shows_inside() && are_same(solid, s);
                          });
}

/// How often closed triangles wind around a place (van Oosterom and Strackee, The Solid Angle of a
/// Plane Triangle, 1983).
double winding_number(const Mesh& mesh, std::span<const Index> triangles, const Vector3& at) {
    double sum = 0.0;
    for (const Index f : triangles) {
        const Vector3 a = corner_of(mesh, f, 0) - at, b = corner_of(mesh, f, 1) - at,
                      c = corner_of(mesh, f, 2) - at;
        const double la = a.norm(), lb = b.norm(), lc = c.norm();
        sum += angle_of(a.dot(b.cross(c)),
                        la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
    }
    return sum / (2.0 * std::numbers::pi);
}

}  // namespace

bool make_agree(const MeshEdges& edges, Mesh& mesh) {
    const Triangles& triangles = mesh.triangles;
    const auto count = to_index(triangles.rows());
    std::vector<signed char> sign(to_size(count), 0);
    std::vector<Index> patch;
    for (Index seed = 0; seed < count; ++seed) {
        if (sign[to_size(seed)] != 0) continue;
        patch.assign(1, seed);
        sign[to_size(seed)] = 1;
        double kept = 0.0, turned = 0.0;
        for (std::size_t next = 0; next < patch.size(); ++next) {
            const Index f = patch[next];
            (sign[to_size(f)] > 0 ? kept : turned) += mesh.areas[f];
            for (Index k = 0; k < 3; ++k) {
                const auto sides = edges[edges.edge_of(f, k)];
                if (sides.size() != 2) continue;
                const MeshEdges::Side other = sides[0].triangle == f ? sides[1] : sides[0];
                if (sign[to_size(other.triangle)] != 0) continue;
                const bool agree = start_of(triangles, other) != triangles(f, k);
                sign[to_size(other.triangle)] =
                    static_cast<signed char>(agree ? sign[to_size(f)] : -sign[to_size(f)]);
                patch.push_back(other.triangle);
            }
        }
        if (turned > kept)
            for (const Index f : patch) sign[to_size(f)] = -sign[to_size(f)];
    }
    bool has_turned = false;
    for (Index f = 0; f < count; ++f) {
        if (sign[to_size(f)] > 0) continue;
        reverse(mesh, f);
        has_turned = true;
    }
    return has_turned;
}

bool turn_outward(const MeshEdges& edges, Mesh& mesh) {
    std::vector<Solid> solids = solids_of(edges, mesh);
    if (std::ranges::none_of(solids, &Solid::shows_inside)) return false;
    find_linings(solids);
    const Grouped<Index> triangles(to_index(solids.size()), [&](auto&& take) {
        for (Index f = 0; f < mesh.triangles.rows(); ++f) take(part_of(mesh, f), f);
    });
    // The smallest of those before it, which are larger, that it lies within; −1 if there is none.
    const auto around = [&](Index part) {
        constexpr double kWithin = 0.25;  // on a surface it is a half
        const Solid& inner = solids[to_size(part)];
        for (Index p = part; p-- > 0;) {
            const Solid& outer = solids[to_size(p)];
            if (outer.has_room() && !outer.is_lining && outer.box.contains(inner.box) &&
                std::abs(winding_number(mesh, triangles[p], inner.start)) > kWithin)
                return p;
        }
        return Index{-1};
    };
    std::vector<char> turned(solids.size(), 0);
    for (Index part = 0; part < to_index(solids.size()); ++part) {
        const Solid& solid = solids[to_size(part)];
        if (solid.is_lining) continue;
        if (!solid.has_room()) {
            turned[to_size(part)] = turned.front();
            continue;
        }
        const Index outer = around(part);
        turned[to_size(part)] = outer < 0 ? solid.shows_inside() : turned[to_size(outer)];
    }
    mesh.parts_turned = to_index(std::ranges::count(turned, 1));
    for (Index f = 0; f < mesh.triangles.rows(); ++f)
        if (turned[to_size(part_of(mesh, f))] != 0) reverse(mesh, f);
    return mesh.parts_turned > 0;
}

}  // namespace pointmorph

#include "mesh/facing.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "base/grouped.hpp"
#include "mesh/doubled_area.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/mesh/closest_point.hpp"

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
    Vector3 middle = Vector3::Zero();
    /// Of the back of a surface that is there twice: the part that is its front; else −1.
    Index front = -1;

    bool shows_inside() const { return is_closed && faces_inside(volume, area); }
    bool shows_outside() const { return is_closed && faces_inside(-volume, area); }
    /// Whether it tells which side is its inside.
    bool has_room() const { return shows_inside() || shows_outside(); }
};

std::vector<Solid> solids_of(const MeshEdges& edges, const Mesh& mesh) {
    std::vector<Solid> solids(to_size(mesh.part_areas.size()));
    for (std::size_t p = 0; p < solids.size(); ++p) solids[p].area = mesh.part_areas[to_index(p)];
    for (Index e = 0; e < edges.size(); ++e)
        if (edges[e].size() == 1)
            solids[to_size(part_of(mesh, edges[e].front().triangle))].is_closed = false;
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
        Solid& solid = solids[to_size(part_of(mesh, f))];
        for (Index k = 0; k < 3; ++k) {
            solid.box.extend(corner_of(mesh, f, k));
            solid.middle += mesh.areas[f] / (3.0 * solid.area) * corner_of(mesh, f, k);
        }
    }
    // Seen from the middle, walls within a part enclose little.
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
        Solid& solid = solids[to_size(part_of(mesh, f))];
        const auto seen = [&](Index k) -> Vector3 { return corner_of(mesh, f, k) - solid.middle; };
        solid.volume += seen(0).dot(seen(1).cross(seen(2))) / 6.0;
    }
    return solids;
}

/// Finds the backs of parts: of the same size, in the same place, the other way round.
void find_fronts(std::vector<Solid>& solids) {
    constexpr double kSame = 1e-6;  // of the length of the unit ball, and of volumes
    const auto are_same = [&](const Solid& one, const Solid& other) {
        return std::abs(one.volume + other.volume) <= kSame * std::abs(other.volume) &&
               (one.box.min() - other.box.min()).norm() <= kSame &&
               (one.box.max() - other.box.max()).norm() <= kSame;
    };
    // Sorted along a line that hardly any row of equal pieces lies across.
    const Vector3 line = Vector3(0.36, 0.48, 0.8);
    std::vector<std::pair<double, Index>> fronts;
    for (std::size_t p = 0; p < solids.size(); ++p)
        if (solids[p].shows_outside())
            fronts.emplace_back(solids[p].box.center().dot(line), to_index(p));
    std::ranges::sort(fronts);
    for (Solid& solid : solids) {
        if (!solid.shows_inside()) continue;
        const double at = solid.box.center().dot(line);
        for (auto next = std::ranges::lower_bound(fronts, std::pair(at - kSame, Index{0}));
             next != fronts.end() && next->first <= at + kSame && solid.front < 0; ++next)
            if (are_same(solid, solids[to_size(next->second)])) solid.front = next->second;
    }
}

/// Says which parts lie within others.
class Containment {
public:
    Containment(const Mesh& mesh, const std::vector<Solid>& solids)
        : mesh_(mesh),
          solids_(solids),
          triangles_(to_index(solids.size()),
                     [&](auto&& take) {
                         for (Index f = 0; f < mesh.triangles.rows(); ++f)
                             take(part_of(mesh, f), f);
                     }),
          surfaces_(solids.size()) {}

    /// Whether most of a part that doesn't touch the other one is within it.
    bool is_within(Index part, Index other, Progress& progress) {
        constexpr std::size_t kPlaces = 9;
        constexpr double kTouch = 1e-12;  // squared
        const Solid &inner = solids_[to_size(part)], &outer = solids_[to_size(other)];
        if (!outer.box.contains(inner.box)) return false;
        const Surface& surface = surface_of(other, progress);
        const std::span<const Index> own = triangles_[part];
        int within = 0;
        for (std::size_t k = 0; k < kPlaces; ++k) {
            const Index f = own[k * (own.size() - 1) / (kPlaces - 1)];
            const Vector3 place =
                (corner_of(mesh_, f, 0) + corner_of(mesh_, f, 1) + corner_of(mesh_, f, 2)) / 3.0;
            const SurfacePoint nearest = surface.tree.closest(place);
            if (nearest.squared_distance <= kTouch) continue;
            const auto t = surface.triangles.row(nearest.triangle);
            const Vector3 off = place - place_of(nearest, surface.triangles, mesh_.positions);
            const bool is_behind = off.dot(doubled_area(mesh_.positions, t[0], t[1], t[2])) < 0.0;
            within += is_behind != outer.shows_inside() ? 1 : -1;
        }
        return within > 0;
    }

private:
    struct Surface {
        Triangles triangles;
        TriangleTree tree;

        Surface(const Positions& positions, Triangles own, Progress& progress)
            : triangles(std::move(own)), tree(positions, triangles, progress) {}
    };

    const Surface& surface_of(Index part, Progress& progress) {
        std::unique_ptr<Surface>& made = surfaces_[to_size(part)];
        if (!made) {
            Triangles own(static_cast<Eigen::Index>(triangles_[part].size()), 3);
            for (Eigen::Index k = 0; k < own.rows(); ++k)
                own.row(k) = mesh_.triangles.row(triangles_[part][to_size(to_index(k))]);
            made = std::make_unique<Surface>(mesh_.positions, std::move(own), progress);
        }
        return *made;
    }

    const Mesh& mesh_;
    const std::vector<Solid>& solids_;
    Grouped<Index> triangles_;
    std::vector<std::unique_ptr<Surface>> surfaces_;
};

/// Of parts: which are to be turned. A part goes with any that it lies within, as these agree.
std::vector<char> to_turn(const Mesh& mesh, const std::vector<Solid>& solids, Progress& progress) {
    Containment containment(mesh, solids);
    std::vector<char> turned(solids.size(), 0);
    std::vector<Index> with_room, turned_ones;  // that lie within no other, the largest first
    for (Index part = 0; part < to_index(solids.size()); ++part) {
        const Solid& solid = solids[to_size(part)];
        progress.report(0.0);
        if (solid.front >= 0 || !solid.has_room()) continue;
        const std::vector<Index>& others = solid.shows_inside() ? with_room : turned_ones;
        const auto outer = std::ranges::find_if(
            others, [&](Index other) { return containment.is_within(part, other, progress); });
        if (outer != others.end()) {
            turned[to_size(part)] = turned[to_size(*outer)];
            continue;
        }
        with_room.push_back(part);
        if (!solid.shows_inside()) continue;
        turned[to_size(part)] = 1;
        turned_ones.push_back(part);
    }
    for (std::size_t part = 0; part < solids.size(); ++part) {
        const Solid& solid = solids[part];
        if (solid.front >= 0)
            turned[part] = turned[to_size(solid.front)];
        else if (!solid.has_room())
            turned[part] = turned.front();
    }
    return turned;
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

bool turn_outward(const MeshEdges& edges, Mesh& mesh, Progress& progress) {
    std::vector<Solid> solids = solids_of(edges, mesh);
    if (std::ranges::none_of(solids, &Solid::shows_inside)) return false;
    find_fronts(solids);
    const std::vector<char> turned = to_turn(mesh, solids, progress);
    mesh.parts_turned = to_index(std::ranges::count(turned, 1));
    for (Index f = 0; f < mesh.triangles.rows(); ++f)
        if (turned[to_size(part_of(mesh, f))] != 0) reverse(mesh, f);
    return mesh.parts_turned > 0;
}

}  // namespace pointmorph

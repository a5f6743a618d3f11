#include "pointmorph/mesh/part_counts.hpp"

#include <algorithm>

#include "cloud/closed_length.hpp"
#include "mesh/mesh_edges.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

namespace {

/// Whether a border lies on a line: a face without an area, which the mesh lacks, had closed it.
bool is_slit(const Mesh& mesh, const std::vector<Index>& border, double length) {
    constexpr double kOnLine = 1e-7;  // of the border
    const Vector3 start = mesh.positions.row(border.front()).transpose();
    Vector3 along = Vector3::Zero();
    for (const Index place : border) {
        const Vector3 way = mesh.positions.row(place).transpose() - start;
        if (way.squaredNorm() > along.squaredNorm()) along = way;
    }
    along.normalize();
    return std::ranges::all_of(border, [&](Index place) {
        const Vector3 way = mesh.positions.row(place).transpose() - start;
        return (way - way.dot(along) * along).norm() <= kOnLine * length;
    });
}

Index corner_at(MeshEdges::Side side, Index k) {
    return 3 * side.triangle + (side.k + k) % 3;
}

}  // namespace

std::vector<PartCounts> count_parts(const Mesh& mesh) {
    std::vector<PartCounts> result(static_cast<std::size_t>(mesh.part_areas.size()));
    for (PartCounts& part : result) part.is_surface = true;
    std::vector<Index> euler(result.size(), 0);
    const auto part_of = [&](Index place) { return to_size(mesh.parts[to_size(place)]); };

    const MeshEdges edges(mesh.triangles);
    // Corners of triangles, numbered 3 f + k, joined where they are of one fan.
    GrowingComponents fans(to_index(mesh.triangles.size()));
    for (Index e = 0; e < edges.size(); ++e) {
        const auto sides = edges[e];
        const std::size_t part = part_of(start_of(mesh.triangles, sides.front()));
        --euler[part];
        if (sides.size() == 1) continue;
        if (sides.size() > 2 ||
            start_of(mesh.triangles, sides[0]) == start_of(mesh.triangles, sides[1])) {
            result[part].is_surface = false;
            continue;
        }
        fans.join(corner_at(sides[0], 0), corner_at(sides[1], 1));
        fans.join(corner_at(sides[0], 1), corner_at(sides[1], 0));
    }
    std::vector<Index> fan(to_size(mesh.positions.rows()), -1);
    for (Index c = 0; c < to_index(mesh.triangles.size()); ++c) {
        const Index place = mesh.triangles(c / 3, c % 3), root = fans.root(c);
        Index& known = fan[to_size(place)];
        if (known < 0) ++euler[part_of(place)];
        if (known >= 0 && known != root) result[part_of(place)].is_surface = false;
        known = root;
        if (c % 3 == 0) ++euler[part_of(place)];
    }
    for (const std::vector<Index>& border : mesh.borders) {
        const double length = closed_length(mesh.positions, border);
        const std::size_t number = part_of(border.front());
        if (is_slit(mesh, border, length)) {
            ++euler[number];
            continue;
        }
        PartCounts& part = result[number];
        ++part.borders;
        part.longest_border = std::max(part.longest_border, length);
    }
    for (std::size_t p = 0; p < result.size(); ++p) {
        if (!result[p].is_surface) {
            result[p] = {};
            continue;
        }
        result[p].genus = (2 - result[p].borders - euler[p]) / 2;
        result[p].area = mesh.part_areas[static_cast<Eigen::Index>(p)];
    }
    return result;
}

}  // namespace pointmorph

#include "pointmorph/mesh/mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "base/angle.hpp"
#include "base/grouped.hpp"
#include "cloud/closed_length.hpp"
#include "mesh/doubled_area.hpp"
#include "mesh/facing.hpp"
#include "mesh/mesh_edges.hpp"
#include "mesh/welding.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

namespace {

using Corners = std::array<Index, 3>;

/// Takes the triangles of the faces, with where they come from.
void take_triangles(const Polygons& faces, Mesh& mesh, Progress& progress) {
    constexpr double kNoArea = 1e-14;
    std::vector<Corners> triangles;
    triangles.reserve(to_size(faces.size()));
    mesh.polygons.clear();
    std::vector<Index> corners;
    for (Index f = 0; f < faces.size(); ++f) {
        corners.clear();
        for (const Index vertex : faces[f]) {
            const Index place = mesh.places[to_size(vertex)];
            if (corners.empty() || corners.back() != place) corners.push_back(place);
        }
        while (corners.size() > 1 && corners.front() == corners.back()) corners.pop_back();
        for (const Corners& t : triangulate(mesh.positions, corners, progress))
            if (doubled_area(mesh.positions, t[0], t[1], t[2]).norm() > kNoArea) {
                triangles.push_back(t);
                mesh.polygons.push_back(f);
            }
    }
    mesh.triangles.resize(static_cast<Eigen::Index>(triangles.size()), 3);
    mesh.vertices.resize(mesh.triangles.rows(), 3);
    for (std::size_t k = 0; k < triangles.size(); ++k)
        for (Index c = 0; c < 3; ++c) {
            const auto row = static_cast<Eigen::Index>(k);
            const Index place = triangles[k][to_size(c)];
            mesh.triangles(row, c) = place;
            mesh.vertices(row, c) = *std::ranges::find_if(
                faces[mesh.polygons[k]],
                [&](Index vertex) { return mesh.places[to_size(vertex)] == place; });
        }
}

void find_areas(Mesh& mesh) {
    mesh.areas.resize(mesh.triangles.rows());
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
        const auto t = mesh.triangles.row(f);
        mesh.areas[f] = 0.5 * doubled_area(mesh.positions, t[0], t[1], t[2]).norm();
    }
}

void find_parts(Mesh& mesh) {
    const auto count = to_index(mesh.positions.rows());
    GrowingComponents joined(count);
    for (Index f = 0; f < mesh.triangles.rows(); ++f)
        for (Index k = 1; k < 3; ++k) joined.join(mesh.triangles(f, 0), mesh.triangles(f, k));
    Values areas = Values::Zero(count);
    for (Index f = 0; f < mesh.triangles.rows(); ++f)
        areas[joined.root(mesh.triangles(f, 0))] += mesh.areas[f];
    std::vector<Index> roots;
    for (Index p = 0; p < count; ++p)
        if (areas[p] > 0.0) roots.push_back(p);
    std::ranges::stable_sort(roots, std::greater{}, [&](Index root) { return areas[root]; });
    std::vector<Index> label(to_size(count), -1);
    mesh.part_areas.resize(static_cast<Eigen::Index>(roots.size()));
    for (std::size_t k = 0; k < roots.size(); ++k) {
        label[to_size(roots[k])] = to_index(k);
        mesh.part_areas[static_cast<Eigen::Index>(k)] = areas[roots[k]];
    }
    mesh.parts.resize(to_size(count));
    for (Index p = 0; p < count; ++p) mesh.parts[to_size(p)] = label[to_size(joined.root(p))];
}

void find_normals(Mesh& mesh) {
    const auto count = to_index(mesh.triangles.rows());
    mesh.normals.resize(count, 3);
    mesh.place_normals = Normals::Zero(mesh.positions.rows(), 3);
    for (Index f = 0; f < count; ++f) {
        const auto t = mesh.triangles.row(f);
        mesh.normals.row(f) = doubled_area(mesh.positions, t[0], t[1], t[2]).normalized();
        for (Index k = 0; k < 3; ++k) {
            const Eigen::RowVector3d p = mesh.positions.row(t[k]);
            const Vector3 u = (mesh.positions.row(t[(k + 1) % 3]) - p).transpose();
            const Vector3 v = (mesh.positions.row(t[(k + 2) % 3]) - p).transpose();
            const double angle = angle_of(u.cross(v).norm(), u.dot(v));
            mesh.place_normals.row(t[k]) += angle * mesh.normals.row(f);
        }
    }
    constexpr double kOpposed = 1e-6;
    std::vector<Index> some(to_size(mesh.positions.rows()), -1);
    for (Index f = 0; f < count; ++f)
        for (Index k = 0; k < 3; ++k) some[to_size(mesh.triangles(f, k))] = f;
    for (Index p = 0; p < mesh.positions.rows(); ++p) {
        auto normal = mesh.place_normals.row(p);
        if (normal.norm() > kOpposed)
            normal.normalize();
        else if (some[to_size(p)] >= 0)  // both sides of a sheet
            normal = mesh.normals.row(some[to_size(p)]);
        else
            normal << 0.0, 0.0, 1.0;
    }
}

/// Simple loops: where borders meet in a place, they are parted there.
std::vector<std::vector<Index>> simple_borders(const MeshEdges& edges, const Mesh& mesh) {
    const Grouped<Index> next(to_index(mesh.positions.rows()), [&](auto&& take) {
        for (Index e = 0; e < edges.size(); ++e)
            if (edges[e].size() == 1)
                take(start_of(mesh.triangles, edges[e].front()),
                     end_of(mesh.triangles, edges[e].front()));
    });
    std::vector<std::size_t> left;  // of the ways on from each place: the last is taken first
    for (Index p = 0; p < next.size(); ++p) left.push_back(next[p].size());
    std::vector<std::vector<Index>> borders;
    std::vector<Index> path, place_in_path(left.size(), -1);
    for (Index start = 0; start < next.size(); ++start)
        while (left[to_size(start)] > 0) {
            path.clear();
            Index at = start;
            for (;;) {
                if (place_in_path[to_size(at)] >=
                    0) {  // a loop closes; the path goes on from its start
                    const auto first = path.begin() + place_in_path[to_size(at)];
                    std::vector<Index> loop(first, path.end());
                    for (const Index p : loop) place_in_path[to_size(p)] = -1;
                    path.erase(first, path.end());
                    if (loop.size() > 2) borders.push_back(std::move(loop));
                }
                if (left[to_size(at)] == 0) break;
                place_in_path[to_size(at)] = to_index(path.size());
                path.push_back(at);
                at = next[at][--left[to_size(at)]];
            }
            for (const Index p : path) place_in_path[to_size(p)] = -1;
        }
    return borders;
}

/// The longest first.
void find_borders(const MeshEdges& edges, Mesh& mesh) {
    std::vector<std::vector<Index>> borders = simple_borders(edges, mesh);
    std::vector<std::pair<double, std::size_t>> order;
    for (std::size_t b = 0; b < borders.size(); ++b)
        order.emplace_back(-closed_length(mesh.positions, borders[b]), b);
    std::ranges::sort(order);
    for (const auto& [length, b] : order) mesh.borders.push_back(std::move(borders[b]));
}

}  // namespace

Mesh mesh_of(const Normalization& unit, Positions positions, Triangles triangles) {
    Mesh mesh;
    mesh.unit = unit;
    mesh.positions = std::move(positions);
    mesh.triangles = std::move(triangles);
    find_areas(mesh);
    find_parts(mesh);
    find_normals(mesh);
    find_borders(MeshEdges(mesh.triangles), mesh);
    return mesh;
}

Mesh make_mesh(const Cloud& cloud, Progress& progress) {
    const auto ask = [&] { progress.report(0.0); };
    Mesh mesh;
    mesh.unit = normalization(cloud.positions);
    weld(cloud.positions, mesh);
    ask();
    take_triangles(cloud.faces, mesh, progress);
    ask();
    MeshEdges edges(mesh.triangles);
    ask();
    if (close_rounded_seams(edges, mesh, progress)) {
        take_triangles(cloud.faces, mesh, progress);
        edges = MeshEdges(mesh.triangles);
    }
    ask();
    if (part_what_touches(cloud.faces, edges, mesh, progress)) edges = MeshEdges(mesh.triangles);
    ask();
    find_areas(mesh);
    if (make_agree(edges, mesh)) edges = MeshEdges(mesh.triangles);
    ask();
    find_parts(mesh);
    if (turn_outward(edges, mesh, progress)) edges = MeshEdges(mesh.triangles);
    ask();
    find_normals(mesh);
    ask();
    find_borders(edges, mesh);
    return mesh;
}

Mesh make_mesh(const Cloud& cloud) {
    Progress silent;
    return make_mesh(cloud, silent);
}

double border_length(const Mesh& mesh) {
    double length = 0.0;
    for (const std::vector<Index>& border : mesh.borders)
        length += closed_length(mesh.positions, border);
    const double area = mesh.area();
    return area > 0.0 ? length / std::sqrt(area) : 0.0;
}

}  // namespace pointmorph

#include "pointmorph/mesh/mesh.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "mesh/mesh_edges.hpp"
#include "mesh_shapes.hpp"

namespace pointmorph {
namespace {

double volume(const Mesh& mesh) {
    double sum = 0.0;
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
        const auto corner = [&](Index k) -> Vector3 {
            return mesh.positions.row(mesh.triangles(f, k)).transpose();
        };
        sum += corner(0).dot(corner(1).cross(corner(2))) / 6.0;
    }
    return sum;
}

double area_of(const Positions& p, const std::vector<std::array<Index, 3>>& triangles,
               const Vector3& normal) {
    double sum = 0.0;
    for (const auto& [a, b, c] : triangles) {
        const Vector3 u = (p.row(b) - p.row(a)).transpose(), v = (p.row(c) - p.row(a)).transpose();
        const double area = 0.5 * u.cross(v).dot(normal);
        EXPECT_GT(area, 0.0);
        sum += area;
    }
    return sum;
}

std::vector<Index> all(const Positions& p) {
    std::vector<Index> rows(to_size(p.rows()));
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i] = to_index(i);
    return rows;
}

TEST(Mesh, OfACubeHasItsAreaVolumeAndNormals) {
    const Mesh mesh = make_mesh(mesh_shapes::cube());
    const double scale = mesh.unit.scale;
    EXPECT_EQ(mesh.triangles.rows(), 12);
    EXPECT_NEAR(mesh.area() * scale * scale, 24.0, 1e-12);
    EXPECT_NEAR(volume(mesh) * scale * scale * scale, 8.0, 1e-12);
    EXPECT_TRUE(mesh.borders.empty());
    EXPECT_EQ(mesh.part_areas.size(), 1);
    EXPECT_EQ(mesh.parts_turned, 0);
    for (Index v = 0; v < 8; ++v) {  // by angle: as if the squares weren't cut
        const Index place = mesh.places[to_size(v)];
        EXPECT_LT((mesh.place_normals.row(place) - mesh.positions.row(place).normalized()).norm(),
                  1e-12);
    }
}

TEST(Mesh, ClosesSeamsAndDuplicatePlaces) {
    const Mesh whole = make_mesh(mesh_shapes::icosphere(1));
    const Mesh split = make_mesh(mesh_shapes::split(mesh_shapes::icosphere(1)));
    EXPECT_EQ(split.places.size(), 3u * 80u);
    EXPECT_EQ(split.positions.rows(), whole.positions.rows());
    EXPECT_TRUE(split.borders.empty());
    EXPECT_EQ(split.part_areas.size(), 1);
    EXPECT_NEAR(split.area(), whole.area(), 1e-12);
}

TEST(Mesh, TurnsFacesToAgreeAndOutwards) {
    const Mesh right = make_mesh(mesh_shapes::icosphere(2));
    const Mesh some = make_mesh(
        mesh_shapes::reversed(mesh_shapes::icosphere(2), [](Index f) { return f % 3 == 0; }));
    EXPECT_EQ(some.parts_turned, 0);
    EXPECT_NEAR(volume(some), volume(right), 1e-12);
    const Mesh inside_out =
        make_mesh(mesh_shapes::reversed(mesh_shapes::icosphere(2), [](Index) { return true; }));
    EXPECT_EQ(inside_out.parts_turned, 1);
    EXPECT_NEAR(volume(inside_out), volume(right), 1e-12);
}

TEST(Mesh, LeavesAnOpenSheetAsItFaces) {
    const Mesh down =
        make_mesh(mesh_shapes::reversed(mesh_shapes::grid(4), [](Index) { return true; }));
    EXPECT_EQ(down.parts_turned, 0);
    EXPECT_LT((down.normals.rowwise() - Eigen::RowVector3d(0, 0, -1)).norm(), 1e-12);
}

TEST(Mesh, FindsPartsByAreaAndBordersByLength) {
    const Matrix3 half = 0.5 * Matrix3::Identity();
    const Mesh mesh = make_mesh(mesh_shapes::together(
        mesh_shapes::moved(mesh_shapes::grid(3), half, {5, 0, 0}), mesh_shapes::grid(6)));
    ASSERT_EQ(mesh.part_areas.size(), 2);
    EXPECT_GT(mesh.part_areas[0], mesh.part_areas[1]);
    EXPECT_EQ(mesh.parts[0], 1);
    EXPECT_EQ(mesh.parts[16], 0);
    ASSERT_EQ(mesh.borders.size(), 2u);
    EXPECT_EQ(mesh.borders[0].size(), 24u);
    EXPECT_EQ(mesh.borders[1].size(), 12u);
    for (const auto& loop : mesh.borders) {  // the surface on the left, seen from above
        double turn = 0.0;
        for (std::size_t k = 0; k < loop.size(); ++k) {
            const auto a = mesh.positions.row(loop[k]);
            const auto b = mesh.positions.row(loop[(k + 1) % loop.size()]);
            turn += a[0] * b[1] - a[1] * b[0];
        }
        EXPECT_GT(turn, 0.0);
    }
}

TEST(Mesh, LeavesOutFacesWithoutArea) {
    Cloud cloud = mesh_shapes::cube();
    mesh_shapes::add_face(cloud.faces, {0, 1});
    mesh_shapes::add_face(cloud.faces, {0, 1, 1});
    mesh_shapes::add_face(cloud.faces, {0, 0, 1, 1, 3, 3});
    mesh_shapes::add_face(cloud.faces, {});
    EXPECT_EQ(make_mesh(cloud).triangles.rows(), 13);
    cloud.faces = {};
    mesh_shapes::add_face(cloud.faces, {0, 1});
    EXPECT_EQ(make_mesh(cloud).triangles.rows(), 0);
}

TEST(Mesh, TakesVerticesWithoutFacesAndEdgesOfManyFaces) {
    Cloud cloud = mesh_shapes::cube();
    cloud.positions.conservativeResize(10, 3);
    cloud.positions.row(8) << 0, 0, 5;
    cloud.positions.row(9) << 3, 3, 0;
    mesh_shapes::add_face(cloud.faces, {0, 4, 9});  // a fin on an edge
    const Mesh mesh = make_mesh(cloud);
    EXPECT_EQ(mesh.parts[8], -1);
    EXPECT_EQ(mesh.part_areas.size(), 1);
    EXPECT_TRUE(mesh.place_normals.allFinite());
    EXPECT_EQ(make_mesh(mesh_shapes::cube()).normals.topRows(12),
              mesh.normals.topRows(12));  // the fin turns nothing
}

TEST(Mesh, IsTheSameAtAnyPlaceAndScale) {
    const Mesh here = make_mesh(mesh_shapes::cylinder(9));
    for (const double scale : {1e-200, 1.0, 1e200}) {
        const Mesh there = make_mesh(mesh_shapes::moved(
            mesh_shapes::cylinder(9), scale * Matrix3::Identity(), scale * Vector3(7, 8, 9)));
        EXPECT_EQ(there.triangles, here.triangles);
        EXPECT_LT((there.positions - here.positions).norm(), 1e-12);
    }
}

TEST(Mesh, CutsConcavePolygonsIntoPartsOfThem) {
    Progress silent;
    Positions p(8, 3);  // an L, a notch in it, and a corner on a straight side
    p << 0, 0, 0, 4, 0, 0, 4, 1, 0, 1.5, 1, 0, 1, 1, 0, 1, 4, 0, 0.5, 2, 0, 0, 4, 0;
    const auto triangles = triangulate(p, all(p), silent);
    EXPECT_EQ(triangles.size(), 6u);
    double shoelace = 0.0;
    for (Index i = 0; i < 8; ++i) {
        const Index j = (i + 1) % 8;
        shoelace += 0.5 * (p(i, 0) * p(j, 1) - p(i, 1) * p(j, 0));
    }
    EXPECT_NEAR(area_of(p, triangles, Vector3::UnitZ()), shoelace, 1e-12);
}

TEST(Mesh, CutsAQuadrangleWhereItBendsLeast) {
    Progress silent;
    Positions p(4, 3);
    p << 0, 0, 0, 1, 0.9, 0, 0, 3, 0, -1, 0.9, 0;  // a dart would overlap along the other diagonal
    p(1, 0) = 0.1;
    const auto triangles = triangulate(p, all(p), silent);
    EXPECT_NEAR(area_of(p, triangles, Vector3::UnitZ()),
                0.5 * std::abs(p(0, 0) * p(1, 1) - p(1, 0) * p(0, 1) + p(1, 0) * p(2, 1) -
                               p(2, 0) * p(1, 1) + p(2, 0) * p(3, 1) - p(3, 0) * p(2, 1) +
                               p(3, 0) * p(0, 1) - p(0, 0) * p(3, 1)),
                1e-12);
}

TEST(Mesh, TriangulatesWhatHasNoArea) {
    Progress silent;
    const Positions p = Positions::Zero(5, 3);
    EXPECT_EQ(triangulate(p, all(p), silent).size(), 3u);
    EXPECT_TRUE(triangulate(p, std::vector<Index>{0, 1}, silent).empty());
    EXPECT_TRUE(triangulate(p, std::vector<Index>{}, silent).empty());
}

TEST(Mesh, EdgesKnowTheirTriangles) {
    const Mesh mesh = make_mesh(mesh_shapes::icosphere(1));
    const MeshEdges edges(mesh.triangles);
    EXPECT_EQ(edges.size(), 120);
    for (Index f = 0; f < mesh.triangles.rows(); ++f)
        for (Index k = 0; k < 3; ++k) {
            const auto sides = edges[edges.edge_of(f, k)];
            ASSERT_EQ(sides.size(), 2u);
            EXPECT_TRUE(sides[0].triangle == f || sides[1].triangle == f);
            EXPECT_EQ(start_of(mesh.triangles, sides[0]), end_of(mesh.triangles, sides[1]));
        }
}

TEST(Example, Mesh) {
    const Cloud cloud = mesh_shapes::cube();
    const Index vertex = 7;
    // --- example
    const Mesh mesh = make_mesh(cloud);
    const Index place = mesh.places[to_size(vertex)];
    const bool is_open = !mesh.borders.empty();
    // --- end of the example
    EXPECT_LT((mesh.unit.restore(mesh.positions).row(place) - cloud.positions.row(vertex)).norm(),
              1e-12);
    EXPECT_FALSE(is_open);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/mesh/part_counts.hpp"

#include <gtest/gtest.h>

#include <numbers>
#include <vector>

#include "mesh_shapes.hpp"

namespace pointmorph {
namespace {

/// Squares around and around, closed one way, and the other way but for `open`.
Cloud tube(Index around, Index along, bool open, bool twisted = false) {
    Cloud cloud;
    cloud.name = "tube";
    cloud.positions.resize(around * along, 3);
    for (Index u = 0; u < around; ++u)
        for (Index v = 0; v < along; ++v) {
            const double a = 2.0 * std::numbers::pi * u / around;
            const double b = open ? 0.0 : 2.0 * std::numbers::pi * v / along;
            const double across = open ? v - 0.5 * (along - 1) : 0.0;
            const double turn = twisted ? 0.5 * a : 0.5 * std::numbers::pi;
            const double r = 4.0 + std::cos(b) + across * std::cos(turn);
            cloud.positions.row(u * along + v) << r * std::cos(a), r * std::sin(a),
                std::sin(b) + across * std::sin(turn);
        }
    for (Index u = 0; u < around; ++u)
        for (Index v = 0; v + (open ? 1 : 0) < along; ++v) {
            const Index next = (u + 1) % around, w = (v + 1) % along;
            const bool flips = twisted && next == 0;
            mesh_shapes::add_face(cloud.faces,
                                  {u * along + v, next * along + (flips ? along - 1 - v : v),
                                   next * along + (flips ? along - 1 - w : w), u * along + w});
        }
    return cloud;
}

void expect_counts(const Cloud& cloud, Index genus, Index borders) {
    for (const Cloud& given : {cloud, mesh_shapes::split(cloud)}) {
        const Mesh mesh = make_mesh(given);
        const std::vector<PartCounts> counts = count_parts(mesh);
        ASSERT_EQ(counts.size(), 1u);
        EXPECT_TRUE(counts[0].is_surface);
        EXPECT_EQ(counts[0].genus, genus);
        EXPECT_EQ(counts[0].borders, borders);
        EXPECT_NEAR(counts[0].area, mesh.area(), 1e-9);
    }
}

TEST(PartCounts, AreThoseOfMadeMeshes) {
    expect_counts(mesh_shapes::cube(), 0, 0);
    expect_counts(mesh_shapes::icosphere(3), 0, 0);
    expect_counts(mesh_shapes::grid(5), 0, 1);
    expect_counts(tube(12, 8, false), 1, 0);
    expect_counts(tube(12, 3, true), 0, 2);
    // Without a face in each of three places.
    Cloud ring = tube(12, 8, false);
    for (const Index f : {80, 40, 3}) {
        const auto first = ring.faces.corners.begin() + 4 * f;
        ring.faces.corners.erase(first, first + 4);
        ring.faces.offsets.pop_back();
    }
    expect_counts(ring, 1, 3);
}

TEST(PartCounts, AreThoseOfEachPartOfMany) {
    const Cloud ball = mesh_shapes::icosphere(2);
    const Matrix3 same = Matrix3::Identity();
    const Mesh mesh = make_mesh(mesh_shapes::together(
        mesh_shapes::together(ball, mesh_shapes::moved(mesh_shapes::grid(3), same, {9, 0, 0})),
        tube(12, 8, false)));
    const std::vector<PartCounts> counts = count_parts(mesh);
    ASSERT_EQ(counts.size(), 3u);
    EXPECT_EQ(counts[0].genus, 1);
    EXPECT_EQ(counts[1].genus, 0);
    EXPECT_EQ(counts[1].borders, 0);
    EXPECT_EQ(counts[2].borders, 1);
    const double scale = mesh.unit.scale;
    EXPECT_NEAR(counts[2].longest_border * scale, 8.0, 1e-12);
    EXPECT_NEAR(counts[2].area * scale * scale, 4.0, 1e-12);
}

TEST(PartCounts, TakeSlitsWithoutAreaForClosed) {
    // A vertex in the middle of an edge, which a face without an area joins to that edge.
    Cloud cloud = mesh_shapes::cube();
    cloud.positions.conservativeResize(9, 3);
    cloud.positions.row(8) << 0, 1, -1;
    cloud.faces.corners.insert(cloud.faces.corners.begin() + 2, 8);  // 0 2 8 3 1
    for (std::size_t f = 1; f < cloud.faces.offsets.size(); ++f) ++cloud.faces.offsets[f];
    mesh_shapes::add_face(cloud.faces, {2, 3, 8});
    const Mesh mesh = make_mesh(cloud);
    EXPECT_EQ(mesh.borders.size(), 1u);
    expect_counts(cloud, 0, 0);
}

TEST(PartCounts, SayNothingOfWhatIsNoSurface) {
    Cloud fin = mesh_shapes::cube();
    fin.positions.conservativeResize(9, 3);
    fin.positions.row(8) << 3, 3, 0;
    mesh_shapes::add_face(fin.faces, {0, 4, 8});
    EXPECT_FALSE(count_parts(make_mesh(fin))[0].is_surface);
    Cloud fans = mesh_shapes::cube();
    fans.positions.conservativeResize(10, 3);
    fans.positions.row(8) << 3, 3, 0;
    fans.positions.row(9) << 3, 3, 3;
    mesh_shapes::add_face(fans.faces, {7, 8, 9});
    EXPECT_FALSE(count_parts(make_mesh(fans))[0].is_surface);
    EXPECT_FALSE(count_parts(make_mesh(tube(12, 3, true, true)))[0].is_surface);  // Möbius'
    EXPECT_TRUE(count_parts(Mesh{}).empty());
}

}  // namespace
}  // namespace pointmorph

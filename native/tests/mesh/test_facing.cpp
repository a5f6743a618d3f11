#include "mesh/facing.hpp"

#include <gtest/gtest.h>

#include "mesh_shapes.hpp"

namespace pointmorph {
namespace {

Cloud inside_out(const Cloud& cloud) {
    return mesh_shapes::reversed(cloud, [](Index) { return true; });
}

Cloud ball(double radius, double x) {
    return mesh_shapes::moved(mesh_shapes::icosphere(2), radius * Matrix3::Identity(),
                              Vector3(x, 0.0, 0.0));
}

/// Of each part, in the cloud's own unit: what the faces enclose, below 0 where they show it.
Values volumes(const Mesh& mesh) {
    Values sums = Values::Zero(mesh.part_areas.size());
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
        const auto corner = [&](Index k) -> Vector3 {
            return mesh.positions.row(mesh.triangles(f, k)).transpose();
        };
        sums[mesh.parts[to_size(mesh.triangles(f, 0))]] +=
            corner(0).dot(corner(1).cross(corner(2))) / 6.0 * std::pow(mesh.unit.scale, 3);
    }
    return sums;
}

double volume_of_ball(double radius) {
    return volumes(make_mesh(ball(radius, 0.0)))[0];
}

TEST(TurnOutward, TurnsEachPartByItself) {
    const Mesh mesh = make_mesh(mesh_shapes::together(
        ball(1.0, 0.0), mesh_shapes::together(inside_out(ball(0.8, 3.0)), ball(0.6, 6.0))));
    EXPECT_EQ(mesh.parts_turned, 1);
    const Values found = volumes(mesh);
    ASSERT_EQ(found.size(), 3);
    EXPECT_NEAR(found[0], volume_of_ball(1.0), 1e-9);
    EXPECT_NEAR(found[1], volume_of_ball(0.8), 1e-9);
    EXPECT_NEAR(found[2], volume_of_ball(0.6), 1e-9);
}

TEST(TurnOutward, LeavesCavitiesWithWhatIsAroundThem) {
    const Cloud hollow = mesh_shapes::together(
        ball(1.0, 0.0),
        mesh_shapes::together(inside_out(ball(0.7, 0.1)), ball(0.4, 0.2)));  // with a pip
    const Mesh right = make_mesh(hollow), turned = make_mesh(inside_out(hollow));
    EXPECT_EQ(right.parts_turned, 0);
    EXPECT_EQ(turned.parts_turned, 3);
    for (const Mesh* mesh : {&right, &turned}) {
        const Values found = volumes(*mesh);
        ASSERT_EQ(found.size(), 3);
        EXPECT_NEAR(found[0], volume_of_ball(1.0), 1e-9);
        EXPECT_NEAR(found[1], -volume_of_ball(0.7), 1e-9);
        EXPECT_NEAR(found[2], volume_of_ball(0.4), 1e-9);
    }
}

TEST(TurnOutward, LeavesWhatShowsBothSides) {
    for (const bool back_first : {false, true}) {
        const Cloud front = ball(1.0, 0.0), back = inside_out(front);
        const Cloud both =
            back_first ? mesh_shapes::together(back, front) : mesh_shapes::together(front, back);
        const Mesh mesh = make_mesh(mesh_shapes::together(
            both, mesh_shapes::together(ball(0.5, 3.0), mesh_shapes::grid(3))));
        EXPECT_EQ(mesh.parts_turned, 0) << back_first;
        const Values found = volumes(mesh);
        ASSERT_EQ(found.size(), 4);
        EXPECT_NEAR(found.sum(), volume_of_ball(0.5), 1e-9);
    }
}

TEST(TurnOutward, HasOpenPartsGoWithTheLargest) {
    const Cloud sheet =
        mesh_shapes::moved(mesh_shapes::grid(3), 0.5 * Matrix3::Identity(), Vector3(0.0, 0.0, 3.0));
    const auto faces_up = [](const Mesh& mesh) {
        Index up = 0;
        for (Index f = 0; f < mesh.triangles.rows(); ++f)
            if (mesh.parts[to_size(mesh.triangles(f, 0))] == 1 && mesh.normals(f, 2) > 0.0) ++up;
        return up;
    };
    EXPECT_EQ(faces_up(make_mesh(mesh_shapes::together(ball(1.0, 0.0), sheet))), 18);
    const Mesh turned = make_mesh(inside_out(mesh_shapes::together(ball(1.0, 0.0), sheet)));
    EXPECT_EQ(turned.parts_turned, 2);
    EXPECT_EQ(faces_up(turned), 18);
    const Mesh small = make_mesh(mesh_shapes::together(sheet, inside_out(ball(0.2, 0.0))));
    EXPECT_EQ(small.parts_turned, 1);
    EXPECT_NEAR(volumes(small)[1], volume_of_ball(0.2), 1e-9);
}

}  // namespace
}  // namespace pointmorph

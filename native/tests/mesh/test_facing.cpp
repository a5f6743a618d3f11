#include "mesh/facing.hpp"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <string_view>

#include "mesh_shapes.hpp"
#include "pointmorph/base/error.hpp"

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

TEST(TurnOutward, TurnsBothSidesOfWhatLiesInAPartThatIsTurned) {
    const Cloud both = mesh_shapes::together(ball(0.3, 0.1), inside_out(ball(0.3, 0.1)));
    const Mesh mesh = make_mesh(mesh_shapes::together(inside_out(ball(1.0, 0.0)), both));
    EXPECT_EQ(mesh.parts_turned, 3);
    EXPECT_NEAR(volumes(mesh).sum(), volume_of_ball(1.0), 1e-9);
}

TEST(TurnOutward, TurnsWhatHasAWallInside) {
    Cloud box = inside_out(mesh_shapes::cube());
    box.positions.col(0) *= 1.5;
    // The wall's corners are the box's, so that three faces meet along two of its sides.
    mesh_shapes::add_face(box.faces, {0, 3, 7, 4});
    const Mesh mesh = make_mesh(box);
    EXPECT_EQ(mesh.parts_turned, 1);
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
        const Eigen::RowVector3d middle =
            (mesh.positions.row(mesh.triangles(f, 0)) + mesh.positions.row(mesh.triangles(f, 1)) +
             mesh.positions.row(mesh.triangles(f, 2))) /
            3.0;
        if (mesh.polygons[to_size(f)] < 6) {
            EXPECT_GT(middle.dot(mesh.normals.row(f)), 0.0);
        }
    }
}

/// Tetrahedra in rows, all showing their inside, within a ball.
Cloud beads(Index count) {
    Index side = 1;
    while (side * side * side < count) ++side;
    Cloud cloud =
        mesh_shapes::moved(mesh_shapes::icosphere(3), 2.0 * Matrix3::Identity(), Vector3::Zero());
    const Index first = cloud.size();
    cloud.positions.conservativeResize(first + 4 * count, 3);
    for (Index b = 0; b < count; ++b) {
        const Eigen::RowVector3d at(b % side, b / side % side, b / (side * side));
        const Index own = first + 4 * b;
        for (Index k = 0; k < 4; ++k)
            cloud.positions.row(own + k) = (2.0 * at / side).array() - 1.0;
        for (Index k = 0; k < 3; ++k) cloud.positions(own + k + 1, k) += 0.5 / side;
        for (const auto& t : {std::array<Index, 3>{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {1, 3, 2}})
            mesh_shapes::add_face(cloud.faces, {own + t[0], own + t[1], own + t[2]});
    }
    return cloud;
}

TEST(TurnOutward, TakesThousandsOfPieces) {
    const Cloud within = beads(3000);
    const Mesh mesh = make_mesh(within);
    EXPECT_EQ(mesh.part_areas.size(), 3001);
    EXPECT_EQ(mesh.parts_turned, 0);  // as cavities
    EXPECT_EQ(make_mesh(inside_out(within)).parts_turned, 3001);
}

TEST(TurnOutward, CanBeCanceled) {
    const Cloud within = beads(200);
    int asked = 0;
    Progress counting([&](std::string_view, double) { return ++asked > 0; },
                      std::chrono::milliseconds(0));
    make_mesh(within, counting);
    ASSERT_GT(asked, 200);
    for (const int after : {asked / 2, asked - 20}) {
        int left = after;
        Progress stopping([&](std::string_view, double) { return left-- > 0; },
                          std::chrono::milliseconds(0));
        EXPECT_THROW(make_mesh(within, stopping), Cancelled);
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

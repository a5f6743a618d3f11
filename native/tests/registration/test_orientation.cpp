#include "registration/orientation.hpp"

#include <gtest/gtest.h>

#include <numbers>

#include "registration/eggs.hpp"

namespace pointmorph {
namespace {

CoarseShape reversed(CoarseShape shape) {
    shape.normals = -shape.normals;
    return shape;
}

/// Half of an egg, or any open shape: it encloses nothing.
CoarseShape flat(double side) {
    CoarseShape shape;
    shape.positions = shapes::grid(20);
    shape.normals = Eigen::RowVector3d(0, 0, side).replicate(400, 1);
    shape.areas = Values::Constant(400, 1.0 / 400);
    return shape;
}

TEST(Orientation, TheVolumeIsThatOfTheShapeAndNegativeInsideOut) {
    const Eggs eggs;
    const double volume = 4.0 / 3.0 * std::numbers::pi * 0.42 * 0.3 * 0.2;
    EXPECT_NEAR(signed_volume(eggs.coarse_source), volume, 0.1 * volume);
    EXPECT_NEAR(signed_volume(reversed(eggs.coarse_source)), -volume, 0.1 * volume);
}

TEST(Orientation, ShapesWithAVolumeAreComparedByIt) {
    const Eggs eggs;
    const CoarseShape &s = eggs.coarse_source, &t = eggs.coarse_target;
    EXPECT_FALSE(is_inside_out(s, t, s.positions));
    EXPECT_TRUE(is_inside_out(s, reversed(t), s.positions));
    EXPECT_TRUE(is_inside_out(reversed(s), t, s.positions));
    EXPECT_FALSE(is_inside_out(reversed(s), reversed(t), s.positions));
}

TEST(Orientation, OpenShapesAreComparedWhereTheSourceStarts) {
    const CoarseShape up = flat(1.0), down = flat(-1.0);
    EXPECT_NEAR(normal_agreement(up, up, up.positions), 1.0, 1e-12);
    EXPECT_NEAR(normal_agreement(up, down, up.positions), -1.0, 1e-12);
    EXPECT_FALSE(is_inside_out(up, up, up.positions));
    EXPECT_TRUE(is_inside_out(up, down, up.positions));
}

}  // namespace
}  // namespace pointmorph

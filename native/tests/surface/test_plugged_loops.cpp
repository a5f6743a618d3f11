#include "surface/plugged_loops.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "pointmorph/cloud/kd_tree.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

constexpr Index kHead = 3000;
constexpr double kRim = 0.6;  // radius of the opening of a ball cut at height −.8

struct Shape {
    Positions positions;
    std::vector<Index> labels;
    Neighborhoods nearest;
    std::vector<BoundaryLoop> loops;
};

/// A ball that is open below, and another component.
Shape with(const Positions& other) {
    Shape shape;
    shape.positions.resize(kHead + other.rows(), 3);
    shape.positions << shapes::sphere(kHead, -0.8), other;
    shape.labels.assign(to_size(shape.positions.rows()), 1);
    std::fill_n(shape.labels.begin(), kHead, 0);
    Progress progress;
    shape.nearest = nearest_neighbors(KdTree<3>(shape.positions), 16, progress);
    const Positions head = shape.positions.topRows(kHead);
    shape.loops = find_boundary_loops(head, head, nearest_neighbors(KdTree<3>(head), 16, progress),
                                      {}, progress);
    return shape;
}

std::size_t left(const Shape& shape) {
    return unplugged_loops(shape.positions, shape.nearest, shape.loops, shape.labels).size();
}

Positions ball(double radius, double x, double z) {
    Positions p = radius * shapes::sphere(600);
    p.col(0).array() += x;
    p.col(2).array() += z;
    return p;
}

TEST(PluggedLoops, ABallInAnOpeningClosesIt) {
    const Shape shape = with(ball(kRim, 0.0, -0.8));
    ASSERT_EQ(shape.loops.size(), 1u);
    EXPECT_EQ(left(shape), 0u);
    EXPECT_EQ(left(with(ball(kRim - 0.05, 0.0, -0.8))), 0u);
}

TEST(PluggedLoops, WhatLiesElsewhereDoesNot) {
    EXPECT_EQ(left(with(ball(0.3, 0.0, -0.8))), 1u);  // within the opening, far from its rim
    EXPECT_EQ(left(with(ball(kRim, 0.0, -2.5))), 1u);
    EXPECT_EQ(left(with(ball(kRim, 0.6, -0.8))), 1u);  // touches a part of the rim
}

TEST(PluggedLoops, PointsOfTheSameComponentDoNot) {
    Shape shape = with(ball(kRim, 0.0, -0.8));
    shape.labels.assign(shape.labels.size(), 0);
    EXPECT_EQ(left(shape), 1u);
}

TEST(PluggedLoops, NoneWithoutLoops) {
    Shape shape = with(ball(kRim, 0.0, -0.8));
    shape.loops.clear();
    EXPECT_EQ(left(shape), 0u);
}

}  // namespace
}  // namespace pointmorph

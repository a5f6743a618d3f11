#include "pointmorph/coarse_shape.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

#include "shapes.hpp"

namespace pointmorph {
namespace {

std::size_t at(Index i) {
    return static_cast<std::size_t>(i);
}

TEST(CoarseShape, HoldsTheRequiredRowsFirstAtEveryLevel) {
    const Positions p = shapes::sphere(4000);
    const std::vector<Index> required{3999, 17, 18};
    Progress progress;
    const CoarseShape shape =
        coarse_shape(KdTree<3>(p), p, required, {1000, {50, 200}, {}}, progress);
    EXPECT_NEAR(shape.size(), 1000, 100);
    ASSERT_EQ(shape.levels.size(), 2u);
    EXPECT_NEAR(shape.levels[0].size(), 50, 8);
    EXPECT_NEAR(shape.levels[1].size(), 200, 20);
    for (Index k = 0; k < 3; ++k) {
        EXPECT_EQ(shape.rows[at(k)], required[at(k)]);
        for (const DeformationGraph& level : shape.levels) EXPECT_EQ(level.nodes[at(k)], k);
    }
    for (Index i = 0; i < shape.size(); ++i) {
        EXPECT_EQ(shape.positions.row(i), p.row(shape.rows[at(i)]));
        EXPECT_EQ(shape.normals.row(i), p.row(shape.rows[at(i)]));
    }
}

TEST(CoarseShape, AreasAreThoseOfTheSurfaceHoweverUnevenTheCloud) {
    // Nine of ten points on the upper half.
    Positions p(6000, 3);
    const Positions upper = shapes::sphere(5400, 0.0), lower = shapes::sphere(600, 0.0);
    p << upper, -lower;
    Progress progress;
    const CoarseShape shape = coarse_shape(KdTree<3>(p), p, {}, {1000, {100}, {}}, progress);
    double above = 0.0;
    for (Index i = 0; i < shape.size(); ++i)
        if (shape.positions(i, 2) > 0.0) above += shape.areas[i];
    EXPECT_NEAR(above, 2.0 * std::numbers::pi, 0.15 * 2.0 * std::numbers::pi);
    EXPECT_NEAR(shape.areas.sum(), 4.0 * std::numbers::pi, 0.15 * 4.0 * std::numbers::pi);
}

TEST(CoarseShape, ASmallCloudIsTakenWhole) {
    const Positions p = shapes::sphere(30);
    Progress progress;
    const CoarseShape shape = coarse_shape(KdTree<3>(p), p, {}, {}, progress);
    EXPECT_EQ(shape.size(), 30);
    EXPECT_EQ(shape.levels.back().size(), 30);
    EXPECT_GT(shape.areas.minCoeff(), 0.0);
}

}  // namespace
}  // namespace pointmorph

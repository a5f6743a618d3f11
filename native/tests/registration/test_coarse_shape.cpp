#include "pointmorph/registration/coarse_shape.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <numbers>

#include "shapes.hpp"

namespace pointmorph {
namespace {

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
        EXPECT_EQ(shape.cloud_rows[to_size(k)], required[to_size(k)]);
        for (const DeformationGraph& level : shape.levels)
            EXPECT_EQ(level.node_rows[to_size(k)], k);
    }
    for (Index i = 0; i < shape.size(); ++i) {
        EXPECT_EQ(shape.positions.row(i), p.row(shape.cloud_rows[to_size(i)]));
        EXPECT_EQ(shape.normals.row(i), p.row(shape.cloud_rows[to_size(i)]));
    }
}

TEST(CoarseShape, IsTheSameWhereNeighborsAreKnown) {
    const Positions p = shapes::sphere(4000);
    const KdTree<3> tree(p);
    Progress progress;
    const Neighborhoods nearest = nearest_neighbors(tree, 16, progress);
    const CoarseShape one = coarse_shape(tree, p, {}, {1500, {200}, {}}, progress);
    const CoarseShape same = coarse_shape(tree, p, {}, {1500, {200}, {}}, progress, &nearest);
    EXPECT_EQ(same.cloud_rows, one.cloud_rows);
    EXPECT_EQ(same.areas, one.areas);
    EXPECT_EQ(same.graph.neighbors, one.graph.neighbors);
    EXPECT_EQ(same.levels.front().node_rows, one.levels.front().node_rows);
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

TEST(CoarseShape, LocalAreasAreThoseOfGeodesicBalls) {
    constexpr std::array<double, 4> kRadii{0.1, 0.15, 0.2, 0.3};  // √area
    Progress progress;
    const Positions ball = shapes::sphere(6000);
    const LocalAreas on_ball = local_areas(
        coarse_shape(KdTree<3>(ball), ball, {}, {3000, {100, 800}, {}}, progress), progress);
    for (std::size_t r = 0; r < 4; ++r) {
        const double radius = kRadii[r] * std::sqrt(4.0 * std::numbers::pi);
        const double cap = 2.0 * std::numbers::pi * (1.0 - std::cos(radius));
        const auto column = on_ball.col(static_cast<Eigen::Index>(r));
        EXPECT_NEAR(column.mean(), std::log(cap / (radius * radius)), 0.25);
        EXPECT_LT((column.array() - column.mean()).abs().maxCoeff(), 0.5);
    }

    // A thin pipe: a ball of a larger radius than it is round holds
    // a stretch of it.
    constexpr double kThick = 0.05, kLong = 10.0;
    Positions pipe(6000, 3);
    Normals normals(6000, 3);
    for (Index i = 0; i < 6000; ++i) {
        const double turn = 2.0 * std::numbers::pi * std::fmod(i * 0.6180339887, 1.0);
        normals.row(i) << std::cos(turn), std::sin(turn), 0.0;
        pipe.row(i) = kThick * normals.row(i);
        pipe(i, 2) = kLong * (i + 0.5) / 6000.0;
    }
    const CoarseShape shape =
        coarse_shape(KdTree<3>(pipe), normals, {}, {3000, {100, 800}, {}}, progress);
    const LocalAreas on_pipe = local_areas(shape, progress);
    const double radius = 0.3 * std::sqrt(2.0 * std::numbers::pi * kThick * kLong);
    Index middle;
    (shape.positions.col(2).array() - 0.5 * kLong).abs().minCoeff(&middle);
    const double band =
        std::log(2.0 * std::numbers::pi * kThick * 2.0 * radius / (radius * radius));
    EXPECT_LT(on_pipe(middle, 3), band + 0.1);
    EXPECT_GT(on_pipe(middle, 3), band - 0.5);
    EXPECT_LT(on_pipe(middle, 3), on_ball.col(3).mean() - 0.3);

    // Turned and grown, it is the same.
    CoarseShape turned = shape;
    turned.positions = 3.0 * turned.positions * shapes::rotation(5).transpose();
    turned.areas *= 9.0;
    EXPECT_LT((local_areas(turned, progress) - on_pipe).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(Example, CoarseShape) {
    const Positions positions = shapes::sphere(4000);
    const Normals& normals = positions;
    const std::vector<Index> feature_rows{3999, 17};
    Progress progress;
    // --- example
    const KdTree<3> tree(positions);
    const CoarseShape shape = coarse_shape(tree, normals, feature_rows,
                                           {.points = 1000, .nodes = {200}, .graph = {}}, progress);
    const Index cloud_row = shape.cloud_rows[0];
    // --- end of the example
    EXPECT_EQ(cloud_row, 3999);
    EXPECT_NEAR(shape.size(), 1000, 100);
}

}  // namespace
}  // namespace pointmorph

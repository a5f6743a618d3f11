#include "pointmorph/disk/decomposition.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "disk/cut_ground.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

const std::vector<std::string> kNames{"a", "b", "c", "d", "e", "f", "g", "h"};

/// A closed shape, and the sample nearest to a place.
struct Shape {
    explicit Shape(Positions p, Normals n)
        : positions(std::move(p)), normals(std::move(n)), tree(positions) {
        Progress progress;
        nearest = nearest_neighbors(tree, 16, progress);
    }

    Index at(double x, double y, double z) const {
        const Vector3 query(x, y, z);
        Index row;
        double squared;
        tree.nearest(query.data(), {&row, 1}, {&squared, 1});
        return row;
    }

    Decomposition cut(const std::vector<Index>& loop, DecompositionOptions options = {}) const {
        Progress progress;
        return decompose(surface(), tree, {loop, std::span(kNames).first(loop.size())}, options,
                         progress);
    }
    /// Along the first of these features.
    Decomposition cut(const std::vector<Index>& features, std::size_t in_loop) const {
        Progress progress;
        return decompose(surface(), tree, {features, std::span(kNames).first(in_loop)}, {},
                         progress);
    }

    SampledSurface surface() const { return {positions, normals, nearest, "shape"}; }

    Positions positions;
    Normals normals;
    KdTree<3> tree;
    Neighborhoods nearest;
};

Shape ball(Index count) {
    const Positions p = shapes::sphere(count);
    return Shape(p, p);
}

/// A flat body with four arms along ±x and ±y, pinched in between: r(direction) around the origin.
Shape star(Index count) {
    Positions p = shapes::sphere(count);
    const auto radius = [](const Eigen::RowVector3d& d) {
        return 0.35 + 1.2 * std::pow(d.x(), 8) + 1.2 * std::pow(d.y(), 8);
    };
    Normals n(count, 3);
    for (Index i = 0; i < count; ++i) {
        const Vector3 d = p.row(i).transpose();
        const Vector3 right = d.unitOrthogonal(), up = d.cross(right);
        constexpr double kStep = 1e-5;
        const auto surface = [&](const Vector3& v) -> Vector3 {
            const Vector3 u = v.normalized();
            return radius(u.transpose()) * u;
        };
        n.row(i) = (surface(d + kStep * right) - surface(d - kStep * right))
                       .cross(surface(d + kStep * up) - surface(d - kStep * up))
                       .normalized()
                       .transpose();
        p.row(i) = surface(d).transpose();
    }
    return Shape(p, n);
}

TEST(Decomposition, CutsASphereAtItsEquator) {
    const Shape shape = ball(6000);
    const std::vector<Index> loop{shape.at(1, 0, 0), shape.at(0, 1, 0), shape.at(-1, 0, 0),
                                  shape.at(0, -1, 0)};
    const Decomposition cut = shape.cut(loop);
    const double h = std::sqrt(4.0 * std::numbers::pi / 6000);
    ASSERT_EQ(cut.corners.size(), 4u);
    EXPECT_EQ(cut.corners.front(), 0);
    EXPECT_TRUE(std::ranges::is_sorted(cut.corners));
    for (std::size_t k = 0; k < 4; ++k) {
        EXPECT_EQ(cut.curve.points.row(cut.corners[k]), shape.positions.row(loop[k]));
        EXPECT_EQ(cut.patches[to_size(loop[k])], Patch::kCurve);
    }
    double length = 0.0;
    for (Index i = 0; i < cut.curve.size(); ++i) {
        const double step =
            (cut.curve.points.row((i + 1) % cut.curve.size()) - cut.curve.points.row(i)).norm();
        length += step;
        EXPECT_LT(step, 1.6 * h);
        EXPECT_NEAR(cut.curve.points.row(i).norm(), 1.0, 5e-3);
        EXPECT_LT(std::abs(cut.curve.points(i, 2)), 3.0 * h);
    }
    EXPECT_NEAR(length, 2.0 * std::numbers::pi, 0.1);
    // Anticlockwise seen from above: the north lies on the left.
    for (Index i = 0; i < 6000; ++i) {
        const double z = shape.positions(i, 2);
        const Patch patch = cut.patches[to_size(i)];
        if (std::abs(z) > 3.0 * h) {
            EXPECT_EQ(patch, z > 0.0 ? Patch::kLeft : Patch::kRight);
        }
    }
}

TEST(Decomposition, OfAReversedLoopSwapsLeftAndRight) {
    const Shape shape = star(5000);
    std::vector<Index> loop{shape.at(2, 0, 0), shape.at(0, 2, 0), shape.at(-2, 0, 0),
                            shape.at(0, -2, 0)};
    const Decomposition there = shape.cut(loop);
    std::ranges::reverse(loop);
    const Decomposition back = shape.cut(loop);
    Index same = 0;
    for (std::size_t i = 0; i < there.patches.size(); ++i)
        same += there.patches[i] == back.patches[i];
    EXPECT_LT(same, 5000 / 20);  // points next to the curve may differ
}

TEST(Decomposition, SplitsEveryLimbBetweenBothPatches) {
    const Shape shape = star(8000);
    const Decomposition cut =
        shape.cut({shape.at(2, 0, 0), shape.at(0, 2, 0), shape.at(-2, 0, 0), shape.at(0, -2, 0)});
    // Upper half left, lower half right, on the body and on each arm.
    for (const auto& [x, y] : {std::pair{1, 0}, {0, 1}, {-1, 0}, {0, -1}}) {
        std::array<Index, 2> right_side{}, all{};
        for (Index i = 0; i < 8000; ++i) {
            const Eigen::RowVector3d p = shape.positions.row(i);
            if (p.x() * x + p.y() * y < 0.8) continue;  // the outer half of this arm
            const bool upper = shape.normals(i, 2) > 0.0;
            ++all[upper];
            right_side[upper] += cut.patches[to_size(i)] == (upper ? Patch::kLeft : Patch::kRight);
        }
        for (const bool upper : {false, true}) {
            ASSERT_GT(all[upper], 50);
            EXPECT_GT(right_side[upper], 0.8 * all[upper]);
        }
    }
}

TEST(Decomposition, FindsTipsThatCarryNoFeature) {
    const Shape shape = star(6000);
    const Index west = shape.at(-2, 0, 0);
    const Decomposition cut = shape.cut({shape.at(2, 0, 0), shape.at(0, 2, 0), shape.at(0, -2, 0)});
    ASSERT_EQ(cut.unmarked.rows.size(), 1u);
    EXPECT_LT((shape.positions.row(cut.unmarked.rows[0]) - shape.positions.row(west)).norm(), 0.15);
    ASSERT_EQ(cut.unmarked.distances.rows(), 1);
    ASSERT_EQ(cut.unmarked.distances.cols(), 3);
    EXPECT_GT(cut.unmarked.distances.minCoeff(), 0.5);
    DecompositionOptions none;
    none.extremities = 0;
    EXPECT_TRUE(shape.cut({shape.at(2, 0, 0), shape.at(0, 2, 0), shape.at(0, -2, 0)}, none)
                    .unmarked.rows.empty());
}

TEST(Decomposition, RefusesALoopThatCrossesItself) {
    const Shape shape = star(5000);
    // East, west, north, south: the second way crosses the fourth in any case.
    try {
        shape.cut({shape.at(1, 0.02, 0.35), shape.at(-2, 0, 0), shape.at(0, 2, 0),
                   shape.at(0, -2, 0), shape.at(2, 0, 0), shape.at(-1, 0.02, 0.35)});
        FAIL() << "taken";
    } catch (const FeatureError& error) {
        EXPECT_NE(std::string(error.what()).find("cross"), std::string::npos) << error.what();
    }
}

TEST(Decomposition, RefusesALoopThatDividesNothing) {
    const Positions p = shapes::torus(5000, 0.4);
    Normals n(5000, 3);
    for (Index i = 0; i < 5000; ++i) {
        const double a = std::atan2(p(i, 1), p(i, 0));
        n.row(i) = (p.row(i) - Eigen::RowVector3d(std::cos(a), std::sin(a), 0.0)).normalized();
    }
    const Shape shape(p, n);
    EXPECT_THROW(shape.cut({shape.at(1.4, 0, 0), shape.at(1, 0, 0.4), shape.at(0.6, 0, 0),
                            shape.at(1, 0, -0.4)}),
                 TopologyError);
}

TEST(Decomposition, RefusesASpeck) {
    const Shape shape = ball(4000);
    EXPECT_THROW(
        shape.cut({shape.at(1, 0.08, 0), shape.at(1, -0.04, 0.07), shape.at(1, -0.04, -0.07)}),
        TopologyError);
}

TEST(Decomposition, IsTheSameForAnyNumberOfThreadsAndAnyPose) {
    const Shape shape = star(4000);
    const std::vector<Index> loop{shape.at(2, 0, 0), shape.at(0, 2, 0), shape.at(-2, 0, 0),
                                  shape.at(0, -2, 0)};
    Decomposition one, many;
    {
        const ThreadCount threads(1);
        one = shape.cut(loop);
    }
    {
        const ThreadCount threads(4);
        many = shape.cut(loop);
    }
    EXPECT_EQ(one.curve.points, many.curve.points);
    EXPECT_EQ(one.patches, many.patches);

    const Matrix3 turn = shapes::rotation(3);
    const Shape turned((1e3 * shape.positions * turn.transpose()).eval(),
                       (shape.normals * turn.transpose()).eval());
    const Decomposition same = turned.cut(loop);
    Index differ = 0;
    for (std::size_t i = 0; i < one.patches.size(); ++i)
        differ += one.patches[i] != same.patches[i];
    EXPECT_LT(differ, 4000 / 100);
}

TEST(Decomposition, LeadsTheCurveRoundAFeature) {
    // Round the equator; two free features a little off it, one of them left as it is.
    const Shape shape = ball(6000);
    const Index below = shape.at(std::cos(0.7), std::sin(0.7), -0.15);
    const Index above = shape.at(std::cos(-2.3), std::sin(-2.3), 0.15);
    const std::vector<Index> features{
        shape.at(1, 0, 0), shape.at(0, 1, 0), shape.at(-1, 0, 0), shape.at(0, -1, 0), below, above};
    const auto cut = [&](std::vector<Patch> wanted) {
        Progress progress;
        return decompose(shape.surface(), shape.tree,
                         {features, std::span(kNames).first(4), wanted}, {}, progress);
    };
    const auto side = [](const Decomposition& of, Index row) { return of.patches[to_size(row)]; };
    const Decomposition plain = cut({});
    const Patch up = side(plain, shape.at(0, 0, 1)), down = side(plain, shape.at(0, 0, -1));
    ASSERT_NE(up, down);
    ASSERT_EQ(side(plain, below), down);
    ASSERT_EQ(side(plain, above), up);

    const Decomposition led = cut({up, up});
    EXPECT_EQ(side(led, below), up);
    EXPECT_EQ(side(led, above), up);
    EXPECT_EQ(side(led, shape.at(0, 0, 1)), up);
    EXPECT_EQ(side(led, shape.at(0, 0, -1)), down);
    EXPECT_GT(std::ranges::count(led.patches, down), 6000 * 0.35);
    EXPECT_EQ(led.corners.size(), 4u);
    for (const std::vector<Patch>& kept : {std::vector{down, up}, std::vector{Patch::kCurve, up}})
        EXPECT_EQ(cut(kept).curve.points, plain.curve.points);
}

TEST(Decomposition, TakesCloudsOfFewPoints) {
    const Shape shape = ball(60);
    const Decomposition cut =
        shape.cut({shape.at(1, 0, 0), shape.at(-0.5, 0.9, 0), shape.at(-0.5, -0.9, 0)});
    EXPECT_TRUE(cut.curve.points.allFinite());
    EXPECT_GT(std::ranges::count(cut.patches, Patch::kLeft), 15);
    EXPECT_GT(std::ranges::count(cut.patches, Patch::kRight), 15);
}

TEST(Decomposition, IsTheSameOnAGroundWithTheFeaturesInAnotherOrder) {
    const Shape shape = star(5000);
    const std::vector<Index> features{shape.at(2, 0, 0), shape.at(0, 2, 0), shape.at(-2, 0, 0),
                                      shape.at(0, -2, 0), shape.at(0.3, 0.3, 0.3)};
    const std::vector<Index> others{features[4], features[2], features[0], features[3],
                                    features[1]};
    Progress progress;
    const CutGround ground(shape.surface(), shape.tree, others, {}, progress);
    EXPECT_TRUE(ground.has(features));
    EXPECT_FALSE(ground.has(std::span(features).first(4)));
    const CutRequest request{features, std::span(kNames).first(4)};
    const Decomposition one = decompose(ground, request, {}, progress);
    const Decomposition other = shape.cut(features, 4);
    EXPECT_EQ(one.curve.points, other.curve.points);
    EXPECT_EQ(one.corners, other.corners);
    EXPECT_EQ(one.patches, other.patches);

    const CutGround again(ground, features);
    const CutGround direct(shape.surface(), shape.tree, features, {}, progress);
    EXPECT_EQ(again.coarse.rows, direct.coarse.rows);
    EXPECT_EQ(again.coarse.cells, direct.coarse.cells);
    EXPECT_EQ(again.coarse.graph.neighbors, direct.coarse.graph.neighbors);
    EXPECT_EQ(again.coarse.graph.lengths, direct.coarse.graph.lengths);
    EXPECT_EQ(again.from, direct.from);
}

TEST(Decomposition, ProposesATourThroughTheFeaturesAtExtremities) {
    const Shape shape = star(5000);
    const std::vector<Index> features{shape.at(2, 0, 0), shape.at(-2, 0, 0),  // opposite tips
                                      shape.at(0, 0, 1),                      // in the middle
                                      shape.at(0, 2, 0), shape.at(0, -2, 0)};
    Progress progress;
    const FeatureReach reach = feature_reach(shape.surface(), shape.tree, features, {}, progress);
    EXPECT_EQ(reach.at_extremity, (std::vector<char>{1, 1, 0, 1, 1}));
    EXPECT_LT((reach.distances - reach.distances.transpose()).cwiseAbs().maxCoeff(), 1e-9);
    std::vector<Index> loop = propose_loop(reach, reach);
    ASSERT_EQ(loop.size(), 4u);
    EXPECT_EQ(loop.front(), 0);
    std::ranges::sort(loop);
    EXPECT_EQ(loop, (std::vector<Index>{0, 1, 3, 4}));
}

TEST(Decomposition, ProposesTheShortestOfAllTours) {
    // Six places around a circle, in an order that jumps about: the tour is the circle.
    const std::vector<int> angle{0, 3, 1, 5, 2, 4};
    FeatureReach reach{Eigen::MatrixXd(6, 6), std::vector<char>(6, 1)};
    for (Eigen::Index i = 0; i < 6; ++i)
        for (Eigen::Index j = 0; j < 6; ++j)
            reach.distances(i, j) =
                std::sin(std::numbers::pi / 6 * std::abs(angle[to_size(i)] - angle[to_size(j)]));
    const std::vector<Index> tour = propose_loop(reach, reach);
    ASSERT_EQ(tour.size(), 6u);
    for (std::size_t i = 0; i < 6; ++i) {
        const int step = std::abs(angle[to_size(tour[i])] - angle[to_size(tour[(i + 1) % 6])]);
        EXPECT_TRUE(step == 1 || step == 5);
    }
    EXPECT_TRUE(propose_loop({Eigen::MatrixXd(0, 0), {}}, {Eigen::MatrixXd(0, 0), {}}).empty());
}

TEST(Example, Decomposition) {
    const Shape ball_shape = ball(3000);
    const Positions& positions = ball_shape.positions;
    const Normals& normals = ball_shape.normals;
    const Neighborhoods& nearest = ball_shape.nearest;
    const std::vector<Index> rows{ball_shape.at(1, 0, 0), ball_shape.at(0, 1, 0),
                                  ball_shape.at(-1, 0, 0), ball_shape.at(0, -1, 0)};
    const std::vector<std::string> names{"front", "left", "back", "right"};
    Progress progress;
    // --- example
    const KdTree<3> tree(positions);
    const Decomposition cut =
        decompose({positions, normals, nearest, "ball"}, tree, {rows, names}, {}, progress);
    const Positions& curve = cut.curve.points;
    const bool is_left = cut.patches[0] == Patch::kLeft;
    // --- end of the example
    // Along the equator, anticlockwise seen from the pole, where the first point is.
    EXPECT_TRUE(is_left);
    EXPECT_LT(curve.col(2).cwiseAbs().maxCoeff(), 0.1);
}

}  // namespace
}  // namespace pointmorph

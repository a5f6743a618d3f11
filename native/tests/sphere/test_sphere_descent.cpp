#include "sphere/sphere_descent.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "sphere/sphere_embedding.hpp"
#include "sphere/sphere_triangulation.hpp"

namespace pointmorph {
namespace {

Positions random_directions(Index count, unsigned seed, double size = 1.0) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    Positions result(count, 3);
    for (Index i = 0; i < count; ++i)
        result.row(i) << size * normal(random), size * normal(random), size * normal(random);
    return result;
}

struct HullOnSphere {
    Positions places;
    std::vector<Triangle> triangles;

    explicit HullOnSphere(Index count)
        : places(random_directions(count, 5).rowwise().normalized()),
          triangles(hull_on_sphere(places).triangles()) {}
    Index size() const { return to_index(places.rows()); }
};

double corners_determinant(const Positions& places, const Triangle& t) {
    return places.row(t[0]).dot(Eigen::RowVector3d(places.row(t[1])).cross(places.row(t[2])));
}

/// The sum of squared distances from some places, infinite where a triangle is turned over.
struct GoalPull {
    const HullOnSphere& ball;
    Positions goals;
    Positions last{};
    int looks = 0;

    double at(const Positions& places) {
        last = places;
        ++looks;
        for (const Triangle& t : ball.triangles)
            if (!(corners_determinant(places, t) > 0.0))
                return std::numeric_limits<double>::infinity();
        return (places - goals).squaredNorm();
    }

    void add_gradient(const Positions& places, Positions& gradient) const {
        EXPECT_EQ(places, last);
        gradient += 2.0 * (places - goals);
    }
};

TEST(SphereDescent, ASmootherInvertsItsLaplacian) {
    const HullOnSphere ball(60);
    std::vector<Vector3> weights;
    for (std::size_t t = 0; t < ball.triangles.size(); ++t)
        weights.emplace_back(0.2 + 0.1 * static_cast<double>(t % 7), 0.5, 1.0);
    const std::array<Index, 3> fixed{4, 17, 59};
    Smoother smooth(ball.triangles, ball.size(), fixed, weights);
    const Values scales = 1.0 + 0.5 * random_directions(ball.size(), 6).col(0).array().abs();
    smooth.set_scales(scales);

    Eigen::MatrixXd laplacian = Eigen::MatrixXd::Zero(ball.size(), ball.size());
    for (std::size_t t = 0; t < ball.triangles.size(); ++t)
        for (int k = 0; k < 3; ++k) {
            const Index a = ball.triangles[t][to_size((k + 1) % 3)],
                        b = ball.triangles[t][to_size((k + 2) % 3)];
            for (const Index v : {a, b}) laplacian(v, v) += 1.001 * weights[t][k];
            laplacian(a, b) -= weights[t][k];
            laplacian(b, a) -= weights[t][k];
        }
    const Positions directions = random_directions(ball.size(), 7);
    const Positions smoothed = smooth(directions), extended = smooth.extended(directions);
    const Eigen::MatrixXd back =
        scales.matrix().asDiagonal() * laplacian * (scales.matrix().asDiagonal() * smoothed);
    const Eigen::MatrixXd left = laplacian * (scales.matrix().asDiagonal() * extended);
    for (Index v = 0; v < ball.size(); ++v) {
        const bool is_fixed = std::ranges::find(fixed, v) != fixed.end();
        if (is_fixed) {
            EXPECT_EQ(smoothed.row(v).norm(), 0.0);
            EXPECT_EQ(extended.row(v), directions.row(v));
        } else {
            EXPECT_LT((back.row(v) - directions.row(v)).norm(), 1e-10) << v;
        }
    }
    // After other weights, the same to the bit.
    Smoother later(ball.triangles, ball.size(), fixed);
    later.set_weights(weights);
    later.set_scales(scales);
    EXPECT_EQ(later(directions), smoothed);
    EXPECT_EQ(later.extended(directions), extended);
    // Without scales, what goes on from the fixed ones pulls at no other.
    const Smoother plain(ball.triangles, ball.size(), fixed, weights);
    const Eigen::MatrixXd pulls = laplacian * plain.extended(directions);
    for (Index v = 0; v < ball.size(); ++v)
        if (std::ranges::find(fixed, v) == fixed.end()) {
            EXPECT_LT(pulls.row(v).norm(), 1e-10) << v;
        }
}

TEST(SphereDescent, FoldsAreWhereATriangleIsTurnedOver) {
    const HullOnSphere ball(80);
    Folds folds(ball.triangles);
    int found = 0, free = 0;
    for (unsigned seed = 0; seed < 60; ++seed) {
        const Positions way = random_directions(ball.size(), 100 + seed, 0.05);
        for (const double length : {1.0, 0.5, 0.25, 0.125, 0.0}) {
            const Positions there = ball.places + length * way;
            const bool expected = std::ranges::any_of(ball.triangles, [&](const Triangle& t) {
                return !(corners_determinant(there, t) > 0.0);
            });
            EXPECT_EQ(folds.turn_over(ball.places, way, length), expected);
            ++(expected ? found : free);
        }
    }
    EXPECT_GT(found, 30);
    EXPECT_GT(free, 60);
}

TEST(SphereDescent, DescentEndsWhereNothingPullsOrATriangleWouldTurnOver) {
    const HullOnSphere ball(120);
    const Smoother smooth(ball.triangles, ball.size(), {});
    Progress progress;
    // A turn that leaves all triangles as they are can be followed to its end.
    Matrix3 turn;
    turn = Eigen::AngleAxisd(0.4, Vector3(1.0, 2.0, -1.0).normalized());
    GoalPull pull{ball, ball.places * turn};
    Positions places = ball.places;
    const double before = pull.at(places);
    const double left = descend(places, ball.triangles, smooth, 200, pull, progress);
    EXPECT_LT(left, 1e-6 * before);
    EXPECT_LT((places.rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-12);

    // Goals that exchange places can't be reached, and no look goes where something is turned over.
    GoalPull exchange{ball, -ball.places};
    Positions stuck = ball.places;
    const double gained = descend(stuck, ball.triangles, smooth, 30, exchange, progress);
    EXPECT_LE(gained, exchange.at(ball.places));
    for (const Triangle& t : ball.triangles) EXPECT_GT(corners_determinant(stuck, t), 0.0);
}

TEST(SphereDescent, RoundnessIsTheSumOverTriangles) {
    const HullOnSphere ball(40);  // 76 triangles: no multiple of what is looked at together
    const double area = 4.0 * std::numbers::pi / static_cast<double>(ball.triangles.size());
    double sum = 0.0;
    for (const Triangle& t : ball.triangles) {
        double sides = 0.0;
        for (std::size_t k = 0; k < 3; ++k)
            sides += (ball.places.row(t[k]) - ball.places.row(t[(k + 1) % 3])).squaredNorm();
        const double d = corners_determinant(ball.places, t) / (2.0 * area);
        sum += sides / (2.0 * std::numbers::sqrt3) * (1.0 + 1.0 / (d * d));
    }
    const Roundness roundness(ball.triangles, 0.7);
    EXPECT_NEAR(roundness.at(ball.places), 0.7 * sum, 1e-10 * sum);
    EXPECT_GT(sum, 4.0 * area * static_cast<double>(ball.triangles.size()));

    std::vector<Triangle> turned = ball.triangles;
    std::swap(turned.back()[0], turned.back()[1]);
    EXPECT_EQ(Roundness(turned, 0.7).at(ball.places), std::numeric_limits<double>::infinity());
}

TEST(SphereDescent, RoundnessHasTheGradientThatDifferencesShow) {
    const HullOnSphere ball(20);
    const Roundness roundness(ball.triangles, 0.7);
    constexpr double kStep = 1e-7;
    Positions gradient = Positions::Zero(ball.size(), 3);
    roundness.add_gradient(ball.places, gradient);
    for (Index v = 0; v < ball.size(); ++v)
        for (Index axis = 0; axis < 3; ++axis) {
            Positions above = ball.places, below = ball.places;
            above(v, axis) += kStep;
            below(v, axis) -= kStep;
            const double slope = (roundness.at(above) - roundness.at(below)) / (2.0 * kStep);
            EXPECT_NEAR(gradient(v, axis), slope, 1e-6 * gradient.norm());
        }
}

}  // namespace
}  // namespace pointmorph

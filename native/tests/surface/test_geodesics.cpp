#include "pointmorph/surface/geodesics.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "pointmorph/cloud/neighborhoods.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

/// A cloud with all that a search for geodesics needs.
struct Surface {
    Surface(Positions p, Normals n)
        : positions(std::move(p)), normals(std::move(n)), tree(positions) {
        Progress progress;
        graph = surface_graph(tree, normals, {}, progress);
        spacing = local_spacing(positions, nearest_neighbors(tree, 16, progress)).mean();
    }

    Index at(double x, double y, double z) const {
        const Vector3 query(x, y, z);
        Index row;
        double squared;
        tree.nearest(query.data(), {&row, 1}, {&squared, 1});
        return row;
    }

    SurfaceCurve between(Index a, Index b) const {
        Progress progress;
        return geodesic(tree, normals, cheapest_path(graph, a, b, {}), spacing, progress);
    }

    Positions positions;
    Normals normals;
    KdTree<3> tree;
    SurfaceGraph graph;
    double spacing;
};

Surface torus(Index count, double tube) {
    const Positions p = shapes::torus(count, tube);
    Normals n(count, 3);
    for (Index i = 0; i < count; ++i) {
        const double a = std::atan2(p(i, 1), p(i, 0));
        n.row(i) = (p.row(i) - Eigen::RowVector3d(std::cos(a), std::sin(a), 0.0)).normalized();
    }
    return {p, n};
}

/// Uniform random points of the cylinder of radius 1 from z = −1 to 1.
Surface cylinder(Index count) {
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    Positions p(count, 3);
    Normals n(count, 3);
    for (Index i = 0; i < count; ++i) {
        const double a = 2 * std::numbers::pi * uniform(random), z = 2 * uniform(random) - 1;
        n.row(i) << std::cos(a), std::sin(a), 0.0;
        p.row(i) << std::cos(a), std::sin(a), z;
    }
    return {p, n};
}

TEST(Geodesics, CheapestPathIsThatOfBellmanAndFord) {
    const Positions p = shapes::cube_noise(80);
    const Surface cloud(p, Normals::Constant(80, 3, 1.0 / std::sqrt(3.0)));
    std::mt19937_64 random(2);
    std::uniform_real_distribution<double> uniform(0.5, 3.0);
    Values costs(80);
    for (Index i = 0; i < 80; ++i) costs[i] = uniform(random);
    const auto cost = [&](Index i, std::size_t e) {
        return cloud.graph.lengths[e] * 0.5 * (costs[i] + costs[cloud.graph.neighbors[e]]);
    };
    std::vector<double> least(80, 1e9);
    least[0] = 0.0;
    for (int round = 0; round < 80; ++round)
        for (std::size_t i = 0; i < 80; ++i)
            for (auto e = to_size(cloud.graph.offsets[i]); e < to_size(cloud.graph.offsets[i + 1]);
                 ++e) {
                double& other = least[to_size(cloud.graph.neighbors[e])];
                other = std::min(other, least[i] + cost(to_index(i), e));
            }
    for (Index to = 0; to < 80; ++to) {
        const auto path = cheapest_path(cloud.graph, 0, to, costs);
        ASSERT_EQ(path.front(), 0);
        ASSERT_EQ(path.back(), to);
        double sum = 0.0;
        for (std::size_t k = 1; k < path.size(); ++k) {
            const auto i = to_size(path[k - 1]);
            auto e = to_size(cloud.graph.offsets[i]);
            while (cloud.graph.neighbors[e] != path[k]) ++e;
            ASSERT_LT(e, to_size(cloud.graph.offsets[i + 1]));
            sum += cost(path[k - 1], e);
        }
        EXPECT_NEAR(sum, least[to_size(to)], 1e-12);
    }
}

TEST(Geodesics, OfASphereAreArcsOfGreatCircles) {
    const Positions p = shapes::sphere(4000);
    const Surface sphere(p, p);
    for (const Index to : {Index{600}, Index{1900}, Index{3100}}) {
        const SurfaceCurve curve = sphere.between(3, to);
        const double arc = std::acos(p.row(3).dot(p.row(to)));
        EXPECT_NEAR(curve_length(curve.points), arc, 2e-3 * arc);
        const Eigen::RowVector3d across = p.row(3).cross(p.row(to)).normalized();
        for (Index i = 0; i < curve.size(); ++i) {
            EXPECT_NEAR(curve.points.row(i).norm(), 1.0, 2e-3);
            EXPECT_NEAR(curve.points.row(i).dot(across), 0.0, 0.5 * sphere.spacing);
            EXPECT_GT(curve.normals.row(i).dot(curve.points.row(i)), 0.99);
        }
    }
}

TEST(Geodesics, OfACylinderAreHelices) {
    const Surface cloud = cylinder(6000);
    const Index a = cloud.at(1, 0, -0.8), b = cloud.at(-0.6, 0.8, 0.7);
    const auto angle = [&](Index i) {
        return std::atan2(cloud.positions(i, 1), cloud.positions(i, 0));
    };
    const double expected =
        std::hypot(angle(b) - angle(a), cloud.positions(b, 2) - cloud.positions(a, 2));
    EXPECT_NEAR(curve_length(cloud.between(a, b).points), expected, 4e-3 * expected);
}

TEST(Geodesics, OfATorusFollowTheTube) {
    const Surface cloud = torus(8000, 0.4);
    const Index outside = cloud.at(1.4, 0, 0), inside = cloud.at(0.6, 0, 0);
    // Both ends are samples near to the ends of the half circle.
    EXPECT_NEAR(curve_length(cloud.between(outside, inside).points), 0.4 * std::numbers::pi,
                2.0 * cloud.spacing);
    const Index there = cloud.at(0, 0.6, 0);  // along the inner equator
    EXPECT_NEAR(curve_length(cloud.between(inside, there).points), 0.3 * std::numbers::pi,
                2.0 * cloud.spacing);
}

TEST(Geodesics, AreShorterAndSmootherThanGraphPaths) {
    const Surface cloud = torus(5000, 0.4);
    const Index a = cloud.at(1.4, 0, 0), b = cloud.at(-0.9, 0.3, 0.4);
    const auto path = cheapest_path(cloud.graph, a, b, {});
    Positions zigzag(static_cast<Eigen::Index>(path.size()), 3);
    for (std::size_t i = 0; i < path.size(); ++i)
        zigzag.row(static_cast<Eigen::Index>(i)) = cloud.positions.row(path[i]);
    const SurfaceCurve curve = cloud.between(a, b);
    EXPECT_LT(curve_length(curve.points), curve_length(zigzag));
    EXPECT_EQ(curve.points.row(0), cloud.positions.row(a));
    EXPECT_EQ(curve.points.row(curve.size() - 1), cloud.positions.row(b));
    for (Index i = 1; i + 1 < curve.size(); ++i) {
        const Eigen::RowVector3d in = curve.points.row(i) - curve.points.row(i - 1);
        const Eigen::RowVector3d out = curve.points.row(i + 1) - curve.points.row(i);
        EXPECT_GT(in.dot(out), std::cos(0.5) * in.norm() * out.norm());  // radians
    }
}

TEST(Geodesics, FromAPointToItselfIsThatPoint) {
    const Positions p = shapes::sphere(200);
    const SurfaceCurve curve = Surface(p, p).between(7, 7);
    EXPECT_TRUE(curve.points.allFinite());
    EXPECT_LT(curve_length(curve.points), 1e-9);
}

TEST(Geodesics, ResamplingKeepsEndsAndLength) {
    SurfaceCurve corner{Positions(3, 3), Normals(3, 3)};
    corner.points << 0, 0, 0, 1, 0, 0, 1, 2, 0;
    corner.normals << 0, 0, 1, 0, 0, 1, 0, 0, 1;
    const SurfaceCurve fine = resampled(corner, 0.25);
    EXPECT_EQ(fine.size(), 13);
    EXPECT_EQ(fine.points.row(0), corner.points.row(0));
    EXPECT_EQ(fine.points.row(12), corner.points.row(2));
    EXPECT_NEAR(curve_length(fine.points), 3.0, 1e-12);
    for (Index i = 1; i < fine.size(); ++i)
        EXPECT_NEAR((fine.points.row(i) - fine.points.row(i - 1)).norm(), 0.25, 1e-12);
}

TEST(Example, Geodesics) {
    const Surface ball(shapes::sphere(4000), shapes::sphere(4000));
    const auto& [positions, normals, tree, graph, spacing] = ball;
    const Index nose = ball.at(1, 0, 0), tail = ball.at(0, 1, 0);
    Progress progress;
    // --- example
    const std::vector<Index> path = cheapest_path(graph, nose, tail, {});
    const SurfaceCurve curve = geodesic(tree, normals, path, spacing, progress);
    const double length = curve_length(curve.points);
    // --- end of the example
    EXPECT_EQ(path.front(), nose);
    EXPECT_NEAR(length, 0.5 * std::numbers::pi, 0.06);
}

}  // namespace
}  // namespace pointmorph

#include "mesh/relaxing.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

#include "mesh/creases.hpp"
#include "mesh/elastic_sheet.hpp"
#include "mesh/mesh_edges.hpp"
#include "mesh_shapes.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/mesh/mesh.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// A ball whose vertices have slid on it, without a face turned over.
struct Uneven {
    Mesh mesh;
    Progress progress;
    ElasticSheet sheet;
    double radius;
    Positions x;
    RelaxGround ground;

    explicit Uneven(unsigned seed = 3)
        : mesh(make_mesh(mesh_shapes::icosphere(3))),
          sheet(mesh.positions, mesh.triangles, progress),
          radius(mesh.positions.row(0).norm()),
          x(mesh.positions) {
        const double spacing = 2.0 * radius * std::sqrt(3.14 / static_cast<double>(x.rows()));
        std::mt19937_64 random(seed);
        std::normal_distribution<double> normal(0.0, 0.12 * spacing);
        for (Index v = 0; v < x.rows(); ++v) {
            const Vector3 noise(normal(random), normal(random), normal(random));
            x.row(v) = radius * (x.row(v).transpose() + noise).normalized().transpose();
        }
        ground.landed = [r = radius](Index, const Vector3& place, const Vector3&) {
            const Vector3 side = place.normalized();
            return std::pair<Vector3, Vector3>(r * side, side);
        };
        ground.is_fixed.assign(to_size(x.rows()), 0);
        ground.sides = x / radius;
    }

    Positions relaxed(Index iterations) {
        Positions result = x;
        relax(mesh, sheet, ground, iterations, result, progress);
        return result;
    }
    /// How differently the areas of neighboring faces have grown.
    double unevenness(const Positions& places) const {
        const Creases creases(mesh, sheet);
        const auto growth = [&](Index f) {
            return std::log(creases.facing(places, f).norm() / mesh.areas[f]);
        };
        const MeshEdges edges(mesh.triangles);
        double sum = 0.0;
        for (Index e = 0; e < edges.size(); ++e)
            sum += std::pow(growth(edges[e][0].triangle) - growth(edges[e][1].triangle), 2);
        return sum / edges.size();
    }
    /// The least cosine between a face and the ball.
    double least_agreement(const Positions& places) const {
        const Creases creases(mesh, sheet);
        double least = 1.0;
        for (Index f = 0; f < mesh.triangles.rows(); ++f) {
            const auto t = mesh.triangles.row(f);
            const Vector3 middle =
                (places.row(t[0]) + places.row(t[1]) + places.row(t[2])).transpose();
            least =
                std::min(least, creases.facing(places, f).normalized().dot(middle.normalized()));
        }
        return least;
    }
};

TEST(Relaxing, MakesFacesMoreEvenTheLongerItGoesOn) {
    Uneven ball;
    double before = ball.unevenness(ball.x);
    EXPECT_GT(before, 0.05);
    const double start = before;
    for (const Index iterations : {1, 3, 10, 40}) {
        const Positions x = ball.relaxed(iterations);
        const double now = ball.unevenness(x);
        EXPECT_LT(now, before) << iterations;
        EXPECT_LT((x.rowwise().norm().array() - ball.radius).abs().maxCoeff(), 1e-12);
        before = now;
    }
    EXPECT_LT(before, 0.1 * start);
}

TEST(Relaxing, DoesNothingWhereItIsNotAskedTo) {
    Uneven ball;
    EXPECT_EQ(ball.relaxed(0), ball.x);
    std::ranges::fill(ball.ground.is_fixed, 1);
    EXPECT_EQ(ball.relaxed(5), ball.x);
}

TEST(Relaxing, FixedVerticesStayToTheBit) {
    Uneven ball;
    for (Index v = 0; v < ball.x.rows(); ++v) ball.ground.is_fixed[to_size(v)] = ball.x(v, 2) > 0.0;
    const Positions x = ball.relaxed(10);
    Index moved = 0;
    for (Index v = 0; v < x.rows(); ++v) {
        if (ball.ground.is_fixed[to_size(v)]) {
            EXPECT_EQ(x.row(v), ball.x.row(v));
        }
        moved += x.row(v) != ball.x.row(v);
    }
    EXPECT_GT(moved, x.rows() / 3);
}

TEST(Relaxing, TurnsNoFaceOver) {
    SKIP_WHERE_WATCHED();
    for (const unsigned seed : {1u, 2u, 3u, 4u, 5u}) {
        Uneven ball(seed);
        const double before = ball.least_agreement(ball.x);
        ASSERT_GT(before, 0.3);
        for (const Index iterations : {1, 7, 30})
            EXPECT_GT(ball.least_agreement(ball.relaxed(iterations)), 0.3) << seed;
    }
}

TEST(Relaxing, KeepsItsDistance) {
    Uneven ball;
    ball.ground.is_onto = false;
    ball.x *= 1.1;
    const Positions x = ball.relaxed(10);
    EXPECT_LT((x.rowwise().norm().array() / (1.1 * ball.radius) - 1.0).abs().maxCoeff(), 0.02);
    EXPECT_LT(ball.unevenness(x), 0.5 * ball.unevenness(ball.x));
}

TEST(Relaxing, IsTheSameForAnyNumberOfThreads) {
    SKIP_WHERE_WATCHED();
    Uneven ball;
    const Positions all = ball.relaxed(5);
    Uneven other;
    const ThreadCount one(1);
    EXPECT_EQ(other.relaxed(5), all);
}

TEST(Relaxing, TakesFacesWithoutArea) {
    Uneven ball;
    ball.x.row(7) =
        ball.x.row(ball.sheet.laplacian().neighbors[to_size(ball.sheet.laplacian().offsets[7])]);
    EXPECT_TRUE(ball.relaxed(5).allFinite());
}

}  // namespace
}  // namespace pointmorph

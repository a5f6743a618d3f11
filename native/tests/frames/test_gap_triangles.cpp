#include "frames/gap_triangles.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "pointmorph/base/progress.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

constexpr GapTriangle kCorners{0, 1, 2};

/// Three corners anywhere; every other time nearly on a line.
Positions random_triangle(std::mt19937_64& random) {
    std::uniform_real_distribution<double> place(-1.0, 1.0);
    Positions corners(3, 3);
    for (Index i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) corners(i, k) = place(random);
    if (random() % 2 == 0) {
        const double share = place(random);
        corners.row(2) =
            0.1 * corners.row(2) + (1.0 - share) * corners.row(0) + share * corners.row(1);
    }
    return corners;
}

Normals same_normals(const Vector3& normal) {
    return normal.transpose().replicate(3, 1);
}

Vector3 facing(const Positions& corners) {
    const Vector3 first = corners.row(1) - corners.row(0), second = corners.row(2) - corners.row(0);
    return first.cross(second);
}

/// The largest distance of a place in the triangle to the nearest corner, by trying many.
double widest(const Positions& corners) {
    constexpr int kSteps = 300;
    double result = 0.0;
    for (int i = 0; i <= kSteps; ++i)
        for (int j = 0; i + j <= kSteps; ++j) {
            const double u = static_cast<double>(i) / kSteps, v = static_cast<double>(j) / kSteps;
            const Eigen::RowVector3d place =
                (1.0 - u - v) * corners.row(0) + u * corners.row(1) + v * corners.row(2);
            result = std::max(result, (corners.rowwise() - place).rowwise().norm().minCoeff());
        }
    return result;
}

bool is_wider(const Positions& corners, double radius) {
    return Wideness(corners, kCorners).is_more_than(radius);
}

/// One by one, until `take(point)` returns false.
template <class Take>
void each_sample(const Positions& corners, const SampleDistance& distance, Take&& take) {
    each_few_samples(kCorners, corners, distance, [&](const SomeSamples& samples) {
        for (std::size_t i = 0; i < samples.count; ++i)
            if (!take(samples[i])) return false;
        return true;
    });
}

TEST(GapTriangles, AreWiderThanWhatDenseSamplesSay) {
    std::mt19937_64 random(1);
    for (int trial = 0; trial < 100; ++trial) {
        const Positions corners = random_triangle(random);
        const double width = widest(corners);
        EXPECT_TRUE(is_wider(corners, 0.995 * width)) << corners;
        // No sample lies further than a step from the place that is the farthest.
        EXPECT_FALSE(is_wider(corners, 1.015 * width)) << corners;
    }
}

bool is_surely_narrow(const RoughCorner& a, const RoughCorner& b, const RoughCorner& c,
                      float radius) {
    const std::array rough{a, b, c};
    return surely_narrow(rough, std::array<GapTriangle, 1>{kCorners}, radius) != 0;
}

TEST(GapTriangles, SeveralAreAsNarrowAsEachIs) {
    constexpr float kRadius = 0.85F;
    std::mt19937_64 random(8);
    std::uniform_real_distribution<float> place(0.0F, 2.0F), spacing(0.5F, 1.5F);
    std::uniform_int_distribution<Index> row(0, 29);
    int narrow = 0, others = 0;
    for (std::size_t count = 0; count <= kTrianglesAtOnce; ++count) {
        std::vector<RoughCorner> rough(30);
        for (auto& corner : rough) corner = {place(random), place(random), 0.0F, spacing(random)};
        rough[7][1] = std::numeric_limits<float>::quiet_NaN();
        std::vector<GapTriangle> triangles(count);
        for (auto& corners : triangles) corners = {row(random), row(random), row(random)};
        const auto found = surely_narrow(rough, triangles, kRadius);
        EXPECT_EQ(found, surely_narrow(rough, triangles, kRadius, false));
        for (std::size_t i = 0; i < count; ++i) {
            const auto [a, b, c] = triangles[i];
            const bool is_narrow = ((found >> i) & 1) != 0;
            EXPECT_EQ(is_narrow, is_surely_narrow(rough[to_size(a)], rough[to_size(b)],
                                                  rough[to_size(c)], kRadius));
            ++(is_narrow ? narrow : others);
        }
        if (count < kTrianglesAtOnce) {
            EXPECT_EQ(found >> count, 0u);
        }
    }
    EXPECT_GT(narrow, 200);
    EXPECT_GT(others, 200);
}

TEST(GapTriangles, AreSurelyNarrowOnlyIfTheyAreAndMostlyThen) {
    constexpr double kRadius = 0.85;
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> place(-0.5, 0.5), share(0.2, 2.0);
    for (const double size : {0.1, 2e-3, 2e-4, 1e-6}) {
        int narrow = 0, seen = 0;
        for (int trial = 0; trial < 20'000; ++trial) {
            // Close to the limit, somewhere in the ball, between points of different spacing.
            const Vector3 spacing = size * Vector3(share(random), share(random), share(random));
            const Eigen::RowVector3d center(place(random), place(random), place(random));
            const Positions corners = (size * random_triangle(random)).rowwise() + center;
            const auto rough = [&](int k) {
                const auto at = corners.row(k).cast<float>();
                return RoughCorner{at[0], at[1], at[2], static_cast<float>(spacing[k])};
            };
            const double radius = kRadius * spacing.mean();
            const bool sure = is_surely_narrow(rough(0), rough(1), rough(2), 0.85F);
            if (sure) {
                ASSERT_FALSE(is_wider(corners, radius)) << corners;
            }
            if (is_wider(corners, 0.97 * radius)) continue;
            ++narrow;
            seen += sure ? 1 : 0;
        }
        ASSERT_GT(narrow, 5000) << size;
        if (size > 1e-4) {
            EXPECT_GT(seen, 0.95 * narrow) << size;
        }
    }
}

TEST(GapTriangles, OfNoExtentOrSpacingAreNotSurelyNarrow) {
    const RoughCorner here{0.5F, 0.5F, 0.5F, 0.0F};
    EXPECT_FALSE(is_surely_narrow(here, here, here, 0.85F));
    const RoughCorner nowhere{std::numeric_limits<float>::quiet_NaN(), 0.5F, 0.5F, 0.1F};
    EXPECT_FALSE(is_surely_narrow(here, nowhere, here, 0.85F));
}

TEST(GapTriangles, OfNoExtentAreWiderThanNothing) {
    const Positions corners = Positions::Ones(3, 3);
    EXPECT_FALSE(is_wider(corners, 1e-9));
    EXPECT_EQ(edge_length(corners, kCorners), 0.0);
    int taken = 0;
    each_sample(corners, {0.1}, [&](const InsertedPoint&) { return ++taken > 0; });
    EXPECT_EQ(taken, 0);
}

TEST(GapTriangles, ShowTheirFrontWhereTheirCornersDo) {
    std::mt19937_64 random(2);
    for (int trial = 0; trial < 50; ++trial) {
        const Positions corners = random_triangle(random);
        const Vector3 normal = facing(corners).normalized();
        EXPECT_TRUE(shows_front(corners, same_normals(normal), kCorners));
        EXPECT_FALSE(shows_front(corners, same_normals(-normal), kCorners));
        EXPECT_FALSE(shows_front(corners, same_normals(normal), {0, 2, 1}));
    }
}

TEST(GapTriangles, ThatAreLinesShowTheirFrontWhereTheirEndsAgree) {
    Positions ends = Positions::Zero(2, 3);
    ends(1, 0) = 1.0;
    Normals normals(2, 3);
    normals << 0, 0, 1, 0, 1, 1;
    EXPECT_TRUE(shows_front(ends, normals, {0, 0, 1}));
    normals.row(1) << 0, 1, -1;
    EXPECT_FALSE(shows_front(ends, normals, {0, 0, 1}));
}

TEST(GapTriangles, AreSampledEvenlyAndInsideAlone) {
    constexpr double kSpacing = 0.05;
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> share(0.0, 1.0);
    int looked_at = 0;
    for (int trial = 0; trial < 50; ++trial) {
        const Positions corners = random_triangle(random);
        std::vector<Vector3> samples;
        each_sample(corners, {kSpacing}, [&](const InsertedPoint& point) {
            EXPECT_GE(*std::ranges::min_element(point.weights), 0.0);
            EXPECT_NEAR(point.weights[0] + point.weights[1] + point.weights[2], 1.0, 1e-12);
            samples.push_back(blend(corners, point));
            return true;
        });
        // Every place that lies a spacing or more from the edges has a sample closer than that.
        const double area = facing(corners).norm();
        for (int place = 0; place < 50; ++place) {
            InsertedPoint point{kCorners, {share(random), share(random), 0.0}, {}};
            if (point.weights[0] + point.weights[1] > 1.0) continue;
            point.weights[2] = 1.0 - point.weights[0] - point.weights[1];
            double to_edges = std::numeric_limits<double>::infinity();
            for (Index c = 0; c < 3; ++c) {
                const Vector3 edge = corners.row((c + 2) % 3) - corners.row((c + 1) % 3);
                to_edges = std::min(to_edges, point.weights[to_size(c)] * area / edge.norm());
            }
            if (to_edges < kSpacing) continue;
            const Vector3 at = blend(corners, point);
            EXPECT_TRUE(std::ranges::any_of(samples, [&](const Vector3& sample) {
                return (sample - at).norm() < kSpacing;
            })) << corners;
            ++looked_at;
        }
    }
    EXPECT_GT(looked_at, 300);
}

TEST(GapTriangles, AreLeftWhenEnoughIsTaken) {
    const Positions corners = Positions::Identity(3, 3);
    int taken = 0;
    each_sample(corners, {0.01}, [&](const InsertedPoint&) { return ++taken < 5; });
    EXPECT_EQ(taken, 5);
}

TEST(GapTriangles, HaveSamplesNearTheirCorners) {
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> spacing(0.2, 0.5);
    int near_ones = 0, far_ones = 0;
    for (int trial = 0; trial < 50; ++trial) {
        const Positions places = random_triangle(random);
        const std::array spacings{spacing(random), spacing(random), spacing(random)};
        each_few_samples(kCorners, places, {0.1}, [&](const SomeSamples& samples) {
            SampledCorners corners;
            for (std::size_t c = 0; c < 3; ++c) {
                corners.places[c] = places.row(samples.corners[c]).transpose();
                corners.spacing[c] = spacings[to_size(samples.corners[c])];
            }
            const std::uint64_t near = near_corners(corners, samples, 0.85);
            EXPECT_EQ(near, near_corners(corners, samples, 0.85, false));
            for (std::size_t i = 0; i < SomeSamples::kMost; ++i) {
                if (i >= samples.count) {
                    EXPECT_EQ(near >> i, 0);
                    break;
                }
                const Vector3 at = blend(places, samples[i]);
                const double radius =
                    0.85 * blend(samples[i], [&](Index row) { return spacings[to_size(row)]; });
                double distance = std::numeric_limits<double>::infinity();
                for (const Vector3& corner : corners.places)
                    distance = std::min(distance, (corner - at).norm());
                if (std::abs(distance - radius) < 1e-12) continue;
                EXPECT_EQ((near >> i & 1) != 0, distance < radius);
                ++(distance < radius ? near_ones : far_ones);
            }
            return true;
        });
    }
    EXPECT_GT(near_ones, 100);
    EXPECT_GT(far_ones, 100);
}

TEST(GapTriangles, HaveTheNormalOfTheirCornersWhereTheseAgree) {
    const Positions corners = Positions::Identity(3, 3);
    const InsertedPoint middle{kCorners, {0.2, 0.3, 0.5}, {}};
    const Vector3 tilted = Vector3(1.0, 2.0, 2.0) / 3.0;
    EXPECT_LT((gap_triangle_normal(corners, same_normals(tilted), middle) - tilted).norm(), 1e-12);
    // Corners that cancel one another leave the side to which the triangle faces.
    Normals opposed(3, 3);
    opposed << 1, 0, 0, -1, 0, 0, 0, 0, 0;
    const InsertedPoint between{kCorners, {0.5, 0.5, 0.0}, {}};
    EXPECT_LT(
        (gap_triangle_normal(corners, opposed, between) - facing(corners).normalized()).norm(),
        1e-12);
}

TEST(GapTriangles, BetweenTheSameModelTwiceAreItsTriangles) {
    constexpr Index kSide = 12;
    Cloud cloud;
    cloud.positions = shapes::grid(kSide);
    cloud.normals = Eigen::RowVector3d(0, 0, 1).replicate(cloud.positions.rows(), 1);
    std::vector<IndexPair> pairs;
    std::vector<Index> rows;
    for (Index i = 0; i < cloud.size(); ++i) {
        pairs.push_back({i, i});
        rows.push_back(i);
    }
    Progress progress;
    const OrderedNeighbors near =
        ordered_neighbors(cloud.positions, Resampling::kNeighbors, progress);
    const EndSamples source(cloud, rows, &near, progress), target(cloud, rows, nullptr, progress);
    const std::vector<GapTriangle> found = gap_triangles(source, target, pairs, progress);
    double area = 0.0;
    for (const GapTriangle& corners : found) {
        EXPECT_TRUE(shows_front(source.positions, source.normals, corners));
        Positions places(3, 3);
        for (Index c = 0; c < 3; ++c) places.row(c) = cloud.positions.row(corners[to_size(c)]);
        area += 0.5 * facing(places).norm();
    }
    const Eigen::RowVector3d extent =
        cloud.positions.colwise().maxCoeff() - cloud.positions.colwise().minCoeff();
    // All of the grid; squares, whose corners lie on one circle, may be covered by both diagonals.
    EXPECT_GE(area, 0.999 * extent[0] * extent[1]);
    EXPECT_LE(area, 2.001 * extent[0] * extent[1]);
}

}  // namespace
}  // namespace pointmorph

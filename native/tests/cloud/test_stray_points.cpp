#include "cloud/stray_points.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>
#include <vector>

#include "joined_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

std::vector<Index> strays(const Positions& positions, std::span<const Index> marked = {}) {
    Progress progress;
    return stray_points(positions, nearest_neighbors(KdTree<3>(positions), 16, progress), marked,
                        progress);
}

/// 1/√density of a random torus with radii 1 and .4.
double torus_spacing(Index count) {
    const double area = 4.0 * std::numbers::pi * std::numbers::pi * 0.4;
    return std::sqrt(area / static_cast<double>(count));
}

double height_over_torus(const Eigen::RowVector3d& p) {
    return std::abs(std::hypot(std::hypot(p.x(), p.y()) - 1.0, p.z()) - 0.4);
}

/// The points for which a draw between 0 and 1 is below `share(point)`.
template <class Share>
Positions thinned(const Positions& all, unsigned seed, Share&& share) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::vector<Index> kept;
    for (Index i = 0; i < to_index(all.rows()); ++i)
        if (uniform(random) < share(all.row(i))) kept.push_back(i);
    return gather(all, kept);
}

TEST(StrayPoints, ScatteredPointsAreFoundAndNoOthers) {
    for (const Index count : {1000, 8000})
        for (const double share : {0.003, 0.01, 0.03}) {
            const auto many = static_cast<Index>(share * count);
            const Positions noise = 1.5 * shapes::cube_noise(many, 7);
            const Positions all = shapes::together({shapes::torus(count, 0.4), noise});
            const std::vector<Index> found = strays(all);
            Index off = 0, found_off = 0;
            for (Index i = count; i < count + many; ++i) {
                if (height_over_torus(all.row(i)) < 4.0 * torus_spacing(count)) continue;
                ++off;
                found_off += std::ranges::binary_search(found, i);
            }
            ASSERT_GT(off, 0);
            EXPECT_GE(found_off, 0.7 * off) << count << " points, " << many << " strays";
            EXPECT_TRUE(found.empty() || found.front() >= count) << count;
        }
}

TEST(StrayPoints, SurfacesHaveNoneHoweverTheyAreSampled) {
    for (unsigned seed = 1; seed <= 5; ++seed)
        for (const Index count : {200, 1000, 4000, 8000}) {
            const Positions torus = shapes::torus(count, 0.4, seed);
            EXPECT_TRUE(strays(torus).empty()) << seed << ", " << count;
            if (count < 4000) continue;  // no fewer than 1,000 once they are thinned
            // From all of the points at one end to a twelfth at the other, and in one step.
            const auto slope = [](const auto& p) { return std::pow(12.0, -(p.x() + 1.4) / 2.8); };
            const auto step = [](const auto& p) { return p.x() < 0.2 ? 1.0 : 1.0 / 12.0; };
            for (const Positions& all : {thinned(torus, seed, slope), thinned(torus, seed, step)}) {
                ASSERT_GE(all.rows(), 1000);
                EXPECT_TRUE(strays(all).empty()) << seed << ", " << count;
            }
        }
    EXPECT_TRUE(strays(shapes::grid(30)).empty());
    EXPECT_TRUE(strays(shapes::sphere(2000)).empty());
    EXPECT_TRUE(strays(shapes::cube_noise(2000)).empty());
}

TEST(StrayPoints, ThePolesOfAGlobeAreOnIt) {
    constexpr Index kAround = 64, kRings = 31;
    Positions globe(kAround * kRings + 2, 3);
    globe.row(0) << 0, 0, 1;
    globe.row(1) << 0, 0, -1;
    for (Index r = 0; r < kRings; ++r)
        for (Index k = 0; k < kAround; ++k) {
            const double t = std::numbers::pi * (r + 1) / (kRings + 1);
            const double a = 2.0 * std::numbers::pi * k / kAround;
            globe.row(2 + r * kAround + k) << std::sin(t) * std::cos(a), std::sin(t) * std::sin(a),
                std::cos(t);
        }
    EXPECT_TRUE(strays(globe).empty());
}

TEST(StrayPoints, ThinPartsAreKeptWithFewPoints) {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    const double spacing = std::sqrt(4.0 * std::numbers::pi / 1000.0);
    for (const double girth : {1.0, 2.0}) {  // in spacings: as wide as a few points are apart
        const double length = 1.2, radius = girth * spacing / (2.0 * std::numbers::pi);
        const auto many = static_cast<Index>(girth * length / spacing);
        for (int trial = 0; trial < 20; ++trial) {
            Positions antenna(many, 3);
            for (Index i = 0; i < many; ++i) {
                const double a = 2.0 * std::numbers::pi * uniform(random);
                antenna.row(i) << radius * std::cos(a), radius * std::sin(a),
                    1.0 + length * (i + uniform(random)) / many;
            }
            EXPECT_TRUE(strays(shapes::together({shapes::sphere(1000), antenna})).empty())
                << girth << ", " << trial;
        }
    }
}

TEST(StrayPoints, SmallClumpsAreFoundAndLoosePartsKept) {
    const Positions ball = shapes::sphere(4000);
    const double spacing = std::sqrt(4.0 * std::numbers::pi / 4000.0);
    const auto clump = [&](Index count) {
        return Positions(
            (spacing * std::sqrt(count / (4.0 * std::numbers::pi)) * shapes::sphere(count))
                .rowwise() +
            Eigen::RowVector3d(0.0, 1.2, 1.2));
    };
    std::vector<Index> expected(6);
    std::iota(expected.begin(), expected.end(), 4000);
    EXPECT_EQ(strays(shapes::together({ball, clump(6)})), expected);
    EXPECT_TRUE(strays(shapes::together({ball, clump(80)})).empty());
}

TEST(StrayPoints, WhatIsMarkedIsNone) {
    const Positions far =
        shapes::together({shapes::sphere(4000), Positions(Eigen::RowVector3d(0.0, 0.0, 1.5)),
                          Positions(Eigen::RowVector3d(0.0, 2.5, 0.0))});
    const std::vector<Index> both{4000, 4001}, other{4001}, marked{4000, 17};
    EXPECT_EQ(strays(far), both);
    EXPECT_EQ(strays(far, marked), other);
    EXPECT_TRUE(strays(far, both).empty());
}

TEST(StrayPoints, CanBeCancelled) {
    const Positions ball = shapes::sphere(4000);
    Progress silent;
    const Neighborhoods nearest = nearest_neighbors(KdTree<3>(ball), 16, silent);
    Progress progress([](std::string_view, double) { return false; }, std::chrono::milliseconds(0));
    EXPECT_THROW(stray_points(ball, nearest, {}, progress), Cancelled);
}

TEST(StrayPoints, ManyOrFewPointsSayNothing) {
    const auto field = [](unsigned seed) {
        return Positions((5.0 * shapes::cube_noise(35, seed)).rowwise() +
                         Eigen::RowVector3d(20.0 * seed, 0.0, 0.0));
    };
    const Positions torus = shapes::torus(2000, 0.4);
    EXPECT_EQ(strays(shapes::together({torus, field(1)})).size(), 35u);
    EXPECT_TRUE(strays(shapes::together({torus, field(1), field(2), field(3), field(4)})).empty());
    const Positions few = shapes::torus(100, 0.4);
    EXPECT_TRUE(strays(shapes::together({few, 1.5 * shapes::cube_noise(1)})).empty());
    EXPECT_TRUE(strays(shapes::torus(2, 0.4)).empty());
}

}  // namespace
}  // namespace pointmorph

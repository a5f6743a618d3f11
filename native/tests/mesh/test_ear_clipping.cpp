#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <random>
#include <string_view>
#include <vector>

#include "pointmorph/base/error.hpp"
#include "pointmorph/mesh/mesh.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

using Triangle = std::array<Index, 3>;

Eigen::RowVector3d doubled(const Positions& p, const Triangle& t) {
    const Eigen::RowVector3d u = p.row(t[1]) - p.row(t[0]), v = p.row(t[2]) - p.row(t[0]);
    return u.cross(v);
}

double worth(const Positions& p, const Triangle& t, const Vector3& normal) {
    const double longest = std::max({(p.row(t[1]) - p.row(t[0])).squaredNorm(),
                                     (p.row(t[2]) - p.row(t[1])).squaredNorm(),
                                     (p.row(t[0]) - p.row(t[2])).squaredNorm()});
    return longest > 0.0 ? doubled(p, t).dot(normal) / longest : 0.0;
}

bool holds(const Positions& p, const Triangle& t, Index other, const Vector3& normal) {
    if (std::ranges::find(t, other) != t.end()) return false;
    return doubled(p, {t[0], t[1], other}).dot(normal) > 0.0 &&
           doubled(p, {t[1], t[2], other}).dot(normal) > 0.0 &&
           doubled(p, {t[2], t[0], other}).dot(normal) > 0.0;
}

/// The rule by itself: of all ears, each compared with all corners, the best is cut off.
std::vector<Triangle> by_all_ears(const Positions& p, std::vector<Index> ring) {
    Vector3 normal = Vector3::Zero();
    for (std::size_t k = 1; k + 1 < ring.size(); ++k)
        normal += doubled(p, {ring[0], ring[k], ring[k + 1]}).transpose();
    normal.normalize();
    std::vector<Triangle> triangles;
    while (ring.size() > 3) {
        const std::size_t n = ring.size();
        std::size_t best = 0;
        double most = -std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < n; ++k) {
            const Triangle ear{ring[(k + n - 1) % n], ring[k], ring[(k + 1) % n]};
            double value = worth(p, ear, normal);
            if (n == 4)
                value = std::min(value, worth(p, {ear[0], ear[2], ring[(k + 2) % 4]}, normal));
            if (std::ranges::any_of(ring,
                                    [&](Index other) { return holds(p, ear, other, normal); }))
                value -= 4.0;
            if (value > most + 1e-9) {
                most = value;
                best = k;
            }
        }
        triangles.push_back({ring[(best + n - 1) % n], ring[best], ring[(best + 1) % n]});
        ring.erase(ring.begin() + static_cast<std::ptrdiff_t>(best));
    }
    triangles.push_back({ring[0], ring[1], ring[2]});
    return triangles;
}

std::vector<Index> in_order(Index count) {
    std::vector<Index> corners(to_size(count));
    std::iota(corners.begin(), corners.end(), 0);
    return corners;
}

/// A closed outline around the origin with `teeth` bays, in a plane that is tilted.
Positions gear(Index count, int teeth, double depth) {
    const Eigen::Matrix3d tilt =
        Eigen::AngleAxisd(0.7, Vector3(1.0, 2.0, -0.5).normalized()).toRotationMatrix();
    Positions p(count, 3);
    for (Index k = 0; k < count; ++k) {
        const double angle = 2.0 * std::numbers::pi * k / count;
        const double radius = 1.0 + depth * std::sin(teeth * angle);
        p.row(k) =
            (tilt * Vector3(radius * std::cos(angle), radius * std::sin(angle), 3.0)).transpose();
    }
    return p;
}

TEST(EarClipping, CutsWhatTheRuleCuts) {
    Progress silent;
    std::mt19937 random(7);
    std::uniform_real_distribution<double> any(-1.0, 1.0);
    for (Index count = 3; count < 60; count += 3) {
        Positions shapes[] = {gear(count, 5, 0.6), gear(count, 0, 0.0), Positions(count, 3)};
        for (Index k = 0; k < count; ++k)  // crosses itself, and isn't flat
            shapes[2].row(k) << any(random), any(random), any(random);
        for (const Positions& p : shapes)
            EXPECT_EQ(triangulate(p, in_order(count), silent), by_all_ears(p, in_order(count)))
                << count;
    }
}

TEST(EarClipping, CutsRingsThatABridgeMakesOnePolygon) {
    Progress silent;
    constexpr Index kSide = 24;
    Positions p(2 * kSide, 3);
    for (Index k = 0; k < kSide; ++k) {
        const double angle = 2.0 * std::numbers::pi * k / kSide;
        p.row(k) << std::cos(angle), std::sin(angle), 0.0;
        p.row(kSide + k) = 0.4 * p.row(k);
    }
    std::vector<Index> ring;
    for (Index k = 0; k <= kSide; ++k) ring.push_back(k % kSide);
    for (Index k = kSide; k >= 0; --k) ring.push_back(kSide + k % kSide);
    EXPECT_EQ(triangulate(p, ring, silent), by_all_ears(p, ring));
}

TEST(EarClipping, CoversAnOutlineOfManyCorners) {
    Progress silent;
    // Each ear compared with all corners would take hours.
    const Index count = is_watched() ? 4000 : 20000;
    const Positions p = gear(count, 40, 0.3);
    const auto triangles = triangulate(p, in_order(count), silent);
    ASSERT_EQ(to_index(triangles.size()), count - 2);
    Vector3 whole = Vector3::Zero();
    double sum = 0.0;
    for (Index k = 1; k + 1 < count; ++k) whole += doubled(p, {0, k, k + 1}).transpose();
    for (const Triangle& t : triangles) {
        EXPECT_GT(doubled(p, t).dot(whole), 0.0);
        sum += doubled(p, t).norm();
    }
    EXPECT_NEAR(sum, whole.norm(), 1e-9);
}

TEST(EarClipping, CutsEachCornerOnceWhereNumbersAreNone) {
    Progress silent;
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    constexpr double kEndless = std::numeric_limits<double>::infinity();
    constexpr Index kCount = 300;
    for (const double number : {kNone, kEndless, -kEndless, 1e160, 1e308})
        for (const Index every : {1, 2, 7, 100}) {
            Positions p = gear(kCount, 7, 0.5);
            for (Index k = 0; k < kCount; k += every) p(k, k % 3) = number;
            const auto triangles = triangulate(p, in_order(kCount), silent);
            ASSERT_EQ(to_index(triangles.size()), kCount - 2);
            std::vector<int> times(to_size(kCount), 0);
            for (const Triangle& t : triangles) ++times[to_size(t[1])];
            EXPECT_EQ(std::ranges::count(times, 1), kCount - 2) << number << " " << every;
        }
}

TEST(EarClipping, CutsASquareOfManyCorners) {
    Progress silent;
    const Index side = is_watched() ? 500 : 2500;
    Positions p = Positions::Zero(4 * side, 3);
    for (Index k = 0; k < side; ++k) {
        const double at = static_cast<double>(k) / side;
        p.row(k) << at, 0.0, 0.0;
        p.row(side + k) << 1.0, at, 0.0;
        p.row(2 * side + k) << 1.0 - at, 1.0, 0.0;
        p.row(3 * side + k) << 0.0, 1.0 - at, 0.0;
    }
    double sum = 0.0;
    for (const Triangle& t : triangulate(p, in_order(4 * side), silent)) sum += doubled(p, t).z();
    EXPECT_NEAR(sum, 2.0, 1e-9);
}

TEST(EarClipping, StopsWithinAPolygon) {
    const Positions p = gear(3000, 9, 0.3);
    int questions = 0;
    Progress progress([&](std::string_view, double) { return ++questions < 8; },
                      std::chrono::milliseconds(0));
    EXPECT_THROW(triangulate(p, in_order(3000), progress), Cancelled);
    EXPECT_EQ(questions, 8);
}

}  // namespace
}  // namespace pointmorph

#include "base/angle.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <random>

namespace pointmorph {
namespace {

constexpr double kPi = std::numbers::pi;

TEST(Angle, IsThatOfTheSystemsLibraryButForTheLastPlaces) {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0), power(-12.0, 12.0);
    for (int i = 0; i < 200000; ++i) {
        const double x = uniform(random), y = uniform(random) * std::exp2(power(random));
        const double expected = std::atan2(y, x);
        double least = expected, most = expected;
        for (int place = 0; place < 2; ++place) {
            least = std::nextafter(least, -4.0);
            most = std::nextafter(most, 4.0);
        }
        const double found = angle_of(y, x);
        ASSERT_TRUE(least <= found && found <= most) << y << ", " << x;
    }
}

TEST(Angle, IsExactOnAxesAndDiagonals) {
    for (const double size : {5e-324, 1e-200, 1.0, 3.0, 1e300}) {
        EXPECT_EQ(angle_of(0.0, size), 0.0);
        EXPECT_EQ(angle_of(size, size), kPi / 4.0);
        EXPECT_EQ(angle_of(size, 0.0), kPi / 2.0);
        EXPECT_EQ(angle_of(size, -size), kPi - kPi / 4.0);
        EXPECT_EQ(angle_of(0.0, -size), kPi);
        EXPECT_EQ(angle_of(-0.0, -size), -kPi);
        EXPECT_EQ(angle_of(-size, 0.0), -kPi / 2.0);
    }
    EXPECT_EQ(angle_of(0.0, 0.0), 0.0);
    for (const double none :
         {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
        EXPECT_TRUE(std::isnan(angle_of(none, none)));
        EXPECT_TRUE(std::isnan(angle_of(1.0, none)));
    }
}

TEST(Angle, HasTheseBitsOnEverySystem) {
    std::uint64_t hash = 14695981039346656037u;
    for (int y = -60; y <= 60; ++y)
        for (int x = -60; x <= 60; ++x)
            hash = (hash ^ std::bit_cast<std::uint64_t>(angle_of(y, x))) * 1099511628211u;
    EXPECT_EQ(hash, 15107515821758638423u);
}

TEST(Angle, AxisAndAngleOfARotation) {
    std::mt19937_64 random(4);
    std::normal_distribution<double> normal;
    for (int i = 0; i < 1000; ++i) {
        const Vector3 axis = Vector3(normal(random), normal(random), normal(random)).normalized();
        const double angle = kPi * i / 1000.0;
        const Matrix3 rotation = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
        const Eigen::AngleAxisd found = angle_axis(rotation);
        EXPECT_NEAR(found.angle(), angle, 1e-12);
        EXPECT_LT((found.toRotationMatrix() - rotation).norm(), 1e-12);
    }
    EXPECT_EQ(angle_axis(Matrix3::Identity()).angle(), 0.0);
    const Matrix3 half = Vector3(-1.0, -1.0, 1.0).asDiagonal();
    EXPECT_EQ(angle_axis(half).angle(), kPi);
    EXPECT_EQ(angle_axis(half).axis().cwiseAbs(), Vector3::UnitZ());
}

}  // namespace
}  // namespace pointmorph

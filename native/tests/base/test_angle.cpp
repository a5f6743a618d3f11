#include "base/angle.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <random>

#include "base/elementary.hpp"

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

// The other elementary functions.

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();

/// Whether a number is another or one of its `places` neighbors on either side.
bool is_within(double found, double expected, int places) {
    double least = expected, most = expected;
    for (int place = 0; place < places; ++place) {
        least = std::nextafter(least, -kInfinite);
        most = std::nextafter(most, kInfinite);
    }
    return least <= found && found <= most;
}

TEST(Elementary, IsThatOfTheSystemsLibraryButForTheLastPlace) {
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    for (int i = 0; i < 100000; ++i) {
        const double a = uniform(random), b = uniform(random);
        for (const double x : {a, 1e-3 * a, 30.0 * a, 744.0 * a}) {
            ASSERT_TRUE(is_within(exponential(x), std::exp(x), 1)) << x;
            ASSERT_TRUE(is_within(sine_of(x), std::sin(x), 1)) << x;
            ASSERT_TRUE(is_within(cosine_of(x), std::cos(x), 1)) << x;
        }
        for (const double x : {1.0 + 0.5 * a, 1.0 + 1e-6 * a, std::exp2(1000.0 * a), 5e-324}) {
            ASSERT_TRUE(is_within(logarithm(x), std::log(x), 1)) << x;
            ASSERT_TRUE(is_within(power(x, b), std::pow(x, b), 1)) << x << ", " << b;
        }
        ASSERT_TRUE(is_within(power(std::exp2(2.0 * a), 300.0 * b),
                              std::pow(std::exp2(2.0 * a), 300.0 * b), 1));
        const double x = std::exp2(60.0 * a);
        ASSERT_TRUE(is_within(logarithm_after_one(x), std::log1p(x), 3)) << x;
        ASSERT_NEAR(sine_of(1e6 * a), std::sin(1e6 * a), 1e-15);
    }
}

TEST(Elementary, IsExactWhereTheResultIs) {
    EXPECT_EQ(exponential(0.0), 1.0);
    EXPECT_EQ(logarithm(1.0), 0.0);
    EXPECT_EQ(sine_of(0.0), 0.0);
    EXPECT_EQ(cosine_of(0.0), 1.0);
    EXPECT_EQ(logarithm_after_one(1e-300), 1e-300);
    EXPECT_EQ(logarithm_after_one(0.0), 0.0);
    for (const double x : {0.3, 1.0, 1.7, 1e-300, 1e300}) {
        EXPECT_EQ(power(x, 0.0), 1.0);
        EXPECT_EQ(power(x, 1.0), x);
        EXPECT_EQ(power(1.0, x), 1.0);
    }
    EXPECT_EQ(power(3.0, 4.0), 81.0);
    EXPECT_EQ(power(-2.0, 3.0), -8.0);
    EXPECT_EQ(power(-2.0, -2.0), 0.25);
}

TEST(Elementary, SpecialValuesAreTheSystems) {
    const double all[] = {0.0,   -0.0, 1.0,   -1.0,      0.5,        -0.5,        2.0,  3.0,  -3.0,
                          1e300, 800., -800., kInfinite, -kInfinite, kNotANumber, 1e20, -1e20};
    const auto same = [](double a, double b) {
        return std::isnan(a) ? std::isnan(b)
                             : std::signbit(a) == std::signbit(b) && is_within(a, b, 1);
    };
    for (const double x : all) {
        EXPECT_TRUE(same(exponential(x), std::exp(x))) << x;
        EXPECT_TRUE(same(logarithm(x), std::log(x))) << x;
        EXPECT_TRUE(same(logarithm_after_one(x), std::log1p(x))) << x;
        if (std::isinf(x) || std::isnan(x)) {
            EXPECT_TRUE(std::isnan(sine_of(x)));
            EXPECT_TRUE(std::isnan(cosine_of(x)));
        }
        for (const double y : all) EXPECT_TRUE(same(power(x, y), std::pow(x, y))) << x << ", " << y;
    }
}

TEST(Elementary, HasTheseBitsOnEverySystem) {
    std::uint64_t hash = 14695981039346656037u;
    const auto add = [&](double value) {
        hash = (hash ^ std::bit_cast<std::uint64_t>(value)) * 1099511628211u;
    };
    for (int i = 1; i <= 20000; ++i) {
        const double x = i / 512.0;
        for (const double value :
             {exponential(x), exponential(-x), logarithm(x), power(x, 0.3), power(x, -1.5),
              sine_of(x), cosine_of(x), logarithm_after_one(x)})
            add(value);
    }
    EXPECT_EQ(hash, 3591090980018607149u);
}

}  // namespace
}  // namespace pointmorph

#include "base/branchless_exponential.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

namespace pointmorph {
namespace {

TEST(BranchlessExponential, IsThatOfTheSystemsLibraryButForTheLastPlaces) {
    constexpr int kPlaces = 2;
    constexpr double kInfinite = std::numeric_limits<double>::infinity();
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    for (int i = 0; i < 100000; ++i) {
        const double a = uniform(random);
        for (const double x : {a, 1e-3 * a, 30.0 * a, 700.0 * a}) {
            double least = std::exp(x), most = least;
            for (int place = 0; place < kPlaces; ++place) {
                least = std::nextafter(least, -kInfinite);
                most = std::nextafter(most, kInfinite);
            }
            const double found = branchless_exponential(x);
            ASSERT_TRUE(least <= found && found <= most) << x << ": " << found;
        }
    }
    EXPECT_EQ(branchless_exponential(0.0), 1.0);
    EXPECT_EQ(branchless_exponential(-0.0), 1.0);
}

/// From −39 to 39.
std::vector<double> steps() {
    std::vector<double> numbers;
    for (int i = -20000; i < 20000; ++i) numbers.push_back(i / 512.0);
    return numbers;
}

TEST(BranchlessExponential, IsTheSameOneByOneAndSideBySide) {
    const std::vector<double> numbers = steps();
    std::vector<double> together(numbers.size());
    for (std::size_t i = 0; i < numbers.size(); ++i)
        together[i] = branchless_exponential(numbers[i]);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        const volatile double alone = numbers[i];
        ASSERT_EQ(branchless_exponential(alone), together[i]) << numbers[i];
    }
}

TEST(BranchlessExponential, HasTheseBitsOnEverySystem) {
    std::uint64_t hash = 14695981039346656037u;
    for (const double x : steps())
        hash = (hash ^ std::bit_cast<std::uint64_t>(branchless_exponential(x))) * 1099511628211u;
    EXPECT_EQ(hash, 11623566321474992481u);
}

}  // namespace
}  // namespace pointmorph

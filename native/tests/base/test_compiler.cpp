#include "base/compiler.hpp"

#include <gtest/gtest.h>

#include <random>

namespace pointmorph {
namespace {

/// As a leaf of the kd-tree sums squares.
template <class Two>
std::array<double, 2> squares(const std::array<double, 6>& v) {
    Two sum{};
    for (std::size_t k = 0; k + 3 < v.size(); k += 2) {
        const Two a = {v[k], v[k + 1]}, b = {v[k + 2], v[k + 3]};
        const Two difference = a - b;
        sum += difference * difference;
    }
    Two result{};
    result[0] = sum[0];
    result[1] = sum[1];
    return {result[0], result[1]};
}

TEST(Compiler, TwoNumbersSideBySideAreTheSameInARegister) {
    static_assert(sizeof(Two) == 16 && alignof(Two) == 16);
    static_assert(sizeof(PlainTwo) == 16 && alignof(PlainTwo) == 16);
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    for (int round = 0; round < 1000; ++round) {
        std::array<double, 6> values;
        for (double& v : values) v = uniform(random);
        EXPECT_EQ(squares<Two>(values), squares<PlainTwo>(values));
    }
}

}  // namespace
}  // namespace pointmorph

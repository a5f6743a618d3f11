#include "base/compiler.hpp"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>
#include <random>
#include <vector>

#include "base/thread_engine.hpp"
#include "base/unused_memory.hpp"

#if __has_include(<malloc.h>)
#include <malloc.h>
#endif

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

std::vector<double> random_numbers(std::size_t count, unsigned seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    std::vector<double> numbers(count);
    for (double& number : numbers) number = uniform(random);
    return numbers;
}

TEST(Compiler, SixteenSquaredDistancesAreThoseOfEachPoint) {
    constexpr std::size_t kAxes = 12;
    using Version = std::uint32_t (*)(const SixteenPoints&, double*);
    std::vector<Version> versions;
    if (has_wide_registers()) versions.push_back(squares_of_sixteen_wide<kAxes>);
    if (has_widest_registers()) versions.push_back(squares_of_sixteen_widest<kAxes>);
    if (versions.empty()) GTEST_SKIP() << "There are no wide registers here.";
    const std::vector<double> coordinates = random_numbers(16 * kAxes, 1),
                              from = random_numbers(kAxes, 2);
    std::array<double, 16> expected{};
    double half = 0.0;  // of the axes, the least
    for (std::size_t axis = 0; axis < kAxes; ++axis) {
        for (std::size_t k = 0; k < 16; ++k) {
            const double to = from[axis] - coordinates[16 * axis + k];
            expected[k] += to * to;
        }
        if (axis + 1 == kAxes / 2) half = *std::ranges::min_element(expected);
    }
    for (const Version squares_of_sixteen : versions)
        for (const double limit : {expected[3], expected[11], 100.0, 0.0, half}) {
            std::array<double, 16> squared{};
            const std::uint32_t bits =
                squares_of_sixteen({coordinates.data(), from.data(), limit}, squared.data());
            for (unsigned k = 0; k < 16; ++k) EXPECT_EQ(bits >> k & 1, expected[k] < limit) << k;
            const bool is_written = limit > half;
            EXPECT_EQ(squared, is_written ? expected : (std::array<double, 16>{}));
        }
}

TEST(Compiler, ProductsOfTilesAreRoundedBeforeTheyAreTaken) {
    if (!has_widest_registers()) GTEST_SKIP() << "There are no registers of eight here.";
    constexpr std::size_t kTiles = 3;
    const std::vector<double> by = random_numbers(16, 1), tiles = random_numbers(16 * kTiles, 2);
    const std::array<std::int32_t, kTiles> places{4, 0, 3};
    std::vector<double> sums = random_numbers(16 * 5, 3), expected = sums;
    for (std::size_t t = 0; t < kTiles; ++t)
        for (std::size_t column = 0; column < 4; ++column)
            for (std::size_t row = 0; row < 4; ++row)
                for (std::size_t k = 0; k < 4; ++k) {
                    const double product = by[4 * k + column] * tiles[16 * t + 4 * k + row];
                    expected[16 * static_cast<std::size_t>(places[t]) + 4 * column + row] -=
                        product;
                }
    subtract_products_widest({by.data(), tiles.data(), places.data(), kTiles, sums.data()});
    EXPECT_EQ(sums, expected);
}

TEST(Compiler, RootsOfSeveralFloatsAreThoseOfEach) {
    std::mt19937_64 random(7);
    std::uniform_real_distribution<float> uniform(0.0f, 4.0f);
    Eigen::ArrayXf numbers(4000);
    for (float& number : numbers) number = uniform(random);
    const Eigen::ArrayXf roots = numbers.sqrt();
    for (Eigen::Index i = 0; i < numbers.size(); ++i)
        EXPECT_EQ(roots[i], std::sqrt(numbers[i])) << numbers[i];
}

/// Two of them by turns, so that some are equal.
template <class Two, class CountBelow>
std::array<double, 5> compared(const std::array<double, 6>& v) {
    const Two a = {v[0], v[1]}, b = {v[2], v[1]};
    const Two less = smaller(a, b), more = larger(a, b);
    CountBelow below(v[2]);
    for (std::size_t k = 0; k < v.size(); k += 2) below.look_at(Two{v[k], v[k + 1]});
    return {less[0], less[1], more[0], more[1], static_cast<double>(below.count())};
}

TEST(Compiler, RowsOfFloatsAreMadeAsLongAsOneInWideRegistersAsOneByOne) {
    if (!has_wide_registers()) GTEST_SKIP() << "no wide registers";
    constexpr std::size_t kRows = 24;
    std::mt19937 random(5);
    std::uniform_real_distribution<float> number(-2.0F, 2.0F);
    std::array<float, 4 * kRows> rows;
    for (float& value : rows) value = number(random);
    constexpr float kAfter = 7.0F;
    std::array<float, 3 * kRows + 1> units;
    units.back() = kAfter;
    EXPECT_TRUE(put_units_wide(rows.data(), 1e-6F, units.data(), kRows));
    for (std::size_t i = 0; i < kRows; ++i) {
        const float* const row = rows.data() + 4 * i;
        const float factor = 1.0F / std::sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2]);
        for (std::size_t d = 0; d < 3; ++d) EXPECT_EQ(units[3 * i + d], factor * row[d]);
    }
    EXPECT_EQ(units.back(), kAfter);  // nothing is written after the last
    for (std::size_t i = 0; i < kRows; ++i) {
        std::array<float, 4 * kRows> one_short = rows;
        std::fill_n(one_short.begin() + static_cast<std::ptrdiff_t>(4 * i), 3, 0.0F);
        EXPECT_FALSE(put_units_wide(one_short.data(), 1e-6F, units.data(), kRows)) << i;
    }
}

TEST(Compiler, TwoNumbersAreComparedAlikeInARegister) {
    std::mt19937_64 random(6);
    std::uniform_int_distribution<int> digit(-3, 3);
    for (int round = 0; round < 1000; ++round) {
        std::array<double, 6> v;
        for (double& each : v) each = digit(random);
        const auto found = compared<Two, CountBelow>(v);
        EXPECT_EQ(found, (compared<PlainTwo, PlainCountBelow>(v)));
        EXPECT_EQ(found[0], std::min(v[0], v[2]));
        EXPECT_EQ(found[2], std::max(v[0], v[2]));
        EXPECT_EQ(found[4], static_cast<double>(std::ranges::count_if(
                                v, [&](double each) { return each < v[2]; })));
    }
}

#ifdef __GLIBC__
/// Blocks that come from the system alone and go back to it when they are freed.
std::size_t blocks_of_their_own() {
    const std::unique_ptr<void, void (*)(void*)> block(std::malloc(std::size_t{8} << 20),
                                                       std::free);
    return mallinfo2().hblks;
}

TEST(UnusedMemory, IsKeptForFewPointsAlone) {
    // As in a program that has freed no large block yet.
    mallopt(M_MMAP_THRESHOLD, 128 << 10);
    const std::size_t alone = blocks_of_their_own();
    keep_unused_memory(kManyPoints);
    EXPECT_EQ(blocks_of_their_own(), alone);
    keep_unused_memory(kManyPoints - 1);
    EXPECT_EQ(blocks_of_their_own(), alone == 0 ? 0 : alone - 1);  // 0 where all is watched
}
#endif

TEST(UnusedMemory, OfBothSidesIsFreedOnce) {
    for (const int limit : {1, 2})
        for (const Index points : {10, 1'000'000}) {
            const ThreadCount threads(limit);
            std::array<std::vector<int>, 2> sides{std::vector<int>(5), std::vector<int>(7)};
            std::atomic<int> calls{0};
            free_both(points, [&](bool is_source) {
                std::vector<int>().swap(sides[is_source ? 0 : 1]);
                ++calls;
            });
            EXPECT_EQ(calls, 2);
            EXPECT_EQ(sides[0].capacity() + sides[1].capacity(), 0U);
        }
}

TEST(UnusedMemory, OfBothSidesIsFreedWhereATeamFindsNone) {
    const ThreadEngine full{"full", [] { return 2; },
                            [](int, const TeamWork&) { throw std::bad_alloc(); }};
    const EngineScope scope(full);
    std::array<int, 2> calls{};
    free_both(kManyPoints, [&](bool is_source) { ++calls[is_source ? 0 : 1]; });
    EXPECT_EQ(calls, (std::array{1, 1}));
}

}  // namespace
}  // namespace pointmorph

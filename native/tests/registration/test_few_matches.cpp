#include "registration/few_matches.hpp"

#include <gtest/gtest.h>

#include <initializer_list>
#include <limits>

#include "pointmorph/base/parallel.hpp"
#include "registration/product_keys.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

/// Places on a surface that one map has moved by `off`, then normals.
ProductPoints on_surface(Index count, unsigned seed, double off) {
    const Positions noise = shapes::cube_noise(count, seed);
    ProductPoints points(count, 12);
    for (Index i = 0; i < count; ++i) {
        const Eigen::RowVector3d normal = (2.0 * noise.row(i).array() - 1.0).matrix().normalized();
        const Eigen::RowVector3d place = 0.3 * normal;
        Eigen::RowVector3d image = place;
        image[0] += off * place[1];
        image[2] += off * place[0] * place[1];
        points.row(i) << image, place, 0.1 * normal, 0.1 * normal;
    }
    return points;
}

void expect_same(const Matches& found, const Matches& expected) {
    EXPECT_EQ(found.to, expected.to);
    EXPECT_EQ(found.distances, expected.distances);
}

Matches by_tree(const ProductPoints& points, const ProductPoints& others) {
    Progress progress;
    return nearest_matches<12>(points, KdTree<12>(others), progress);
}

TEST(FewMatches, AreThoseOfTreesToTheBit) {
    for (const Index sources : {1, 3, 16, 250, 451})
        for (const Index targets : {1, 5, 17, 300}) {
            const ProductPoints a = on_surface(sources, 1, 0.3), b = on_surface(targets, 2, -0.2);
            const auto [forward, backward] = matches_both_ways_of_few(a, b);
            expect_same(forward, by_tree(a, b));
            expect_same(backward, by_tree(b, a));
            expect_same(matches_of_few(a, b), forward);
        }
}

TEST(FewMatches, FarFromTheOriginAsWell) {
    // There, floats tell points apart that lie further from one another than all of these.
    ProductPoints a = on_surface(200, 1, 0.3), b = on_surface(150, 2, -0.2);
    a.array() += 5000.0;
    b.array() += 5000.0;
    const auto [forward, backward] = matches_both_ways_of_few(a, b);
    expect_same(forward, by_tree(a, b));
    expect_same(backward, by_tree(b, a));
}

TEST(FewMatches, OfEquallyFarOnesTheFirst) {
    const ProductPoints a = on_surface(60, 1, 0.3);
    ProductPoints b(120, 12);
    b << on_surface(60, 2, -0.2), on_surface(60, 2, -0.2);
    const Matches forward = matches_of_few(a, b);
    for (const Index to : forward.to) EXPECT_LT(to, 60);
    const auto [there, back] = matches_both_ways_of_few(b, a);
    for (const Index to : back.to) EXPECT_LT(to, 60);
    expect_same(back, forward);
}

TEST(FewMatches, AGuessDoesNotChangeThem) {
    const ProductPoints a = on_surface(300, 1, 0.3), b = on_surface(200, 2, -0.2);
    const auto [forward, backward] = matches_both_ways_of_few(a, b);
    Matches guess = backward;
    for (std::size_t j = 0; j < guess.to.size(); j += 2) guess.to[j] = 7;
    const auto [again, back_again] = matches_both_ways_of_few(a, b, &guess);
    expect_same(again, forward);
    expect_same(back_again, backward);
}

TEST(FewMatches, SameForAnyWidthOfRegisters) {
    using enum FloatRegisters;
    for (const Index sources : {1, 4, 7, 8, 9, 31, 200})
        for (const Index targets : {1, 31, 32, 33, 64, 150}) {
            const ProductPoints a = on_surface(sources, 1, 0.3), b = on_surface(targets, 2, -0.2);
            const Matches expected = by_tree(a, b), back_expected = by_tree(b, a);
            Matches guess = back_expected;
            guess.to.back() = 0;
            for (const FloatRegisters most : {kOfFour, kOfEight, kOfSixteen})
                for (const Matches* const its :
                     std::initializer_list<const Matches*>{nullptr, &guess}) {
                    const auto [forward, backward] = matches_both_ways_of_few(a, b, its, most);
                    expect_same(forward, expected);
                    expect_same(backward, back_expected);
                    expect_same(matches_of_few(a, b, most), expected);
                }
        }
}

TEST(FewMatches, SameForAnyNumberOfThreads) {
    const ProductPoints a = on_surface(333, 1, 0.3), b = on_surface(222, 2, -0.2);
    const auto [forward, backward] = matches_both_ways_of_few(a, b);
    const ThreadCount one(1);
    const auto [alone, back_alone] = matches_both_ways_of_few(a, b);
    expect_same(alone, forward);
    expect_same(back_alone, backward);
}

TEST(FewMatches, WhatFloatsCannotHoldIsLeftToTrees) {
    ProductPoints points = on_surface(20, 1, 0.3);
    EXPECT_TRUE(fits_floats(points));
    points(7, 3) = 1e30;
    EXPECT_FALSE(fits_floats(points));
    points(7, 3) = std::numeric_limits<double>::quiet_NaN();
    EXPECT_FALSE(fits_floats(points));
}

TEST(FewMatches, KeysAreMatchedAlikeBothWaysAndOneWay) {
    Progress progress;
    const ProductKeys a(on_surface(80, 1, 0.3), Labels()), b(on_surface(70, 2, -0.2), Labels());
    Matches forward, backward;
    match_both_ways(a, b, forward, backward, progress);
    expect_same(forward, by_tree(a.plain, b.plain));
    expect_same(backward, by_tree(b.plain, a.plain));
    expect_same(nearest_of(a, b, progress), forward);
    match_both_ways(a, b, forward, backward, progress);  // from there
    expect_same(backward, by_tree(b.plain, a.plain));
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/measures/cracks.hpp"

#include <gtest/gtest.h>

#include <array>

#include "shapes.hpp"

namespace pointmorph {
namespace {

Pairing identity(Index count) {
    Pairing pairs;
    for (Index i = 0; i < count; ++i) pairs.push_back({i, i});
    return pairs;
}

TEST(Cracks, NoneWhereNothingMoves) {
    const Positions p = shapes::grid(41);
    Progress progress;
    const std::vector<double> times{0.25, 0.5};
    const auto cracks = find_cracks(p, p, identity(41 * 41), times, progress);
    ASSERT_EQ(cracks.size(), times.size());
    for (const auto& at : cracks) EXPECT_EQ(at.share, 0.0);
}

TEST(Cracks, ATearAlongALineIsTheShareOfEdgesAcrossIt) {
    // Both halves of a strip go apart by 20 spacings: only edges across the middle are open.
    const Index side = 40;
    const Positions source = shapes::grid(side);
    Positions target = source;
    for (Index i = 0; i < target.rows(); ++i) target(i, 0) += target(i, 0) > 0 ? 0.5 : -0.5;
    Progress progress;
    const std::vector<double> times{0.0, 1.0};
    const auto cracks =
        find_cracks(source, target, identity(side * side), times, progress, 1 << 30);
    EXPECT_EQ(cracks[0].share, 0.0);
    // 40 points on each side of the tear, one to three of whose six edges cross it.
    const double edges = 6.0 * side * side;
    EXPECT_GE(cracks[1].share, 2 * side * 1 / edges);
    EXPECT_LE(cracks[1].share, 2 * side * 3 / edges);
}

TEST(Cracks, AFewEdgesStandForAll) {
    // three points in ten fly away: the edges between those and the rest open
    const Positions source = shapes::sphere(3000);
    Positions target = source;
    const auto order = shapes::permutation(3000, 2);
    for (Index i = 0; i < 900; ++i) target(order[to_size(i)], 2) += 20.0;
    Progress progress;
    const std::vector<double> times{0.5};
    const auto all = find_cracks(source, target, identity(3000), times, progress, 1 << 30);
    const auto few = find_cracks(source, target, identity(3000), times, progress, 3000);
    EXPECT_NEAR(all[0].share, 2 * 0.3 * 0.7, 0.03);
    EXPECT_NEAR(few[0].share, 2 * 0.3 * 0.7, 0.05);
}

TEST(Example, Cracks) {
    const Positions source = shapes::grid(40);
    Positions target = source;
    for (Index i = 0; i < target.rows(); ++i) target(i, 0) += target(i, 0) > 0 ? 0.5 : -0.5;
    const Pairing pairs = identity(40 * 40);
    Progress progress;
    // --- example
    const auto cracks = find_cracks(source, target, pairs, std::array{0.25, 0.5, 0.75}, progress);
    const double at_half = cracks[1].share;
    // --- end of the example
    EXPECT_EQ(cracks[1].t, 0.5);
    EXPECT_GT(at_half, 0.0);
    EXPECT_LT(at_half, 0.05);
}

}  // namespace
}  // namespace pointmorph

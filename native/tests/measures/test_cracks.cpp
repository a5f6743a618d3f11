#include "pointmorph/measures/cracks.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>

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
    const auto cracks = find_cracks({p}, {p}, identity(41 * 41), times, progress);
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
        find_cracks({source}, {target}, identity(side * side), times, progress, 1 << 30);
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
    const auto all = find_cracks({source}, {target}, identity(3000), times, progress, 1 << 30);
    const auto few = find_cracks({source}, {target}, identity(3000), times, progress, 3000);
    EXPECT_NEAR(all[0].share, 2 * 0.3 * 0.7, 0.03);
    EXPECT_NEAR(few[0].share, 2 * 0.3 * 0.7, 0.05);
}

/// As find_cracks() defines it, with every edge and every point.
double share_by_brute_force(const Positions& source, const Positions& target, const Pairing& pairs,
                            double t) {
    Progress progress;
    Positions frame(static_cast<Eigen::Index>(pairs.size()), 3);
    const auto side = [&](const Positions& cloud, Index IndexPair::*row) {
        const Neighborhoods nearest = nearest_neighbors(KdTree<3>(cloud), 6, progress);
        std::vector<Index> first(to_size(cloud.rows()), -1);
        for (std::size_t i = pairs.size(); i-- > 0;) first[to_size(pairs[i].*row)] = to_index(i);
        const Values at_source =
            local_spacing(source, nearest_neighbors(KdTree<3>(source), 6, progress));
        const Values at_target =
            local_spacing(target, nearest_neighbors(KdTree<3>(target), 6, progress));
        const auto spacing = [&](Index pair) {
            const auto [s, d] = pairs[to_size(pair)];
            return (1.0 - t) * at_source[s] + t * at_target[d];
        };
        double open = 0.0;
        for (Index i = 0; i < cloud.rows(); ++i)
            for (const Index j : nearest[i]) {
                const Index a = first[to_size(i)], b = first[to_size(j)];
                const Eigen::RowVector3d middle = (frame.row(a) + frame.row(b)) / 2.0;
                const double limit = spacing(a) + spacing(b);
                open += (frame.rowwise() - middle).rowwise().norm().minCoeff() > limit;
            }
        return open / static_cast<double>(nearest.indices.size());
    };
    for (std::size_t i = 0; i < pairs.size(); ++i)
        frame.row(static_cast<Eigen::Index>(i)) =
            (1.0 - t) * source.row(pairs[i].source) + t * target.row(pairs[i].target);
    return std::max(side(source, &IndexPair::source), side(target, &IndexPair::target));
}

/// Points of very different spacing, half of which fly apart by their own ways.
void compare_with_brute_force(double scale, double offset) {
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    const Index count = 400;
    Positions source = shapes::sphere(count), target = -shapes::sphere(count);
    for (Index i = 0; i < count; ++i) {
        if (i % 3 == 0) source.row(i) *= 0.01;
        if (i % 2 == 0) target.row(i) += Eigen::RowVector3d(3.0, 0.0, 0.02 * normal(random));
    }
    source = (scale * source).array() + offset;
    target = (scale * target).array() + offset;
    Pairing pairs = identity(count);
    for (Index i = 0; i < count; i += 5) pairs.push_back({i, (i * 7) % count});
    std::ranges::sort(pairs);
    Progress progress;
    const std::vector<double> times{0.1, 0.5, 0.9};
    const auto known = ordered_neighbors(source, 16, progress);
    const auto cracks = find_cracks({source}, {target}, pairs, times, progress, 1 << 30);
    const auto again = find_cracks({source, &known}, {target}, pairs, times, progress, 1 << 30);
    for (std::size_t k = 0; k < times.size(); ++k) {
        EXPECT_NEAR(cracks[k].share, share_by_brute_force(source, target, pairs, times[k]), 1e-12);
        EXPECT_EQ(cracks[k].share, again[k].share);
    }
    EXPECT_GT(cracks.back().share, 0.01);
}

TEST(Cracks, AreThoseOfBruteForce) {
    compare_with_brute_force(1.0, 0.0);
}

TEST(Cracks, AreThoseOfBruteForceAtAnySizeAndPlace) {
    compare_with_brute_force(1e-140, 0.0);
    compare_with_brute_force(1e140, 0.0);
    compare_with_brute_force(1.0, -1e6);
    compare_with_brute_force(1.0, 1e10);  // a millionth is rounded away
}

TEST(Cracks, TakePointsThatAreThereManyTimes) {
    // Eight at each place: their spacing is 0, and so are more than half of the limits.
    Positions source(8 * 50 + 100, 3);
    for (Index i = 0; i < 50; ++i)
        for (Index k = 0; k < 8; ++k) source.row(8 * i + k) = shapes::sphere(50).row(i);
    source.bottomRows(100) = 1.1 * shapes::sphere(100);
    Positions target = source;
    target.col(2) *= 1.5;
    for (Index i = 0; i < target.rows(); i += 3) target(i, 0) += 2.0;
    Progress progress;
    const std::vector<double> times{0.0, 0.5, 1.0};
    const Pairing pairs = identity(to_index(source.rows()));
    const auto cracks = find_cracks({source}, {target}, pairs, times, progress, 1 << 30);
    for (std::size_t k = 0; k < times.size(); ++k)
        EXPECT_NEAR(cracks[k].share, share_by_brute_force(source, target, pairs, times[k]), 0.02);
}

TEST(Example, Cracks) {
    const Positions source = shapes::grid(40);
    Positions target = source;
    for (Index i = 0; i < target.rows(); ++i) target(i, 0) += target(i, 0) > 0 ? 0.5 : -0.5;
    const Pairing pairs = identity(40 * 40);
    Progress progress;
    // --- example
    const auto cracks =
        find_cracks({source}, {target}, pairs, std::array{0.25, 0.5, 0.75}, progress);
    const double at_half = cracks[1].share;
    // --- end of the example
    EXPECT_EQ(cracks[1].t, 0.5);
    EXPECT_GT(at_half, 0.0);
    EXPECT_LT(at_half, 0.05);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/extremities.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <random>

#include "pointmorph/registration.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

/// Enough points that they are even on the spikes too, once thinned.
CoarseShape urchin(const std::vector<Vector3>& spikes, unsigned seed) {
    const shapes::Urchin u(60000, spikes, seed);
    Progress progress;
    CoarseShapeOptions options;
    options.points = 2000;
    return coarse_shape(KdTree<3>(u.positions), u.normals, {}, options, progress);
}

const std::vector<Vector3>& four_spikes() {
    static const std::vector<Vector3> spikes{Vector3::UnitX(), -Vector3::UnitX(), Vector3::UnitY(),
                                             Vector3::UnitZ()};
    return spikes;
}

TEST(Extremities, AreTheEndsOfTheSpikesFirstOfAll) {
    const CoarseShape shape = urchin(four_spikes(), 3);
    const auto tips = extremities(shape, node_distances(shape), {});
    ASSERT_GE(tips.size(), 4u);
    for (const Vector3& spike : four_spikes())
        EXPECT_TRUE(std::any_of(tips.begin(), tips.begin() + 4, [&](const Extremity& tip) {
            return (shape.positions.row(tip.point).transpose() - 1.5 * spike).norm() < 0.1;
        }));
    // The ball's back, where no spike is, bulges too; nothing else does.
    ASSERT_LE(tips.size(), 5u);
    if (tips.size() == 5) {
        EXPECT_LT(tips[4].prominence, 0.6 * tips[3].prominence);
    }
    EXPECT_TRUE(std::ranges::is_sorted(tips, std::greater<>(), &Extremity::prominence));
}

TEST(Extremities, NoMoreThanAskedFor) {
    const CoarseShape shape = urchin(four_spikes(), 3);
    ExtremityOptions options;
    options.most = 2;
    EXPECT_EQ(extremities(shape, node_distances(shape), options).size(), 2u);
    options.most = 0;
    EXPECT_TRUE(extremities(shape, node_distances(shape), options).empty());
}

TEST(Extremities, ArePairedWhereTheMapTakesThem) {
    const CoarseShape source = urchin(four_spikes(), 3);
    const CoarseShape target = urchin({Vector3::UnitX(), Vector3::UnitY(), Vector3::UnitZ()}, 4);
    const auto a = extremities(source, node_distances(source), {});
    const auto b = extremities(target, node_distances(target), {});
    const auto pairs =
        paired_extremities(source, target, source.positions, target.positions, a, b, {});
    std::vector<Vector3> paired;
    for (const ExtremityPair& p : pairs) {
        paired.push_back(source.positions.row(a[static_cast<std::size_t>(p.source)].point));
        EXPECT_LT((paired.back() -
                   target.positions.row(b[static_cast<std::size_t>(p.target)].point).transpose())
                      .norm(),
                  0.3);
    }
    const auto is_paired = [&](const Vector3& spike) {
        return std::ranges::any_of(
            paired, [&](const Vector3& tip) { return (tip - 1.5 * spike).norm() < 0.1; });
    };
    for (const Vector3& spike : four_spikes()) EXPECT_EQ(is_paired(spike), spike.x() >= 0.0);
}

TEST(Extremities, LeastAssignmentIsTheBestOfAllPermutations) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> cost(0.0, 1.0);
    for (const auto& [rows, columns] : {std::pair(1, 1), {3, 3}, {4, 6}, {5, 5}, {0, 2}})
        for (int repeat = 0; repeat < 10; ++repeat) {
            const Eigen::MatrixXd costs =
                Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return cost(random); });
            std::vector<Index> order(static_cast<std::size_t>(columns));
            std::iota(order.begin(), order.end(), 0);
            double least = std::numeric_limits<double>::infinity();
            do {
                double sum = 0.0;
                for (Index i = 0; i < rows; ++i)
                    sum += costs(i, order[static_cast<std::size_t>(i)]);
                least = std::min(least, sum);
            } while (std::ranges::next_permutation(order).found);
            const auto found = least_assignment(costs);
            double sum = 0.0;
            for (Index i = 0; i < rows; ++i) sum += costs(i, found[static_cast<std::size_t>(i)]);
            EXPECT_NEAR(sum, least, 1e-12);
        }
}

TEST(Extremities, EachOthersBestIsBestByFarOfItsRowAndColumn) {
    Eigen::MatrixXd costs(3, 3);
    costs << 0.1, 0.5, 0.9,  //
        0.6, 0.2, 0.25,      // two that are nearly as good
        0.8, 0.9, 0.7;       // too dear
    EXPECT_EQ(each_others_best(costs, 0.6, 1.5), (std::vector<IndexPair>{{0, 0}}));
    EXPECT_EQ(each_others_best(costs, 0.6, 1.2), (std::vector<IndexPair>{{0, 0}, {1, 1}}));
    EXPECT_TRUE(each_others_best(Eigen::MatrixXd(0, 2), 1.0, 1.5).empty());
}

/// All ways to pair some of the tips, each at most once.
void all_pairings(Index source, Index sources, Index targets, std::vector<IndexPair>& pairs,
                  std::vector<std::vector<IndexPair>>& all) {
    if (source == sources) {
        all.push_back(pairs);
        return;
    }
    all_pairings(source + 1, sources, targets, pairs, all);
    for (Index t = 0; t < targets; ++t) {
        if (std::ranges::find(pairs, t, &IndexPair::target) != pairs.end()) continue;
        pairs.push_back({source, t});
        all_pairings(source + 1, sources, targets, pairs, all);
        pairs.pop_back();
    }
}

TEST(Extremities, ChangedPairingsAreThoseOfAllThatDifferLittle) {
    const Index sources = 5, targets = 5;
    const std::vector<IndexPair> now{{0, 2}, {1, 0}, {3, 3}, {4, 1}};
    std::vector<std::vector<IndexPair>> all, wanted;
    std::vector<IndexPair> none;
    all_pairings(0, sources, targets, none, all);
    for (const auto& pairs : all) {
        std::vector<IndexPair> lost, won;
        std::ranges::set_difference(now, pairs, std::back_inserter(lost));
        std::ranges::set_difference(pairs, now, std::back_inserter(won));
        const auto same = [&](Index IndexPair::*side) {
            std::vector<Index> a, b;
            for (const IndexPair& p : lost) a.push_back(p.*side);
            for (const IndexPair& p : won) b.push_back(p.*side);
            return std::ranges::is_permutation(a, b);
        };
        const bool one = lost.size() + won.size() == 1;
        const bool exchanged = lost.size() == 1 && won.size() == 1 &&
                               (same(&IndexPair::source) || same(&IndexPair::target));
        const bool among = (lost.size() == 2 || lost.size() == 3) && won.size() == lost.size() &&
                           same(&IndexPair::source) && same(&IndexPair::target);
        if (one || exchanged || among) wanted.push_back(pairs);
    }
    auto found = changed_pairings(now, sources, targets);
    std::ranges::sort(found);
    std::ranges::sort(wanted);
    EXPECT_EQ(found.size(), 1u + 4u + 8u + 6u + 8u);
    EXPECT_TRUE(found == wanted);
}

}  // namespace
}  // namespace pointmorph

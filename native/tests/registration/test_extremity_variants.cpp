#include "registration/extremity_variants.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <random>
#include <utility>

namespace pointmorph {
namespace {

/// All ways to pair some of the extremities, each at most once.
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

TEST(ExtremityVariants, ChangedPairingsAreThoseOfAllThatDifferLittle) {
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

/// Of points drawn at random; each target lies off its source by up to `noise`.
NodeDistances random_distances(Index count, double noise, unsigned seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    NodeDistances along;
    Positions places(count, 3);
    for (double& x : places.reshaped()) x = uniform(random);
    for (Eigen::MatrixXd& distances : along) {
        distances.resize(count, count);
        for (Index i = 0; i < count; ++i)
            for (Index j = 0; j < count; ++j)
                distances(i, j) = (places.row(i) - places.row(j)).norm();
        for (double& x : places.reshaped()) x += noise * uniform(random);
    }
    return along;
}

double contradiction(const ExtremityMatches& pairs, const NodeDistances& along) {
    double sum = 0.0;
    for (const IndexPair& p : pairs)
        for (const IndexPair& q : pairs)
            sum += std::abs(along[0](p.source, q.source) - along[1](p.target, q.target));
    return sum;
}

TEST(ExtremityVariants, ExchangedPairingsAreThoseOfAllDoubleSwapsThatDistancesContradictLeast) {
    const ExtremityMatches now{{0, 3}, {1, 0}, {2, 4}, {3, 1}, {4, 2}};  // five have no third swap
    for (const unsigned seed : {1u, 2u, 3u}) {
        const NodeDistances along = random_distances(5, 0.3, seed);
        std::vector<std::pair<double, ExtremityMatches>> all;
        std::vector<Index> order(5);
        std::iota(order.begin(), order.end(), 0);
        do {
            int moved = 0;
            bool is_involution = true;
            for (Index i = 0; i < 5; ++i) {
                moved += order[to_size(i)] != i;
                is_involution &= order[to_size(order[to_size(i)])] == i;
            }
            if (moved != 4 || !is_involution) continue;
            ExtremityMatches pairs = now;
            for (Index i = 0; i < 5; ++i)
                pairs[to_size(i)].target = now[to_size(order[to_size(i)])].target;
            all.emplace_back(contradiction(pairs, along), pairs);
        } while (std::ranges::next_permutation(order).found);
        ASSERT_EQ(all.size(), 15u);
        std::ranges::sort(all, {}, &std::pair<double, ExtremityMatches>::first);
        const auto found = exchanged_pairings(now, along, 4);
        ASSERT_EQ(found.size(), 4u);
        for (std::size_t k = 0; k < found.size(); ++k) EXPECT_TRUE(found[k] == all[k].second) << k;
    }
}

/// Three pairs of limbs on both sides of a body, and its head.
TEST(ExtremityVariants, AllLimbsOfBothSidesAreExchangedAtOnce) {
    Positions places(7, 3);
    places << 1, 0, 0, -1, 0, 0, 1.2, 2, 0, -1.2, 2, 0, 0.8, 5, 0, -0.8, 5, 0, 0, 7, 0.5;
    Eigen::MatrixXd distances(7, 7);
    for (Index i = 0; i < 7; ++i)
        for (Index j = 0; j < 7; ++j) distances(i, j) = (places.row(i) - places.row(j)).norm();
    const ExtremityMatches now{{0, 0}, {1, 1}, {2, 2}, {3, 3}, {4, 4}, {5, 5}, {6, 6}};
    const ExtremityMatches wanted{{0, 1}, {1, 0}, {2, 3}, {3, 2}, {4, 5}, {5, 4}, {6, 6}};
    const auto found = exchanged_pairings(now, {distances, distances}, 1);
    ASSERT_EQ(found.size(), 1u);
    EXPECT_TRUE(found.front() == wanted);
}

TEST(ExtremityVariants, NothingIsExchangedAmongThreePairs) {
    const ExtremityMatches now{{0, 0}, {1, 1}, {2, 2}};
    EXPECT_TRUE(exchanged_pairings(now, random_distances(3, 0.1, 1), 2).empty());
}

}  // namespace
}  // namespace pointmorph

#include "registration/extremity_variants.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <iterator>

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

}  // namespace
}  // namespace pointmorph

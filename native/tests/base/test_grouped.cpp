#include "base/grouped.hpp"

#include <gtest/gtest.h>

#include <random>
#include <utility>
#include <vector>

namespace pointmorph {
namespace {

TEST(Grouped, KeepsTheOrderOfEachGroup) {
    constexpr Index kGroups = 50;
    std::mt19937 random(3);
    std::vector<std::pair<Index, int>> all;
    std::vector<std::vector<int>> expected(to_size(kGroups));
    for (int i = 0; i < 400; ++i) {
        const auto group = static_cast<Index>(random() % (kGroups / 2)) * 2;  // odd ones are empty
        all.emplace_back(group, i);
        expected[to_size(group)].push_back(i);
    }
    Grouped<int> grouped(kGroups, [&](auto&& take) {
        for (const auto& [group, item] : all) take(group, item);
    });
    ASSERT_EQ(grouped.size(), kGroups);
    for (Index g = 0; g < kGroups; ++g) {
        const auto& its = std::as_const(grouped)[g];
        EXPECT_EQ(std::vector<int>(its.begin(), its.end()), expected[to_size(g)]) << g;
    }
    grouped[4].front() = -7;
    EXPECT_EQ(std::as_const(grouped)[4].front(), -7);
}

TEST(Grouped, MayHaveNoItemsAndNoGroups) {
    EXPECT_EQ(Grouped<int>().size(), 0);
    const auto nothing = [](auto&&) {};
    EXPECT_EQ(Grouped<int>(0, nothing).size(), 0);
    const Grouped<int> empty(3, nothing);
    ASSERT_EQ(empty.size(), 3);
    for (Index g = 0; g < 3; ++g) EXPECT_TRUE(empty[g].empty());
}

}  // namespace
}  // namespace pointmorph

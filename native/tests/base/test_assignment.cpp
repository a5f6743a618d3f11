#include "pointmorph/base/assignment.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <random>
#include <utility>

namespace pointmorph {
namespace {

TEST(Assignment, LeastCostIsTheBestOfAllPermutations) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> cost(0.0, 1.0);
    for (const auto& [rows, columns] : {std::pair(1, 1), {3, 3}, {4, 6}, {5, 5}, {0, 2}})
        for (int repeat = 0; repeat < 10; ++repeat) {
            const Eigen::MatrixXd costs =
                Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return cost(random); });
            std::vector<Index> order(to_size(columns));
            std::iota(order.begin(), order.end(), 0);
            double least = std::numeric_limits<double>::infinity();
            do {
                double sum = 0.0;
                for (Index i = 0; i < rows; ++i) sum += costs(i, order[to_size(i)]);
                least = std::min(least, sum);
            } while (std::ranges::next_permutation(order).found);
            const auto found = least_assignment(costs);
            double sum = 0.0;
            for (Index i = 0; i < rows; ++i) sum += costs(i, found[to_size(i)]);
            EXPECT_NEAR(sum, least, 1e-12);
        }
}

TEST(Assignment, EachOthersBestIsBestByFarOfItsRowAndColumn) {
    Eigen::MatrixXd costs(3, 3);
    costs << 0.1, 0.5, 0.9,  //
        0.6, 0.2, 0.25,      // two that are nearly as good
        0.8, 0.9, 0.7;       // too dear
    EXPECT_EQ(each_others_best(costs, 0.6, 1.5), (std::vector<IndexPair>{{0, 0}}));
    EXPECT_EQ(each_others_best(costs, 0.6, 1.2), (std::vector<IndexPair>{{0, 0}, {1, 1}}));
    EXPECT_TRUE(each_others_best(Eigen::MatrixXd(0, 2), 1.0, 1.5).empty());
}

TEST(Assignment, CheapestPairsLeaveAloneWhatCostsMore) {
    Eigen::MatrixXd costs(3, 2);
    costs << 0.1, 0.2,  //
        0.2, 0.9,       //
        0.6, 0.7;
    // 0.1 + alone would cost more than 0.2 + 0.2.
    EXPECT_EQ(cheapest_pairs(costs, 0.5), (std::vector<IndexPair>{{0, 1}, {1, 0}}));
    EXPECT_EQ(cheapest_pairs(costs, 0.2), (std::vector<IndexPair>{{0, 0}}));
    EXPECT_TRUE(cheapest_pairs(costs, 0.1).empty());
    EXPECT_TRUE(cheapest_pairs(Eigen::MatrixXd(0, 2), 0.5).empty());
    EXPECT_TRUE(cheapest_pairs(Eigen::MatrixXd(2, 0), 0.5).empty());
}

}  // namespace
}  // namespace pointmorph

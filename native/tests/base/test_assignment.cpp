#include "pointmorph/base/assignment.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <random>
#include <utility>
#include <vector>

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

/// The least sum of costs where each column is one row's, and row i has `shares[i]` of them.
double least_even(const Eigen::MatrixXd& costs, std::vector<int>& shares, Eigen::Index column) {
    if (column == costs.cols()) return 0.0;
    double least = std::numeric_limits<double>::infinity();
    for (Eigen::Index i = 0; i < costs.rows(); ++i) {
        int& left = shares[static_cast<std::size_t>(i)];
        if (left == 0) continue;
        --left;
        least = std::min(least, costs(i, column) + least_even(costs, shares, column + 1));
        ++left;
    }
    return least;
}

TEST(Assignment, EvenOneIsTheBestOfAllWithItsShares) {
    std::mt19937 random(2);
    std::uniform_real_distribution<double> cost(0.0, 1.0);
    for (const auto& [rows, columns] : {std::pair(1, 1), {1, 4}, {2, 5}, {3, 6}, {4, 4}, {4, 7}})
        for (int repeat = 0; repeat < 5; ++repeat) {
            const Eigen::MatrixXd costs =
                Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return cost(random); });
            const std::vector<std::vector<Index>> found = even_assignment(costs);
            ASSERT_EQ(found.size(), to_size(rows));
            std::vector<int> shares, taken(to_size(columns), 0);
            double sum = 0.0;
            for (Index i = 0; i < rows; ++i) {
                shares.push_back(static_cast<int>(found[to_size(i)].size()));
                for (const Index j : found[to_size(i)]) {
                    ++taken[to_size(j)];
                    sum += costs(i, j);
                }
            }
            EXPECT_EQ(taken, std::vector<int>(to_size(columns), 1));
            EXPECT_LE(std::ranges::max(shares) - std::ranges::min(shares), 1);
            EXPECT_NEAR(sum, least_even(costs, shares, 0), 1e-12);
            // The other way round, each row is one column's, at the same cost.
            const std::vector<std::vector<Index>> back = even_assignment(costs.transpose());
            ASSERT_EQ(back.size(), to_size(columns));
            double sum_back = 0.0;
            for (Index j = 0; j < columns; ++j) {
                ASSERT_EQ(back[to_size(j)].size(), 1u);
                sum_back += costs(back[to_size(j)].front(), j);
            }
            EXPECT_NEAR(sum_back, sum, 1e-12);
        }
    EXPECT_TRUE(even_assignment(Eigen::MatrixXd(0, 3)).empty());
    EXPECT_EQ(even_assignment(Eigen::MatrixXd(2, 0)), std::vector<std::vector<Index>>(2));
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

#include "cloud/nearby_search.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

namespace pointmorph {
namespace {

using Keys = KdTree<6>::Points;
constexpr std::size_t kWanted = 5;

/// All queries, in order and in another, find what the tree finds.
void compare_with_tree(const Keys& points, const Keys& queries) {
    const KdTree<6> tree(points);
    Progress progress;
    const NearbySearch<6> search(tree, progress);
    std::mt19937 random(1);
    for (const bool in_order : {true, false}) {
        Index beside = 0;
        for (Eigen::Index i = 0; i < queries.rows(); ++i) {
            if (!in_order) beside = static_cast<Index>(random() % to_size(tree.size()));
            std::array<Index, kWanted> expected{}, found{};
            std::array<double, kWanted> expected_squared{}, squared{};
            const double* query = queries.row(i).data();
            const Index count = tree.nearest(query, expected, expected_squared);
            ASSERT_EQ(search.nearest(query, beside, found, squared), count);
            for (std::size_t k = 0; k < to_size(count); ++k) {
                ASSERT_EQ(found[k], expected[k]) << "query " << i;
                ASSERT_EQ(squared[k], expected_squared[k]);
            }
            ASSERT_EQ(beside, expected[0]);
        }
    }
}

/// On a spiral around a cylinder, one after the other, with normals.
Keys spiral(Index count, double noise) {
    std::mt19937 random(2);
    std::normal_distribution<double> normal;
    Keys points(count, 6);
    for (Index i = 0; i < count; ++i) {
        const double angle = 0.2 * i, height = 0.001 * i;
        points.row(i) << std::cos(angle), std::sin(angle), height, std::cos(angle), std::sin(angle),
            0.0;
        for (int d = 0; d < 6; ++d) points(i, d) += noise * normal(random);
    }
    return points;
}

TEST(NearbySearch, FindsWhatTheTreeFinds) {
    compare_with_tree(spiral(800, 0.01), spiral(3000, 0.03));
}

TEST(NearbySearch, FindsTheLowerRowOfThoseThatAreEquallyFar) {
    Keys grid(512, 6);
    for (Index i = 0; i < 512; ++i) grid.row(i) << i % 8, i / 8 % 8, i / 64, 0, 0, 0;
    Keys between = grid;
    between.leftCols(3).array() += 0.5;
    compare_with_tree(grid, grid);
    compare_with_tree(grid, between);
}

TEST(NearbySearch, FindsWhatTheTreeFindsInCrowds) {
    Keys crowd = spiral(200, 0.0);
    for (Index i = 0; i < 150; ++i) crowd.row(i) = crowd.row(i / 15 * 15);
    compare_with_tree(crowd, crowd);
    compare_with_tree(Keys::Zero(40, 6), spiral(50, 0.1));
}

TEST(NearbySearch, AsksTheTreeOfAFewPoints) {
    for (const Index count : {1, 3, 5, 23, 24, 25})
        compare_with_tree(spiral(count, 0.1), spiral(100, 0.1));
}

TEST(NearbySearch, OfNothingIsNothing) {
    const Keys none(0, 6);
    const KdTree<6> tree(none);
    Progress progress;
    const NearbySearch<6> search(tree, progress);
    Index beside = 0, row = 7;
    double squared = 0.0;
    const std::array<double, 6> query{};
    EXPECT_EQ(search.nearest(query.data(), beside, {&row, 1}, {&squared, 1}), 0);
}

}  // namespace
}  // namespace pointmorph

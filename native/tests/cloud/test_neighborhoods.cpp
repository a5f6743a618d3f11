#include "pointmorph/cloud/neighborhoods.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "cloud/neighbor_room.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

Neighborhoods nearest(const Positions& p, Index k) {
    Progress progress;
    return nearest_neighbors(KdTree<3>(p), k, progress);
}

Neighborhoods in_balls(const Positions& p, double radius) {
    Progress progress;
    return radius_neighbors(KdTree<3>(p), radius, progress);
}

std::vector<Index> list(const Neighborhoods& neighborhoods, Index i) {
    return {neighborhoods[i].begin(), neighborhoods[i].end()};
}

/// All other rows by distance, then row, with their squared distances.
std::vector<std::pair<double, Index>> by_distance(const Positions& p, Index i) {
    std::vector<std::pair<double, Index>> all;
    for (Index j = 0; j < p.rows(); ++j)
        if (j != i) all.emplace_back((p.row(j) - p.row(i)).squaredNorm(), j);
    std::ranges::sort(all);
    return all;
}

TEST(Neighborhoods, NearestAgreeWithBruteForce) {
    for (const Positions& p : {shapes::cube_noise(700), shapes::grid(15), shapes::sphere(300)})
        for (const Index k : {1, 9, 30}) {
            const auto found = nearest(p, k);
            ASSERT_EQ(found.size(), p.rows());
            for (Index i = 0; i < p.rows(); ++i) {
                const auto all = by_distance(p, i);
                ASSERT_EQ(found[i].size(), to_size(k));
                for (std::size_t n = 0; n < found[i].size(); ++n)
                    EXPECT_EQ(found[i][n], all[n].second);
            }
        }
}

TEST(Neighborhoods, AreTheSameInRoomThatWasMadeBefore) {
    Progress progress;
    for (const Positions& p : {shapes::cube_noise(1500), shapes::cube_noise(5), Positions(0, 3)})
        for (const Index k : {0, 1, 9, 30}) {
            const auto found = nearest_neighbors(
                KdTree<3>(p), room_for_neighbors(to_index(p.rows()), k), progress);
            const auto expected = nearest(p, k);
            EXPECT_EQ(found.offsets, expected.offsets);
            EXPECT_EQ(found.indices, expected.indices);
        }
}

TEST(Neighborhoods, BallsAgreeWithTheDefinition) {
    Positions p = shapes::cube_noise(600);
    p.middleRows(100, 40).rowwise() = p.row(99).eval();  // at the very same place: no neighbors
    for (const double radius : {0.05, 0.2, 0.5, 4.0}) {
        const auto found = in_balls(p, radius);
        ASSERT_EQ(found.size(), p.rows());
        for (Index i = 0; i < p.rows(); ++i) {
            std::vector<Index> expected;
            for (const auto& [squared_distance, j] : by_distance(p, i))
                if (squared_distance > 0.0 && squared_distance < radius * radius)
                    expected.push_back(j);
            EXPECT_EQ(list(found, i), expected);
        }
    }
    // The bound is strict.
    const Positions grid = shapes::grid(5);  // spacing 0.5, exactly
    EXPECT_TRUE(in_balls(grid, 0.5).indices.empty());
    EXPECT_EQ(in_balls(grid, 0.51)[12].size(), 4u);
}

TEST(Neighborhoods, SmallCloudsGiveWhatThereIs) {
    for (const Index count : {0, 1, 2, 5}) {
        const Positions p = shapes::cube_noise(count);
        const auto found = nearest(p, 16);
        ASSERT_EQ(found.size(), count);
        for (Index i = 0; i < count; ++i) EXPECT_EQ(found[i].size(), to_size(count - 1));
        EXPECT_EQ(in_balls(p, 1.0).size(), count);
        EXPECT_EQ(symmetrized(found).size(), count);
        EXPECT_EQ(local_spacing(p, found).size(), count);
    }
    EXPECT_TRUE(nearest(shapes::cube_noise(10), 0).indices.empty());
}

TEST(Neighborhoods, CoincidentPointsAreNeighborsButNotOfThemselves) {
    const Positions p = Positions::Constant(40, 3, 1.5);
    const auto found = nearest(p, 16);
    for (Index i = 0; i < p.rows(); ++i) {
        const std::set<Index> different(found[i].begin(), found[i].end());
        EXPECT_EQ(different.size(), 16u);
        EXPECT_FALSE(different.contains(i));
    }
    EXPECT_TRUE(in_balls(p, 1.0).indices.empty());
}

TEST(Neighborhoods, DoNotDependOnThreads) {
    const Positions p = shapes::torus(5000, 0.4);
    Neighborhoods by_count[2], in_ball[2];
    for (const int threads : {1, 4}) {
        const ThreadCount scope(threads);
        by_count[threads > 1] = nearest(p, 12);
        in_ball[threads > 1] = in_balls(p, 0.1);
    }
    EXPECT_EQ(by_count[0].indices, by_count[1].indices);
    EXPECT_EQ(in_ball[0].indices, in_ball[1].indices);
    EXPECT_EQ(in_ball[0].offsets, in_ball[1].offsets);
}

TEST(Neighborhoods, FollowTheOrderOfThePoints) {
    const Positions p = shapes::torus(2000, 0.4);
    const auto order = shapes::permutation(2000, 12);
    const auto a = nearest(p, 10), b = nearest(gather(p, order), 10);
    for (Index i = 0; i < p.rows(); ++i)
        for (std::size_t n = 0; n < 10; ++n)
            EXPECT_EQ(order[to_size(b[i][n])], a[order[to_size(i)]][n]);
}

TEST(Neighborhoods, CanBeCancelled) {
    const Positions p = shapes::torus(5000, 0.4);
    const KdTree<3> tree(p);
    Progress one([](std::string_view, double) { return false; });
    EXPECT_THROW(nearest_neighbors(tree, 10, one), Cancelled);
    Progress other([](std::string_view, double) { return false; });
    EXPECT_THROW(radius_neighbors(tree, 0.1, other), Cancelled);
}

TEST(Symmetrized, HoldsBothDirectionsOnceAndSorted) {
    const Positions p = shapes::cube_noise(500);
    const auto one_way = nearest(p, 7);
    std::vector<std::set<Index>> expected(500);
    for (Index i = 0; i < p.rows(); ++i)
        for (const Index j : one_way[i]) {
            expected[to_size(i)].insert(j);
            expected[to_size(j)].insert(i);
        }
    const auto found = symmetrized(one_way);
    ASSERT_EQ(found.size(), 500);
    for (Index i = 0; i < p.rows(); ++i) {
        const auto& set = expected[to_size(i)];
        EXPECT_EQ(list(found, i), std::vector<Index>(set.begin(), set.end()));
    }
    EXPECT_EQ(symmetrized(found).indices, found.indices);
    Neighborhoods twice;
    twice.indices = {2, 1, 2, 0};  // of the first three, and of the second one
    twice.offsets = {0, 3, 4, 4};
    EXPECT_EQ(symmetrized(twice).indices, (std::vector<Index>{1, 2, 0, 0}));
}

TEST(Filtered, LeavesOutPairsAndKeepsTheOrder) {
    const Positions p = shapes::cube_noise(300);
    const auto all = nearest(p, 8);
    const auto keep = [](Index i, Index j) { return (i + j) % 3 != 0; };
    const auto found = filtered(all, keep);
    ASSERT_EQ(found.size(), 300);
    for (Index i = 0; i < p.rows(); ++i) {
        std::vector<Index> expected;
        for (const Index j : all[i])
            if (keep(i, j)) expected.push_back(j);
        EXPECT_EQ(list(found, i), expected);
    }
}

/// Labels by repeated spreading of the lowest row.
std::vector<Index> spread_labels(const Neighborhoods& neighborhoods) {
    std::vector<Index> label(to_size(neighborhoods.size()));
    for (std::size_t i = 0; i < label.size(); ++i) label[i] = to_index(i);
    for (bool changed = true; changed;) {
        changed = false;
        for (Index i = 0; i < neighborhoods.size(); ++i)
            for (const Index j : neighborhoods[i]) {
                auto& a = label[to_size(i)];
                auto& b = label[to_size(j)];
                if (a != b) a = b = std::min(a, b), changed = true;
            }
    }
    return label;
}

TEST(ConnectedComponents, AreTheSpreadOfTheLowestRow) {
    for (const Index k : {1, 2, 3}) {  // few neighbors, many components
        const auto near = nearest(shapes::cube_noise(400), k);
        const auto found = connected_components(near);
        const auto lowest = spread_labels(near);
        std::vector<Index> sizes;
        for (std::size_t i = 0; i < lowest.size(); ++i) {
            if (lowest[i] == to_index(i)) {  // the first of a new component
                EXPECT_EQ(found.label[i], to_index(sizes.size()));
                sizes.push_back(0);
            }
            EXPECT_EQ(found.label[i], found.label[to_size(lowest[i])]);
            ++sizes[to_size(found.label[i])];
        }
        EXPECT_EQ(found.sizes, sizes);
        EXPECT_EQ(found.count(), to_index(sizes.size()));
        EXPECT_GT(found.count(), k == 1 ? 50 : 0);
    }
}

TEST(ConnectedComponents, GrowWithEachEdge) {
    GrowingComponents connected(6);
    EXPECT_FALSE(connected.are_joined(0, 5));
    EXPECT_TRUE(connected.are_joined(3, 3));
    connected.join(5, 2);
    connected.join(2, 0);
    connected.join(0, 5);  // again
    connected.join(4, 3);
    EXPECT_TRUE(connected.are_joined(0, 5));
    EXPECT_FALSE(connected.are_joined(4, 5));
    const ConnectedComponents found = connected.components();
    EXPECT_EQ(found.label, (std::vector<Index>{0, 1, 0, 2, 2, 0}));
    EXPECT_EQ(found.sizes, (std::vector<Index>{3, 1, 2}));
}

TEST(ConnectedComponents, OneArrowIsEnough) {
    const Neighborhoods chain{{0, 0, 1, 2, 2}, {0, 1}};  // 1 → 0, 2 → 1; 3 alone
    const auto found = connected_components(chain);
    EXPECT_EQ(found.label, (std::vector<Index>{0, 0, 0, 1}));
    EXPECT_EQ(found.sizes, (std::vector<Index>{3, 1}));
    EXPECT_EQ(connected_components(Neighborhoods{}).count(), 0);
}

TEST(LocalSpacing, IsOneOverTheRootOfTheDensity) {
    // Random points of known density ρ: the mean of the squared spacing is 1/ρ, with a relative
    // error of 1/√(6 · 4000).
    const Index count = 4000;
    const double area = 4.0 * std::numbers::pi * std::numbers::pi * 0.4;
    for (const double scale : {1e-6, 1.0, 1e6}) {
        const Positions p = scale * shapes::torus(count, 0.4);
        const Values spacing = local_spacing(p, nearest(p, 12));
        EXPECT_NEAR(spacing.squaredNorm() / count, scale * scale * area / count,
                    0.03 * scale * scale * area / count);
    }
    const Positions grid = shapes::grid(21);  // spacing 0.1; the sixth neighbor is at √2 of it
    EXPECT_NEAR(local_spacing(grid, nearest(grid, 8))[220],
                0.1 * std::sqrt(2.0 * std::numbers::pi / 6.0), 1e-12);
    EXPECT_NEAR(local_spacing(grid, nearest(grid, 4))[220], 0.1 * std::sqrt(std::numbers::pi / 4.0),
                1e-12);
    EXPECT_EQ(local_spacing(Positions::Zero(1, 3), nearest(Positions::Zero(1, 3), 4))[0], 0.0);
}

TEST(Example, Neighborhoods) {
    const Positions positions = shapes::sphere(300);
    Progress progress;
    // --- example
    const KdTree<3> tree(positions);
    const Neighborhoods near = nearest_neighbors(tree, 16, progress);
    Eigen::RowVector3d middle = Eigen::RowVector3d::Zero();
    for (const Index j : near[7]) middle += positions.row(j) / 16.0;
    // --- end of the example
    EXPECT_EQ(list(near, 7), list(nearest(positions, 16), 7));
    EXPECT_LT((middle - positions.row(7)).norm(), 0.2);
}

}  // namespace
}  // namespace pointmorph

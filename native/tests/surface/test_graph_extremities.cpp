#include "pointmorph/surface/graph_extremities.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <random>
#include <set>

namespace pointmorph {
namespace {

/// A tree of unit edges: every node from 1 on hangs on `parents[node − 1]`.
SurfaceGraph tree_of(const std::vector<Index>& parents) {
    std::vector<std::vector<Index>> neighbors(parents.size() + 1);
    for (std::size_t k = 0; k < parents.size(); ++k) {
        neighbors[k + 1].push_back(parents[k]);
        neighbors[to_size(parents[k])].push_back(to_index(k + 1));
    }
    SurfaceGraph graph;
    for (auto& row : neighbors) {
        std::ranges::sort(row);
        graph.neighbors.insert(graph.neighbors.end(), row.begin(), row.end());
        graph.offsets.push_back(static_cast<std::int64_t>(graph.neighbors.size()));
    }
    graph.lengths.assign(graph.neighbors.size(), 1.0);
    return graph;
}

/// Chains of the given lengths that hang on node 0; and their ends.
struct Star {
    SurfaceGraph graph;
    std::vector<Index> ends;

    explicit Star(const std::vector<Index>& lengths) {
        std::vector<Index> parents;
        for (const Index length : lengths) {
            Index last = 0;
            for (Index k = 0; k < length; ++k) {
                parents.push_back(last);
                last = to_index(parents.size());
            }
            ends.push_back(last);
        }
        graph = tree_of(parents);
    }
};

TEST(GraphExtremities, AreTheEndsOfAStarTheLongestFirst) {
    const Star star({20, 35, 28, 12});
    Progress progress;
    const auto tips = extremities(star.graph, 1.0, {12, 1.0, 200}, progress);
    ASSERT_EQ(tips.size(), 4u);
    EXPECT_EQ(tips[0].point, star.ends[1]);
    EXPECT_EQ(tips[1].point, star.ends[2]);
    EXPECT_EQ(tips[2].point, star.ends[0]);
    EXPECT_EQ(tips[3].point, star.ends[3]);
    EXPECT_TRUE(std::ranges::is_sorted(tips, std::greater<>(), &Extremity::prominence));
}

TEST(GraphExtremities, NoMoreThanAskedForAndNoneThatIsLessProminent) {
    const Star star({20, 35, 28, 12});
    Progress progress;
    const auto all = extremities(star.graph, 1.0, {12, 1.0, 200}, progress);
    EXPECT_EQ(extremities(star.graph, 1.0, {2, 1.0, 200}, progress).size(), 2u);
    EXPECT_TRUE(extremities(star.graph, 1.0, {0, 1.0, 200}, progress).empty());
    EXPECT_EQ(extremities(star.graph, 1.0, {12, all[2].prominence, 200}, progress).size(), 2u);
    EXPECT_TRUE(extremities(SurfaceGraph{}, 1.0, {12, 1.0, 200}, progress).empty());
}

TEST(GraphExtremities, ScaleWithTheUnit) {
    const Star star({20, 35, 28});
    Progress progress;
    const auto one = extremities(star.graph, 1.0, {12, 0.1, 50}, progress);
    const auto ten = extremities(star.graph, 10.0, {12, 0.01, 50}, progress);
    ASSERT_EQ(one.size(), ten.size());
    for (std::size_t k = 0; k < one.size(); ++k) {
        EXPECT_EQ(one[k].point, ten[k].point);
        EXPECT_NEAR(one[k].prominence, 10.0 * ten[k].prominence, 1e-9);
    }
}

/// By definition: the least fall over all paths to something higher, found by flooding.
double prominence_by_flooding(const SurfaceGraph& graph, const Eigen::VectorXd& height,
                              Index peak) {
    std::vector<double> levels(height.begin(), height.end());
    std::ranges::sort(levels, std::greater<>());
    for (const double level : levels) {
        if (level > height[peak]) continue;
        std::set<Index> reached{peak};
        std::vector<Index> open{peak};
        while (!open.empty()) {
            const Index i = open.back();
            open.pop_back();
            if (height[i] > height[peak]) return height[peak] - level;
            for (auto e = to_size(graph.offsets[to_size(i)]);
                 e < to_size(graph.offsets[to_size(i) + 1]); ++e) {
                const Index j = graph.neighbors[e];
                if (height[j] >= level && reached.insert(j).second) open.push_back(j);
            }
        }
    }
    return height[peak] - levels.back();
}

TEST(GraphExtremities, ProminenceIsWhatFloodingSays) {
    std::mt19937 random(7);
    for (int repeat = 0; repeat < 20; ++repeat) {
        std::vector<Index> parents;
        for (Index k = 0; k < 30; ++k)
            parents.push_back(std::uniform_int_distribution<Index>(0, k)(random));
        const SurfaceGraph graph = tree_of(parents);
        std::uniform_real_distribution<double> any(0.0, 1.0);
        const Eigen::VectorXd height =
            Eigen::VectorXd::NullaryExpr(graph.size(), [&] { return any(random); });
        const std::vector<double> found = prominences(graph.offsets, graph.neighbors, height);
        ASSERT_EQ(found.size(), to_size(graph.size()));
        for (Index i = 0; i < graph.size(); ++i) {
            bool is_peak = true;
            for (auto e = to_size(graph.offsets[to_size(i)]);
                 e < to_size(graph.offsets[to_size(i) + 1]); ++e)
                is_peak = is_peak && height[graph.neighbors[e]] < height[i];
            EXPECT_NEAR(found[to_size(i)], is_peak ? prominence_by_flooding(graph, height, i) : 0.0,
                        1e-12);
        }
    }
}

TEST(GraphExtremities, MostProminentAreSortedAndStable) {
    EXPECT_EQ(most_prominent({0.5, 0.0, 0.9, 0.5, 0.2}, 3, 0.1), (std::vector<Index>{2, 0, 3}));
    EXPECT_EQ(most_prominent({0.5, 0.0, 0.9, 0.5, 0.2}, 9, 0.2), (std::vector<Index>{2, 0, 3}));
    EXPECT_TRUE(most_prominent({0.5}, -1, 0.1).empty());
}

TEST(Example, GraphExtremities) {
    const Star star({20, 35, 28, 12});
    const SurfaceGraph& graph = star.graph;
    const double unit = 30.0;
    Progress progress;
    // --- example
    std::vector<Index> ends;
    for (const Extremity& e : extremities(graph, unit, {.most = 8}, progress))
        ends.push_back(e.point);
    // --- end of the example
    EXPECT_TRUE(std::ranges::is_permutation(ends, star.ends));
}

}  // namespace
}  // namespace pointmorph

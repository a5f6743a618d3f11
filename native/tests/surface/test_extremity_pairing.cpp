#include "pointmorph/surface/extremity_pairing.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <span>

namespace pointmorph {
namespace {

/// Chains of unit edges, of the given lengths, that hang on node 0; and their ends.
struct MarkedStar {
    SurfaceGraph graph;
    std::vector<Index> ends;

    explicit MarkedStar(const std::vector<Index>& lengths) {
        std::vector<std::vector<Index>> neighbors(1);
        for (const Index length : lengths) {
            Index last = 0;
            for (Index k = 0; k < length; ++k) {
                const auto node = to_index(neighbors.size());
                neighbors.push_back({last});
                neighbors[to_size(last)].push_back(node);
                last = node;
            }
            ends.push_back(last);
        }
        for (const auto& row : neighbors) {
            graph.neighbors.insert(graph.neighbors.end(), row.begin(), row.end());
            graph.offsets.push_back(static_cast<std::int64_t>(graph.neighbors.size()));
        }
        graph.lengths.assign(graph.neighbors.size(), 1.0);
    }

    /// With features at the first of the ends.
    UnmarkedExtremities unmarked(std::size_t features, double unit) const {
        Progress progress;
        const Eigen::MatrixXd from = distances_from(graph, unit, std::span(ends).first(features));
        return unmarked_extremities(graph, unit, from, {}, progress);
    }
};

TEST(ExtremityPairing, DistancesAreThoseAlongTheGraphInUnits) {
    const MarkedStar star({4, 6});
    const Eigen::MatrixXd from = distances_from(star.graph, 2.0, star.ends);
    ASSERT_EQ(from.rows(), 11);
    ASSERT_EQ(from.cols(), 2);
    EXPECT_DOUBLE_EQ(from(0, 0), 2.0);
    EXPECT_DOUBLE_EQ(from(star.ends[1], 0), 5.0);
    EXPECT_DOUBLE_EQ(from(star.ends[0], 1), 5.0);
    EXPECT_DOUBLE_EQ(from(star.ends[1], 1), 0.0);
}

TEST(ExtremityPairing, WhatAFeatureMarksIsLeftOut) {
    const MarkedStar star({20, 35, 28});
    const UnmarkedExtremities all = star.unmarked(0, 30.0);
    EXPECT_TRUE(std::ranges::is_permutation(all.rows, star.ends));
    EXPECT_EQ(all.distances.cols(), 0);
    const UnmarkedExtremities two = star.unmarked(1, 30.0);
    EXPECT_TRUE(std::ranges::is_permutation(two.rows, std::span(star.ends).subspan(1)));
    ASSERT_EQ(two.distances.rows(), 2);
    for (Eigen::Index k = 0; k < 2; ++k)
        EXPECT_DOUBLE_EQ(two.distances(k, 0),
                         (two.rows[to_size(k)] == star.ends[1] ? 55.0 : 48.0) / 30.0);
    Progress progress;
    const Eigen::MatrixXd from = distances_from(star.graph, 30.0, {});
    EXPECT_TRUE(unmarked_extremities(star.graph, 30.0, from, {.most = 0}, progress).rows.empty());
}

TEST(ExtremityPairing, PairsThoseAsFarFromAllFeatures) {
    const MarkedStar source({20, 30, 35, 60}), target({20, 30, 61, 36});
    const UnmarkedExtremities s = source.unmarked(2, 40.0), t = target.unmarked(2, 40.0);
    const auto none = [](Index, Index) { return 0.0; };
    const auto pairs = paired_extremities(s, t, 0.3, none);
    EXPECT_EQ(pairs, (std::vector<IndexPair>{{source.ends[3], target.ends[2]},
                                             {source.ends[2], target.ends[3]}}));
    // One that lies elsewhere doesn't count, nor one that can't be a pair.
    const auto elsewhere = [&](Index i, Index) { return i == source.ends[3] ? 0.3 : 0.0; };
    EXPECT_EQ(paired_extremities(s, t, 0.3, elsewhere),
              (std::vector<IndexPair>{{source.ends[2], target.ends[3]}}));
    const auto barred = [&](Index i, Index) { return i == source.ends[2] ? kNoPair : 0.0; };
    EXPECT_EQ(paired_extremities(s, t, 0.3, barred),
              (std::vector<IndexPair>{{source.ends[3], target.ends[2]}}));
}

TEST(ExtremityPairing, OfTwoThatAreAlikeNeitherIsPaired) {
    const MarkedStar source({20, 30, 36}), target({20, 30, 35, 37});
    EXPECT_TRUE(paired_extremities(source.unmarked(2, 40.0), target.unmarked(2, 40.0), 0.3,
                                   [](Index, Index) { return 0.0; })
                    .empty());
}

TEST(Example, ExtremityPairing) {
    const MarkedStar one({20, 35, 28}), other({20, 35, 24});
    const SurfaceGraph &source = one.graph, &target = other.graph;
    const std::vector<Index> source_features{one.ends[0], one.ends[1]};
    const std::vector<Index> target_features{other.ends[0], other.ends[1]};
    const double unit = 30.0;
    Progress progress;
    // --- example
    const auto s = unmarked_extremities(source, unit, distances_from(source, unit, source_features),
                                        {}, progress);
    const auto t = unmarked_extremities(target, unit, distances_from(target, unit, target_features),
                                        {}, progress);
    const auto pairs = paired_extremities(s, t, 0.35, [](Index, Index) { return 0.0; });
    // --- end of the example
    EXPECT_EQ(pairs, (std::vector<IndexPair>{{one.ends[2], other.ends[2]}}));
}

}  // namespace
}  // namespace pointmorph

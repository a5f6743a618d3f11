#include "registration/rim.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "pointmorph/cloud/cloud.hpp"
#include "registration/node_chain.hpp"

namespace pointmorph {
namespace {

TEST(Rim, IsWhatAShapeSaysOfItsEnds) {
    CoarseShape shape;
    EXPECT_TRUE(end_rows(shape).empty());
    shape.ends = {0, 1, 0, 0, 1, 1};
    EXPECT_EQ(end_rows(shape), (std::vector<Index>{1, 4, 5}));
}

TEST(Rim, WhatNoImageComesNearToBeyondTheOthersEndIsLeftOver) {
    constexpr Index kNodes = 30, kEnd = 22;
    DeformationGraph graph = node_chain(kNodes);
    graph.spacing = 1.0;
    Positions nodes = Positions::Zero(kNodes, 3);
    nodes.col(0).setLinSpaced(kNodes, 0.0, kNodes - 1.0);
    // The other shape reaches to its end, but for a gap elsewhere.
    std::vector<Index> reached;
    for (Index k = 0; k <= kEnd; ++k)
        if (k < 4 || k > 7) reached.push_back(k);
    const Positions images = gather(nodes, reached), rim = nodes.row(kEnd);
    const std::vector<char> left = beyond_rim(graph, nodes, images, rim);
    for (Index k = 0; k < kNodes; ++k) EXPECT_EQ(left[to_size(k)] != 0, k > kEnd + 1) << k;
    // Where it has no end nothing is, and not while all lies apart.
    EXPECT_EQ(std::ranges::count(beyond_rim(graph, nodes, images, Positions(0, 3)), 1), 0);
    Positions aside = images;
    aside.col(1).array() += 9.0;
    EXPECT_EQ(std::ranges::count(beyond_rim(graph, nodes, aside, rim), 1), 0);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/disk/homology.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "shapes.hpp"

namespace pointmorph {
namespace {

/// The grid of a torus, `around` by `across` nodes, each joined to the eight next to it.
struct Grid {
    Index around, across;
    SurfaceGraph graph;

    Index node(Index u, Index v) const {
        return ((u + around) % around) * across + (v + across) % across;
    }

    Grid(Index u_count, Index v_count) : around(u_count), across(v_count) {
        for (Index u = 0; u < around; ++u)
            for (Index v = 0; v < across; ++v) {
                std::vector<Index> next;
                for (const Index du : {-1, 0, 1})
                    for (const Index dv : {-1, 0, 1})
                        if (du != 0 || dv != 0) next.push_back(node(u + du, v + dv));
                std::ranges::sort(next);
                graph.neighbors.insert(graph.neighbors.end(), next.begin(), next.end());
                graph.lengths.insert(graph.lengths.end(), next.size(), 1.0);
                graph.offsets.push_back(static_cast<std::int64_t>(graph.neighbors.size()));
            }
    }

    std::uint32_t bits(const LoopClasses& classes, const std::vector<Index>& loop) const {
        std::uint32_t sum = 0;
        for (std::size_t k = 0; k < loop.size(); ++k) {
            const Index a = loop[k], b = loop[(k + 1) % loop.size()];
            for (auto e = graph.offsets[to_size(a)]; e < graph.offsets[to_size(a) + 1]; ++e)
                if (graph.neighbors[to_size(e)] == b) sum ^= classes.bits[to_size(e)];
        }
        return sum;
    }
};

TEST(Homology, TellsTheLoopsOfATorusApart) {
    const Grid grid(24, 16);
    for (const double radius : {0.0, 1.5}) {
        const LoopClasses classes = loop_classes(grid.graph, radius);
        ASSERT_EQ(classes.rank, 2);
        std::vector<Index> along, across, square, twisted;
        for (Index u = 0; u < 24; ++u) along.push_back(grid.node(u, 3));
        for (Index v = 0; v < 16; ++v) across.push_back(grid.node(5, v));
        for (Index k = 0; k < 6; ++k) square.push_back(grid.node(k, 0));
        for (Index k = 0; k < 6; ++k) square.push_back(grid.node(6, k));
        for (Index k = 0; k < 6; ++k) square.push_back(grid.node(6 - k, 6));
        for (Index k = 0; k < 6; ++k) square.push_back(grid.node(0, 6 - k));
        for (Index u = 0; u < 24; ++u) twisted.push_back(grid.node(u, std::min<Index>(u, 16)));
        EXPECT_EQ(grid.bits(classes, square), 0u);
        EXPECT_NE(grid.bits(classes, along), 0u);
        EXPECT_NE(grid.bits(classes, across), 0u);
        EXPECT_NE(grid.bits(classes, along), grid.bits(classes, across));
        EXPECT_EQ(grid.bits(classes, twisted),
                  grid.bits(classes, along) ^ grid.bits(classes, across));
        // Wherever it runs.
        for (Index& node : along) node = grid.node(node / 16, 11);
        EXPECT_EQ(grid.bits(classes, along) ^ grid.bits(classes, across),
                  grid.bits(classes, twisted));
    }
}

TEST(Homology, FillsGapsWithARadius) {
    // Edges of two blocks are gone, all but a thread to each of their nodes: two loops that bound
    // gaps, one more than a surface with a single border would have.
    const Grid grid(30, 30);
    SurfaceGraph torn;
    const auto gone = [](Index node) {
        const Index u = node / 30, v = node % 30;
        return (std::abs(u - 10) <= 1 && std::abs(v - 10) <= 1) ||
               (std::abs(u - 20) <= 1 && std::abs(v - 20) <= 1);
    };
    for (Index i = 0; i < 900; ++i) {
        for (auto e = grid.graph.offsets[to_size(i)]; e < grid.graph.offsets[to_size(i) + 1]; ++e) {
            const Index j = grid.graph.neighbors[to_size(e)];
            const bool thread = i - j == 30 || j - i == 30;
            if ((gone(i) || gone(j)) && !(thread && gone(std::max(i, j)))) continue;
            torn.neighbors.push_back(j);
            torn.lengths.push_back(1.0);
        }
        torn.offsets.push_back(static_cast<std::int64_t>(torn.neighbors.size()));
    }
    EXPECT_EQ(loop_classes(torn).rank, 3);
    EXPECT_EQ(loop_classes(torn, 2.5).rank, 2);
}

TEST(Homology, OfNothingAndOfATree) {
    EXPECT_EQ(loop_classes(SurfaceGraph{}).rank, 0);
    SurfaceGraph path;
    for (Index i = 0; i < 5; ++i) {
        for (const Index j : {i - 1, i + 1})
            if (j >= 0 && j < 5) path.neighbors.push_back(j);
        path.offsets.push_back(static_cast<std::int64_t>(path.neighbors.size()));
    }
    path.lengths.assign(path.neighbors.size(), 1.0);
    EXPECT_EQ(loop_classes(path).rank, 0);
    EXPECT_EQ(loop_classes(path, 1.5).rank, 0);
}

TEST(Example, Homology) {
    const Grid torus(24, 16);
    const SurfaceGraph& graph = torus.graph;
    const double spacing = 1.0;
    // --- example
    const LoopClasses classes = loop_classes(graph, 1.2 * spacing);
    const Index genus = classes.rank / 2;
    const std::uint32_t bits = classes.bits[0];
    // --- end of the example
    EXPECT_EQ(genus, 1);
    EXPECT_LT(bits, 4u);
}

}  // namespace
}  // namespace pointmorph

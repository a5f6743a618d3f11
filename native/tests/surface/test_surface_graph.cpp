#include "pointmorph/surface/surface_graph.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "joined_shapes.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

SurfaceGraph graph_of(const Positions& p, const Normals& n) {
    Progress progress;
    return surface_graph(KdTree<3>(p), n, {}, progress);
}

TEST(SurfaceGraph, IsSymmetricWithPlainLengths) {
    const Positions p = shapes::sphere(300);
    const SurfaceGraph graph = graph_of(p, p);
    for (Index i = 0; i < graph.size(); ++i)
        for (auto e = graph.offsets[to_size(i)]; e < graph.offsets[to_size(i) + 1]; ++e) {
            const Index j = graph.neighbors[to_size(e)];
            EXPECT_DOUBLE_EQ(graph.lengths[to_size(e)], (p.row(i) - p.row(j)).norm());
            const auto first = graph.neighbors.begin() + graph.offsets[to_size(j)];
            const auto last = graph.neighbors.begin() + graph.offsets[to_size(j) + 1];
            EXPECT_TRUE(std::binary_search(first, last, i));
        }
}

TEST(SurfaceGraph, GeodesicsOfASphereAreGreatCircles) {
    const Positions p = shapes::sphere(4000);
    const SurfaceGraph graph = graph_of(p, p);
    GeodesicSearch search(graph);
    const auto found = search.from(0);
    ASSERT_EQ(found.size(), to_size(Index(p.rows())));
    EXPECT_TRUE(std::ranges::is_sorted(found, {}, &std::pair<Index, double>::second));
    for (const auto& [i, distance] : found) {
        const double arc = std::acos(std::clamp(p.row(0).dot(p.row(i)), -1.0, 1.0));
        EXPECT_GE(distance, arc * 0.99 - 1e-9);
        EXPECT_LE(distance, arc * 1.08 + 0.06);  // a zig-zag, and the spacing
    }
}

TEST(SurfaceGraph, AgreesWithFloydAndHonoursTheLimit) {
    const Positions p = shapes::cube_noise(60);
    const Normals n = Normals::Constant(60, 3, 1.0 / std::sqrt(3.0));
    const SurfaceGraph graph = graph_of(p, n);
    Eigen::MatrixXd d = Eigen::MatrixXd::Constant(60, 60, 1e9);
    for (Index i = 0; i < 60; ++i) {
        d(i, i) = 0.0;
        for (auto e = to_size(Index(graph.offsets[to_size(i)]));
             e < to_size(Index(graph.offsets[to_size(i) + 1])); ++e)
            d(i, graph.neighbors[e]) = graph.lengths[e];
    }
    for (Index k = 0; k < 60; ++k)
        for (Index i = 0; i < 60; ++i)
            for (Index j = 0; j < 60; ++j) d(i, j) = std::min(d(i, j), d(i, k) + d(k, j));
    GeodesicSearch search(graph);
    for (const double limit : {0.8, 10.0})
        for (Index i = 0; i < 60; ++i) {
            const auto found = search.from(i, limit);
            EXPECT_EQ(to_index(found.size()), (d.row(i).array() < limit).count());
            for (const auto& [j, distance] : found) EXPECT_NEAR(distance, d(i, j), 1e-12);
        }
}

/// The shortest ways by going over all edges until nothing changes: the same
/// sums, to the bit.
Values all_ways(const SurfaceGraph& graph, std::span<const Index> sources) {
    Values distance = Values::Constant(graph.size(), std::numeric_limits<double>::infinity());
    for (const Index source : sources) distance[source] = 0.0;
    for (bool changed = true; changed;) {
        changed = false;
        for (Index i = 0; i < graph.size(); ++i)
            for (auto e = to_size(graph.offsets[to_size(i)]);
                 e < to_size(graph.offsets[to_size(i) + 1]); ++e) {
                double& there = distance[graph.neighbors[e]];
                const double through = distance[i] + graph.lengths[e];
                changed |= through < there;
                there = std::min(there, through);
            }
    }
    return distance;
}

TEST(SurfaceGraph, WaysAreTheShortestToTheBitFromOneOrSeveralInOrderOrNot) {
    // The second part is so far off that its own edges are short beside the one
    // that joins it.
    Positions p(900, 3);
    p << shapes::sphere(500), 0.001 * shapes::sphere(400);
    Normals n = p.rowwise().normalized();
    p.bottomRows(400).col(0).array() += 300.0;
    const SurfaceGraph graph = graph_of(p, n);
    GeodesicSearch search(graph);
    const auto by_row = [](std::span<const std::pair<Index, double>> found) {
        std::vector<std::pair<Index, double>> sorted(found.begin(), found.end());
        std::ranges::sort(sorted);
        return sorted;
    };
    const double all = std::numeric_limits<double>::infinity();
    for (const double limit : {0.002, 0.4, 2.0, all})
        for (const std::vector<Index>& sources :
             {std::vector<Index>{0}, {700}, {3, 499, 3}, {20, 880}}) {
            const Values ways = all_ways(graph, sources);
            std::vector<std::pair<Index, double>> expected;
            for (Index i = 0; i < graph.size(); ++i)
                if (ways[i] < limit) expected.emplace_back(i, ways[i]);
            EXPECT_EQ(by_row(search.reached(sources, limit)), expected);
            if (sources.size() > 1) continue;
            EXPECT_EQ(by_row(search.reached(sources.front(), limit)), expected);
            const auto in_order = search.from(sources.front(), limit);
            EXPECT_EQ(by_row(in_order), expected);
            EXPECT_TRUE(std::ranges::is_sorted(in_order, {}, [](const auto& found) {
                return std::pair(found.second, found.first);
            }));
        }
}

TEST(SurfaceGraph, SheetsOfOpposedNormalsMeetOnlyOnce) {
    const shapes::TwoSheets sheets(20);
    const Positions &top = sheets.top, &p = sheets.positions;
    const Normals& n = sheets.normals;
    const SurfaceGraph graph = graph_of(p, n);
    Index across = 0;
    for (Index i = 0; i < top.rows(); ++i)
        for (auto e = graph.offsets[to_size(i)]; e < graph.offsets[to_size(i) + 1]; ++e)
            across += graph.neighbors[to_size(e)] >= top.rows();
    EXPECT_EQ(across, 1);
}

TEST(SurfaceGraph, ComponentsAreJoined) {
    Positions p(900, 3);
    p << shapes::sphere(500), shapes::sphere(300), shapes::sphere(100);
    Normals n = p;
    p.middleRows(500, 300).col(0).array() += 5.0;
    p.bottomRows(100).col(1).array() += 9.0;
    const SurfaceGraph graph = graph_of(p, n);
    GeodesicSearch search(graph);
    EXPECT_EQ(search.from(600).size(), 900u);
}

TEST(SurfaceGraph, CoincidentPointsHavePositiveLengths) {
    const Positions p = Positions::Zero(40, 3);
    const SurfaceGraph graph = graph_of(p, Normals::Constant(40, 3, 1.0 / std::sqrt(3.0)));
    EXPECT_GT(*std::ranges::min_element(graph.lengths), 0.0);
    GeodesicSearch search(graph);
    EXPECT_EQ(search.from(0).size(), 40u);
}

/// Two limbs side by side along z, `gap` apart: tubes of radius ½, dense, and every 32nd point.
struct TwoLimbs {
    Positions dense, coarse;
    Normals normals;  ///< of the coarse points

    explicit TwoLimbs(double gap) {
        constexpr Index kPoints = 8000;
        dense.resize(kPoints, 3);
        coarse.resize(kPoints / 32, 3);
        normals.resize(kPoints / 32, 3);
        for (Index i = 0; i < kPoints; ++i) {
            // A lattice on each tube; even rows on the one, odd ones on the other.
            const double side = i % 2 == 0 ? -1.0 : 1.0;
            const double turn = 2.0 * std::numbers::pi * std::fmod((i / 2) * 0.6180339887, 1.0);
            const Eigen::RowVector3d normal(std::cos(turn), std::sin(turn), 0.0);
            dense.row(i) =
                0.5 * normal + Eigen::RowVector3d(side * 0.5 * (1.0 + gap), 0.0,
                                                  10.0 * static_cast<double>(i) / kPoints);
            if (i % 64 > 1) continue;
            const Index row = i / 64 * 2 + i % 2;
            coarse.row(row) = dense.row(i);
            normals.row(row) = normal;
        }
    }

    static Index edges_across(const SurfaceGraph& graph) {
        Index count = 0;
        for (Index i = 0; i < graph.size(); i += 2)
            for (auto e = graph.offsets[to_size(i)]; e < graph.offsets[to_size(i) + 1]; ++e)
                count += graph.neighbors[to_size(e)] % 2;
        return count;
    }
};

TEST(SurfaceGraph, LeavesOutEdgesFromLimbToLimb) {
    const TwoLimbs limbs(0.5);
    Progress progress;
    const KdTree<3> coarse(limbs.coarse), dense(limbs.dense);
    const SurfaceGraph all = surface_graph(coarse, limbs.normals, {}, progress);
    const SurfaceGraph graph = surface_graph(coarse, limbs.normals, {}, progress, &dense);
    EXPECT_LT(TwoLimbs::edges_across(graph), 0.5 * TwoLimbs::edges_across(all));
    EXPECT_GT(TwoLimbs::edges_across(all), 0);
    // What is left out tears nothing off: all are reached.
    EXPECT_EQ(GeodesicSearch(graph).from(0).size(), to_size(Index(limbs.coarse.rows())));
}

TEST(SurfaceGraph, KeepsTheEdgesOfSparseParts) {
    // A tube whose samples are eight times as far apart at one end as at the other.
    Positions p(4000, 3);
    Normals n(4000, 3);
    for (Index i = 0; i < 4000; ++i) {
        const double u = (i + 0.5) / 4000.0;
        const double turn = 2.0 * std::numbers::pi * std::fmod(i * 0.6180339887, 1.0);
        n.row(i) << std::cos(turn), std::sin(turn), 0.0;
        p.row(i) = n.row(i) + Eigen::RowVector3d(0.0, 0.0, 10.0 * std::pow(u, 8));
    }
    Progress progress;
    const KdTree<3> tree(p);
    const SurfaceGraph all = surface_graph(tree, n, {}, progress);
    const SurfaceGraph kept = surface_graph(tree, n, {}, progress, &tree);
    EXPECT_GE(static_cast<double>(kept.neighbors.size()),
              0.95 * static_cast<double>(all.neighbors.size()));
}

/// Nodes are every third row and column of two coplanar grids, a gap apart.
TEST(SurfaceGraph, FromTheCloudsOwnNeighborhoodsSeesAGapThatNodesDoNot) {
    constexpr Index kSide = 31;
    const double step = 2.0 / (kSide - 1);
    Positions p(2 * kSide * kSide, 3);
    p.topRows(kSide * kSide) = shapes::grid(kSide);
    p.bottomRows(kSide * kSide) = shapes::grid(kSide);
    p.bottomRows(kSide * kSide).col(0).array() += 2.0 + 3.2 * step;  // nodes are 3 steps apart
    const Normals n = Eigen::RowVector3d(0, 0, 1).replicate(p.rows(), 1);
    std::vector<Index> nodes;
    for (Index i = 0; i < p.rows(); ++i)
        if (i % (kSide * kSide) / kSide % 3 == 0 && i % kSide % 3 == 0) nodes.push_back(i);
    Positions places(static_cast<Eigen::Index>(nodes.size()), 3);
    for (std::size_t k = 0; k < nodes.size(); ++k)
        places.row(static_cast<Eigen::Index>(k)) = p.row(nodes[k]);
    const KdTree<3> tree(p), node_tree(places);
    std::vector<Index> cells(to_size(Index(p.rows())));
    std::vector<double> squared(1);
    for (Index i = 0; i < p.rows(); ++i)
        node_tree.nearest(p.row(i).data(), {&cells[to_size(i)], 1}, squared);
    Progress progress;
    const SurfaceGraph graph =
        surface_graph(p, n, nearest_neighbors(tree, 16, progress), nodes, cells);
    Index bridges = 0;
    for (Index a = 0; a < graph.size(); ++a) {
        Index inside = 0;
        for (auto e = graph.offsets[to_size(a)]; e < graph.offsets[to_size(a) + 1]; ++e) {
            const Index b = graph.neighbors[to_size(e)];
            const bool same =
                (nodes[to_size(a)] < kSide * kSide) == (nodes[to_size(b)] < kSide * kSide);
            bridges += !same;
            inside += same;
            EXPECT_DOUBLE_EQ(graph.lengths[to_size(e)], (places.row(a) - places.row(b)).norm());
        }
        EXPECT_GE(inside, 5);
    }
    EXPECT_EQ(bridges, 2);  // one edge, seen from both ends
    GeodesicSearch search(graph);
    for (const auto& [b, distance] : search.from(0)) {
        const double straight = (places.row(0) - places.row(b)).norm();
        EXPECT_GE(distance, straight * (1.0 - 1e-12));
        if (nodes[to_size(b)] < kSide * kSide) {
            EXPECT_LE(distance, 1.09 * straight);
        }
    }
}

TEST(Example, SurfaceGraph) {
    const Positions positions = shapes::sphere(1000);
    const Normals& normals = positions;
    const KdTree<3> tree(positions);
    const Index nose = 0;
    Progress progress;
    // --- example
    const SurfaceGraph graph = surface_graph(tree, normals, {}, progress);
    GeodesicSearch search(graph);
    double farthest = 0.0;
    for (const auto& [row, distance] : search.from(nose, 0.5))
        farthest = std::max(farthest, distance);
    // --- end of the example
    EXPECT_GT(farthest, 0.4);
    EXPECT_LE(farthest, 0.5);
}

}  // namespace
}  // namespace pointmorph

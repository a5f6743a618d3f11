#include "pointmorph/surface/free_loops.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
#include <set>

namespace pointmorph {
namespace {

using Simplices = std::vector<std::vector<Index>>;

Complex complex_of(Index vertices, const Simplices& simplices) {
    Complex complex(vertices);
    for (const auto& simplex : simplices) complex.add(simplex);
    return complex;
}

/// A ring of vertices, each joined with the next.
Simplices ring(Index count) {
    Simplices edges;
    for (Index i = 0; i < count; ++i)
        edges.push_back({std::min(i, (i + 1) % count), std::max(i, (i + 1) % count)});
    return edges;
}

/// Both triangles of each square of a torus of `across` by `along` vertices.
Simplices torus(Index across, Index along) {
    const auto vertex = [&](Index i, Index j) { return i % across * along + j % along; };
    Simplices triangles;
    for (Index i = 0; i < across; ++i)
        for (Index j = 0; j < along; ++j)
            for (const Index side : {0, 1}) {
                std::vector<Index> triangle{vertex(i, j), vertex(i + 1, j + 1),
                                            side == 0 ? vertex(i + 1, j) : vertex(i, j + 1)};
                std::ranges::sort(triangle);
                triangles.push_back(triangle);
            }
    return triangles;
}

/// By Gaussian elimination over two elements.
Index rank_of(std::vector<std::vector<char>> rows) {
    Index rank = 0;
    const std::size_t columns = rows.empty() ? 0 : rows.front().size();
    for (std::size_t column = 0; column < columns; ++column) {
        const auto top = rows.begin() + rank;
        const auto pivot = std::find_if(top, rows.end(), [&](auto& row) { return row[column]; });
        if (pivot == rows.end()) continue;
        std::iter_swap(top, pivot);
        for (auto row = rows.begin(); row != rows.end(); ++row)
            if (row != top && (*row)[column])
                for (std::size_t k = 0; k < columns; ++k)
                    (*row)[k] = static_cast<char>((*row)[k] != (*top)[k]);
        ++rank;
    }
    return rank;
}

/// All free loops and the wide ones, by the definitions: dimensions of cycles and borders.
std::array<Index, 2> brute_force(Index vertices, const Simplices& simplices) {
    std::set<std::array<Index, 2>> edge_set;
    std::set<std::array<Index, 3>> triangles;
    for (const auto& s : simplices)
        for (std::size_t a = 0; a < s.size(); ++a)
            for (std::size_t b = a + 1; b < s.size(); ++b) {
                edge_set.insert({s[a], s[b]});
                for (std::size_t c = b + 1; c < s.size(); ++c) triangles.insert({s[a], s[b], s[c]});
            }
    const std::vector<std::array<Index, 2>> edges(edge_set.begin(), edge_set.end());
    const auto is_edge = [&](Index a, Index b) {
        return edge_set.contains({std::min(a, b), std::max(a, b)});
    };
    const auto loop = [&](const std::vector<Index>& around) {
        std::vector<char> row(edges.size(), 0);
        for (std::size_t k = 0; k < around.size(); ++k) {
            const Index a = around[k], b = around[(k + 1) % around.size()];
            const auto place =
                std::ranges::lower_bound(edges, std::array{std::min(a, b), std::max(a, b)}) -
                edges.begin();
            row[to_size(place)] = 1;
        }
        return row;
    };
    std::vector<std::vector<char>> ends, borders;
    for (const auto& [a, b] : edges) {
        std::vector<char> row(to_size(vertices), 0);
        row[to_size(a)] = row[to_size(b)] = 1;
        ends.push_back(row);
    }
    for (const auto& [a, b, c] : triangles) borders.push_back(loop({a, b, c}));
    const auto cycles = to_index(edges.size()) - rank_of(ends);
    const Index all = cycles - rank_of(borders);
    for (Index a = 0; a < vertices; ++a)
        for (Index b = 0; b < vertices; ++b)
            for (Index c = 0; c < vertices; ++c) {
                if (a == c || !is_edge(a, b) || !is_edge(b, c)) continue;
                if (is_edge(c, a)) borders.push_back(loop({a, b, c}));
                for (Index d = 0; d < vertices; ++d)
                    if (d != b && is_edge(c, d) && is_edge(d, a))
                        borders.push_back(loop({a, b, c, d}));
            }
    return {all, cycles - rank_of(borders)};
}

TEST(FreeLoops, CountsThoseOfKnownSurfaces) {
    const FreeLoops wide = FreeLoops(complex_of(6 * 7, torus(6, 7)));
    EXPECT_EQ(wide.all, 2);
    EXPECT_EQ(wide.wide, 2);
    const FreeLoops thin = FreeLoops(complex_of(4 * 9, torus(4, 9)));
    EXPECT_EQ(thin.all, 2);
    EXPECT_EQ(thin.wide, 1);  // the one around it has four edges
    Simplices open = torus(6, 7);
    open.pop_back();
    EXPECT_EQ(FreeLoops(complex_of(6 * 7, open)).all, 2);  // the border is what the others span
    open.erase(open.begin() + 20);
    EXPECT_EQ(FreeLoops(complex_of(6 * 7, open)).all, 3);
    EXPECT_EQ(FreeLoops(complex_of(6 * 7, open)).wide, 2);
    // Tetrahedra: nothing is free in one, nor in its surface.
    EXPECT_EQ(FreeLoops(complex_of(5, {{0, 1, 2, 3}, {1, 2, 3, 4}})).all, 0);
}

TEST(FreeLoops, OfARingIsOneAndWideFromFiveEdgesOn) {
    for (const Index count : {3, 4, 5, 12}) {
        const FreeLoops loops{complex_of(count, ring(count))};
        EXPECT_EQ(loops.all, 1) << count;
        EXPECT_EQ(loops.wide, count > 4 ? 1 : 0) << count;
    }
    Simplices filled = ring(12);
    Complex complex = complex_of(12, filled);
    const Index lid = complex.add_vertex();
    for (auto edge : filled) {
        edge.push_back(lid);
        complex.add(edge);
    }
    EXPECT_EQ(FreeLoops(complex).all, 0);
}

TEST(FreeLoops, AreThoseOfBruteForce) {
    std::mt19937 random(5);
    Index some = 0;
    for (int round = 0; round < 60; ++round) {
        const Index vertices = 6 + to_index(random() % 14);
        Simplices simplices;
        for (Index k = 0; k < 2 * vertices; ++k) {
            std::set<Index> simplex;
            const std::size_t size = 2 + random() % (round % 3 + 1);
            while (simplex.size() < size)
                simplex.insert(to_index(random() % static_cast<unsigned>(vertices)));
            simplices.emplace_back(simplex.begin(), simplex.end());
        }
        const FreeLoops found{complex_of(vertices, simplices)};
        const auto [all, wide] = brute_force(vertices, simplices);
        EXPECT_EQ(found.all, all) << round;
        EXPECT_EQ(found.wide, wide) << round;
        some += wide;
    }
    EXPECT_GT(some, 10);
}

TEST(FreeLoops, OfNothingAndOfSinglesAreNone) {
    EXPECT_EQ(FreeLoops(Complex(0)).all, 0);
    EXPECT_EQ(FreeLoops(Complex(3)).all, 0);
    const Complex complex = complex_of(4, {{1}, {0, 2}});
    EXPECT_EQ(FreeLoops(complex).all, 0);
    EXPECT_EQ(complex.neighbors()[2].size(), 1u);
    EXPECT_EQ(complex.neighbors()[3].size(), 0u);
}

TEST(Example, FreeLoops) {
    const Neighborhoods graph = complex_of(35, torus(5, 7)).neighbors();
    // --- example
    Complex complex(graph);
    complex.add(std::array{0, 1, 8});
    const FreeLoops loops(complex);
    const Index genus = loops.all / 2;
    // --- end of the example
    EXPECT_EQ(genus, 1);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/disk/homology.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "pointmorph/surface/free_loops.hpp"

namespace pointmorph {

namespace {

/// Of the graph itself.
LoopClasses classes_of(const SurfaceGraph& graph) {
    const EdgeLoops loops(Complex({graph.offsets, graph.neighbors}));
    LoopClasses result{std::vector<std::uint32_t>(loops.sums.size(), 0), loops.count};
    constexpr Index kBits = 32;
    for (std::size_t e = 0; e < loops.sums.size(); ++e)
        for (const Index loop : loops.sums[e])
            if (loop < kBits) result.bits[e] |= std::uint32_t{1} << loop;
    return result;
}

/// Nodes, ascending, no two of which lie closer than `radius`, and the nearest one of each node.
struct Cells {
    std::vector<Index> centers, of;

    Cells(const SurfaceGraph& graph, double radius) : of(to_size(graph.size()), -1) {
        GeodesicSearch search(graph);
        std::vector<double> distance(of.size(), std::numeric_limits<double>::infinity());
        for (Index i = 0; i < graph.size(); ++i) {
            if (of[to_size(i)] >= 0) continue;
            const auto mine = to_index(centers.size());
            centers.push_back(i);
            for (const auto& [j, there] : search.reached(i, radius))
                if (there < distance[to_size(j)]) {
                    distance[to_size(j)] = there;
                    of[to_size(j)] = mine;
                }
        }
    }
};

}  // namespace

LoopClasses loop_classes(const SurfaceGraph& graph, double radius) {
    if (!(radius > 0.0)) return classes_of(graph);
    const Cells cells(graph, radius);
    SurfaceGraph merged;
    {
        std::vector<std::vector<Index>> around(cells.centers.size());
        for (Index i = 0; i < graph.size(); ++i)
            for (const Index j : graph[i])
                if (const Index there = cells.of[to_size(j)]; there != cells.of[to_size(i)])
                    around[to_size(cells.of[to_size(i)])].push_back(there);
        const auto once = [](std::vector<Index>& rows) {
            std::ranges::sort(rows);
            rows.erase(std::ranges::unique(rows).begin(), rows.end());
        };
        std::ranges::for_each(around, once);
        const std::vector<std::vector<Index>> next = around;
        for (std::size_t a = 0; a < around.size(); ++a) {
            for (const Index b : next[a])
                for (const Index c : next[to_size(b)])
                    if (to_size(c) != a) around[a].push_back(c);
            once(around[a]);
        }
        for (const auto& joined : around) {
            merged.neighbors.insert(merged.neighbors.end(), joined.begin(), joined.end());
            merged.offsets.push_back(static_cast<std::int64_t>(merged.neighbors.size()));
        }
    }
    const LoopClasses classes = classes_of(merged);
    LoopClasses result{std::vector<std::uint32_t>(graph.neighbors.size(), 0), classes.rank};
    for (Index i = 0; i < graph.size(); ++i)
        for (auto e = to_size(graph.offsets[to_size(i)]);
             e < to_size(graph.offsets[to_size(i) + 1]); ++e) {
            const Index here = cells.of[to_size(i)], there = cells.of[to_size(graph.neighbors[e])];
            if (here == there) continue;
            const auto begin = merged.neighbors.begin() + merged.offsets[to_size(here)];
            const auto end = merged.neighbors.begin() + merged.offsets[to_size(here) + 1];
            result.bits[e] =
                classes
                    .bits[to_size(std::lower_bound(begin, end, there) - merged.neighbors.begin())];
        }
    return result;
}

}  // namespace pointmorph

#include "pointmorph/homology.hpp"

#include <algorithm>
#include <bitset>
#include <cstddef>
#include <limits>

namespace pointmorph {

namespace {

constexpr std::size_t kGenerators = 1024;
using Sum = std::bitset<kGenerators>;

std::size_t at(Index i) {
    return static_cast<std::size_t>(i);
}

/// Sums of generators that are known to be 0, each under its highest one.
class Relations {
public:
    void add(Sum sum) {
        for (std::size_t g = kGenerators; g-- > 0 && sum.any();) {
            if (!sum[g]) continue;
            if (!known_[g]) {
                known_[g] = true;
                sums_[g] = sum;
                return;
            }
            sum ^= sums_[g];
        }
    }

    /// A bit for each of the first `count` generators that nothing is known about; sums of those
    /// for the others. Returns how many bits there are.
    Index resolve(std::size_t count, std::vector<std::uint32_t>& bits) const {
        bits.assign(count, 0);
        Index rank = 0;
        for (std::size_t g = 0; g < count; ++g) {
            if (!known_[g]) {
                if (rank < 32) bits[g] = std::uint32_t{1} << rank;
                ++rank;
                continue;
            }
            for (std::size_t lower = 0; lower < g; ++lower)
                if (sums_[g][lower]) bits[g] ^= bits[lower];
        }
        return rank;
    }

private:
    std::bitset<kGenerators> known_;
    std::vector<Sum> sums_ = std::vector<Sum>(kGenerators);
};

/// Of the graph itself.
LoopClasses classes_of(const SurfaceGraph& graph) {
    const auto count = graph.neighbors.size();
    // Both directions of an edge share one sum, that of the one that is met first.
    std::vector<std::size_t> edge(count);
    const auto place = [&](Index from, Index to) {
        const auto begin = graph.neighbors.begin() + graph.offsets[at(from)];
        const auto end = graph.neighbors.begin() + graph.offsets[at(from) + 1];
        return static_cast<std::size_t>(std::lower_bound(begin, end, to) - graph.neighbors.begin());
    };
    struct Ends {
        Index a, b;
    };
    std::vector<Ends> ends;
    for (Index i = 0; i < graph.size(); ++i)
        for (auto e = static_cast<std::size_t>(graph.offsets[at(i)]);
             e < static_cast<std::size_t>(graph.offsets[at(i) + 1]); ++e) {
            const Index j = graph.neighbors[e];
            edge[e] = i < j ? ends.size() : edge[place(j, i)];
            if (i < j) ends.push_back({i, j});
        }

    std::vector<Sum> sums(ends.size());
    std::vector<char> known(ends.size(), 0);
    std::vector<std::size_t> queue;
    Relations relations;
    const auto learn = [&](std::size_t e, const Sum& sum) {
        sums[e] = sum;
        known[e] = 1;
        queue.push_back(e);
    };
    // A tree has no loops.
    std::vector<Index> front{0};
    std::vector<char> reached(at(graph.size()), 0);
    if (graph.size() > 0) reached[0] = 1;
    for (std::size_t k = 0; k < front.size() && graph.size() > 0; ++k)
        for (auto e = static_cast<std::size_t>(graph.offsets[at(front[k])]);
             e < static_cast<std::size_t>(graph.offsets[at(front[k]) + 1]); ++e) {
            const Index j = graph.neighbors[e];
            if (reached[at(j)]) continue;
            reached[at(j)] = 1;
            front.push_back(j);
            learn(edge[e], Sum());
        }
    std::size_t generators = 0, done = 0, next = 0;
    for (;;) {
        for (; done < queue.size(); ++done) {
            const std::size_t e = queue[done];
            const auto [a, b] = ends[e];
            auto p = static_cast<std::size_t>(graph.offsets[at(a)]);
            auto q = static_cast<std::size_t>(graph.offsets[at(b)]);
            const auto p_end = static_cast<std::size_t>(graph.offsets[at(a) + 1]);
            const auto q_end = static_cast<std::size_t>(graph.offsets[at(b) + 1]);
            while (p < p_end && q < q_end) {
                if (graph.neighbors[p] != graph.neighbors[q]) {
                    ++(graph.neighbors[p] < graph.neighbors[q] ? p : q);
                    continue;
                }
                const std::size_t f = edge[p++], g = edge[q++];
                if (known[f] && known[g])
                    relations.add(sums[e] ^ sums[f] ^ sums[g]);
                else if (known[f])
                    learn(g, sums[e] ^ sums[f]);
                else if (known[g])
                    learn(f, sums[e] ^ sums[g]);
            }
        }
        while (next < known.size() && known[next]) ++next;
        if (next == known.size() || generators == kGenerators) break;
        learn(next, Sum().set(generators++));
    }
    LoopClasses result;
    std::vector<std::uint32_t> bits;
    result.rank = relations.resolve(generators, bits);
    result.bits.resize(count);
    for (std::size_t e = 0; e < count; ++e)
        for (std::size_t g = 0; g < generators; ++g)
            if (sums[edge[e]][g]) result.bits[e] ^= bits[g];
    return result;
}

/// Nodes, ascending, no two of which lie closer than `radius`, and the nearest one of each node.
struct Cells {
    std::vector<Index> centers, of;

    Cells(const SurfaceGraph& graph, double radius) : of(at(graph.size()), -1) {
        GeodesicSearch search(graph);
        std::vector<double> distance(of.size(), std::numeric_limits<double>::infinity());
        for (Index i = 0; i < graph.size(); ++i) {
            if (of[at(i)] >= 0) continue;
            const auto mine = static_cast<Index>(centers.size());
            centers.push_back(i);
            for (const auto& [j, there] : search.from(i, radius))
                if (there < distance[at(j)]) {
                    distance[at(j)] = there;
                    of[at(j)] = mine;
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
            for (auto e = static_cast<std::size_t>(graph.offsets[at(i)]);
                 e < static_cast<std::size_t>(graph.offsets[at(i) + 1]); ++e)
                if (const Index there = cells.of[at(graph.neighbors[e])]; there != cells.of[at(i)])
                    around[at(cells.of[at(i)])].push_back(there);
        const auto once = [](std::vector<Index>& rows) {
            std::ranges::sort(rows);
            rows.erase(std::ranges::unique(rows).begin(), rows.end());
        };
        std::ranges::for_each(around, once);
        const std::vector<std::vector<Index>> next = around;
        for (std::size_t a = 0; a < around.size(); ++a) {
            for (const Index b : next[a])
                for (const Index c : next[at(b)])
                    if (at(c) != a) around[a].push_back(c);
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
        for (auto e = static_cast<std::size_t>(graph.offsets[at(i)]);
             e < static_cast<std::size_t>(graph.offsets[at(i) + 1]); ++e) {
            const Index here = cells.of[at(i)], there = cells.of[at(graph.neighbors[e])];
            if (here == there) continue;
            const auto begin = merged.neighbors.begin() + merged.offsets[at(here)];
            const auto end = merged.neighbors.begin() + merged.offsets[at(here) + 1];
            result.bits[e] = classes.bits[static_cast<std::size_t>(
                std::lower_bound(begin, end, there) - merged.neighbors.begin())];
        }
    return result;
}

}  // namespace pointmorph

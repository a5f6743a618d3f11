#include "mesh/mesh_edges.hpp"

#include <algorithm>
#include <utility>

namespace pointmorph {

MeshEdges::MeshEdges(const Triangles& triangles) : edges_(to_size(triangles.size())) {
    if (triangles.rows() == 0) return;
    const auto ends_of = [&](Index side) {
        const Side at{side / 3, side % 3};
        return std::minmax({start_of(triangles, at), end_of(triangles, at)});
    };
    // By the lower end, then each few by the other one.
    const auto count = to_index(triangles.size());
    std::vector<Index> firsts(to_size(triangles.maxCoeff()) + 2, 0);
    for (Index side = 0; side < count; ++side) ++firsts[to_size(ends_of(side).first) + 1];
    for (std::size_t p = 1; p < firsts.size(); ++p) firsts[p] += firsts[p - 1];
    std::vector<std::pair<Index, Index>> entries(to_size(count));  // higher end, side
    std::vector<Index> next(firsts.begin(), firsts.end() - 1);
    for (Index side = 0; side < count; ++side) {
        const auto [low, high] = ends_of(side);
        entries[to_size(next[to_size(low)]++)] = {high, side};
    }
    sides_.reserve(entries.size());
    for (std::size_t p = 0; p + 1 < firsts.size(); ++p) {
        std::sort(entries.begin() + firsts[p], entries.begin() + firsts[p + 1]);
        for (Index e = firsts[p]; e < firsts[p + 1]; ++e) {
            const auto& [high, side] = entries[to_size(e)];
            const bool is_new = e == firsts[p] || high != entries[to_size(e) - 1].first;
            if (is_new && e > 0) offsets_.push_back(e);
            edges_[to_size(side)] = size();
            sides_.push_back({side / 3, side % 3});
        }
    }
    offsets_.push_back(count);
}

}  // namespace pointmorph

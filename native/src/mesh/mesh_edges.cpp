#include "mesh/mesh_edges.hpp"

#include <algorithm>
#include <compare>
#include <span>

#include "base/grouped.hpp"

namespace pointmorph {

MeshEdges::MeshEdges(const Triangles& triangles) : edges_(to_size(triangles.size())) {
    if (triangles.rows() == 0) return;
    const auto ends_of = [&](Index side) {
        const Side at{side / 3, side % 3};
        return std::minmax({start_of(triangles, at), end_of(triangles, at)});
    };
    // By the lower end, then each few by the other one.
    const auto count = to_index(triangles.size());
    struct Entry {
        Index high, side;
        auto operator<=>(const Entry&) const = default;
    };
    Grouped<Entry> by_low(triangles.maxCoeff() + 1, [&](auto&& take) {
        for (Index side = 0; side < count; ++side) {
            const auto [low, high] = ends_of(side);
            take(low, Entry{high, side});
        }
    });
    sides_.reserve(to_size(count));
    for (Index p = 0; p < by_low.size(); ++p) {
        const std::span<Entry> entries = by_low[p];
        std::ranges::sort(entries);
        for (std::size_t k = 0; k < entries.size(); ++k) {
            const auto [high, side] = entries[k];
            const bool is_new = k == 0 || high != entries[k - 1].high;
            if (is_new && !sides_.empty()) offsets_.push_back(to_index(sides_.size()));
            edges_[to_size(side)] = size();
            sides_.push_back({side / 3, side % 3});
        }
    }
    offsets_.push_back(count);
}

}  // namespace pointmorph

#include "mesh/mesh_edges.hpp"

#include <algorithm>
#include <utility>

namespace pointmorph {

MeshEdges::MeshEdges(const Triangles& triangles) : edges_(to_size(triangles.size())) {
    const auto count = static_cast<Index>(triangles.rows());
    struct Entry {
        Index low, high, side;
        auto operator<=>(const Entry&) const = default;
    };
    std::vector<Entry> entries;
    entries.reserve(to_size(3 * count));
    for (Index f = 0; f < count; ++f)
        for (Index k = 0; k < 3; ++k) {
            const Side side{f, k};
            const auto [low, high] =
                std::minmax({start_of(triangles, side), end_of(triangles, side)});
            entries.push_back({low, high, 3 * f + k});
        }
    std::ranges::sort(entries);
    sides_.reserve(entries.size());
    for (std::size_t e = 0; e < entries.size(); ++e) {
        const bool is_new = e == 0 || entries[e].low != entries[e - 1].low ||
                            entries[e].high != entries[e - 1].high;
        if (is_new && e > 0) offsets_.push_back(static_cast<Index>(e));
        edges_[to_size(entries[e].side)] = size();
        sides_.push_back({entries[e].side / 3, entries[e].side % 3});
    }
    if (!entries.empty()) offsets_.push_back(static_cast<Index>(entries.size()));
}

}  // namespace pointmorph

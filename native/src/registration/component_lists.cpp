#include "registration/component_lists.hpp"

#include <algorithm>
#include <functional>

namespace pointmorph {

std::vector<std::vector<Index>> rows_of(const Topology& topology) {
    std::vector<std::vector<Index>> rows(topology.components.size());
    for (std::size_t i = 0; i < topology.labels.size(); ++i)
        rows[to_size(topology.labels[i])].push_back(to_index(i));
    return rows;
}

std::vector<Whole> wholes_of(const Positions& positions, const Topology& topology,
                             const std::vector<std::vector<Index>>& rows) {
    std::vector<Whole> wholes;
    for (std::size_t c = 0; c < topology.main().size(); ++c)
        wholes.push_back(whole_of(positions, rows[c]));
    return wholes;
}

void sort_by_points(std::vector<IndexPair>& matched, const Topology& source,
                    const Topology& target) {
    std::ranges::stable_sort(matched, std::greater<>(), [&](const IndexPair& pair) {
        return source.components[to_size(pair.source)].points +
               target.components[to_size(pair.target)].points;
    });
}

}  // namespace pointmorph

#include "registration/component_lists.hpp"

#include <algorithm>
#include <functional>

#include "pointmorph/base/parallel.hpp"

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

std::vector<Index> rows_beneath(const Positions& images, const KdTree<3>& there,
                                Progress& progress) {
    std::vector<Index> rows(to_size(images.rows()));
    parallel_for(to_index(images.rows()), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            double squared;
            there.nearest(images.row(i).data(), {&rows[to_size(i)], 1}, {&squared, 1});
        }
    });
    return rows;
}

void sort_by_points(std::vector<IndexPair>& matched, const Topology& source,
                    const Topology& target) {
    std::ranges::stable_sort(matched, std::greater<>(), [&](const IndexPair& pair) {
        return source.components[to_size(pair.source)].points +
               target.components[to_size(pair.target)].points;
    });
}

}  // namespace pointmorph

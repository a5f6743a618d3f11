#include "registration/rim.hpp"

#include <algorithm>
#include <cstddef>

#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

std::vector<Index> end_rows(const CoarseShape& shape) {
    std::vector<Index> rows;
    for (std::size_t i = 0; i < shape.ends.size(); ++i)
        if (shape.ends[i] != 0) rows.push_back(to_index(i));
    return rows;
}

std::vector<char> beyond_rim(const DeformationGraph& graph, const Positions& nodes,
                             const Positions& images, const Positions& rim) {
    constexpr double kFar = 1.0, kNextTo = 1.5;  // spacings of the nodes
    constexpr double kMedians = 3.0;  // while the shapes still lie apart, most nodes are far off
    std::vector<char> result(to_size(graph.size()), 0);
    if (rim.rows() == 0 || images.rows() == 0) return result;
    const auto distances = [&](const Positions& places) -> Values {
        return (nodes - gather(places, nearest_rows(KdTree<3>(places), nodes))).rowwise().norm();
    };
    const Values from_images = distances(images), from_rim = distances(rim);
    Values sorted = from_images;
    const auto middle = sorted.begin() + sorted.size() / 2;
    std::ranges::nth_element(sorted, middle);
    const double far = std::max(kFar * graph.spacing, kMedians * *middle);
    std::vector<Index> open;
    const auto reach = [&](Index k) {
        if (result[to_size(k)] != 0 || !(from_images[k] > far)) return;
        result[to_size(k)] = 1;
        open.push_back(k);
    };
    for (Index k = 0; k < graph.size(); ++k)
        if (from_rim[k] < far + kNextTo * graph.spacing) reach(k);
    while (!open.empty()) {
        const Index k = open.back();
        open.pop_back();
        for (auto e = to_size(graph.edge_offsets[to_size(k)]);
             e < to_size(graph.edge_offsets[to_size(k) + 1]); ++e)
            reach(graph.edge_ends[e]);
    }
    return result;
}

}  // namespace pointmorph

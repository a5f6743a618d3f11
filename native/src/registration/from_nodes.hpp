// What points get from the nodes that they follow. Not for callers of the library.
#pragma once

#include "pointmorph/registration/deformation.hpp"

namespace pointmorph {

/// A row for each point: those of its nodes, by its weights. `of_nodes` has a row for each node.
template <class Rows>
Rows from_nodes(const DeformationGraph& graph, const Rows& of_nodes) {
    Rows result = Rows::Zero(graph.points(), of_nodes.cols());
    for (Index i = 0; i < graph.points(); ++i)
        for (std::size_t k = 0; k < kNodesPerPoint; ++k)
            result.row(i) +=
                graph.point_weights[to_size(i)][k] * of_nodes.row(graph.point_nodes[to_size(i)][k]);
    return result;
}

}  // namespace pointmorph

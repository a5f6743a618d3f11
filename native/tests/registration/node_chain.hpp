// Nodes in a row, for the tests of registrations.
#pragma once

#include <cstdint>

#include "pointmorph/registration/deformation.hpp"

namespace pointmorph {

/// Each node is joined to the next.
inline DeformationGraph node_chain(Index count) {
    DeformationGraph graph;
    for (Index i = 0; i < count; ++i) {
        graph.node_rows.push_back(i);
        if (i > 0) graph.edge_ends.push_back(i - 1);
        if (i + 1 < count) graph.edge_ends.push_back(i + 1);
        graph.edge_offsets.push_back(static_cast<std::int64_t>(graph.edge_ends.size()));
    }
    return graph;
}

}  // namespace pointmorph

// Stage `homology`: which loops of a surface graph go round its handles.
#pragma once

#include <cstdint>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

/// A bit for each independent loop that bounds nothing; closed surfaces have two for each handle.
struct LoopClasses {
    /// Of `graph.neighbors`, the same both ways. The bits of a loop's edges, added without carry,
    /// are 0 exactly where it bounds part of the surface (homology over two elements).
    std::vector<std::uint32_t> bits;
    /// How many bits; nothing to be told where it is above 32.
    Index rank = 0;
};

/// Three nodes that are joined to each other span a triangle of the surface: loops that need more
/// to be filled, round a gap in the sampling, count as well. With a `radius` > 0 nodes that lie so
/// near to one of some, along the graph, are taken for one, and nodes that have a neighbor in
/// common for joined, so that smaller gaps don't count, nor handles that are as thin. `graph` is
/// connected.
LoopClasses loop_classes(const SurfaceGraph& graph, double radius = 0.0);

}  // namespace pointmorph

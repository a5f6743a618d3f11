// Stage `graph_extremities`: the extremities of a shape (feet, nose, tail), from the graph along
// its surface alone.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

/// A point that sticks out further than all around it.
struct Extremity {
    Index point;  ///< row of the shape or node of the graph
    /// > 0, in √area for those of a graph alone. That of the highest one is its height above the
    /// lowest point.
    double prominence;
};

struct GraphExtremityOptions {
    Index most = 12;           ///< the most prominent are kept
    double prominence = 0.04;  ///< only more prominent ones are kept, in √area
    Index samples = 30;        ///< points spread over the surface that distances are measured to
};

/// Those of a connected graph, the most prominent first: local maxima of the mean distance along it
/// to `samples` points (after Hilaga et al. 2001; farthest point sampling). `unit` is √area in the
/// graph's lengths.
std::vector<Extremity> extremities(const SurfaceGraph& graph, double unit,
                                   const GraphExtremityOptions& options, Progress& progress);

/// Prominence of every local maximum of `height` over a graph, 0 elsewhere: how far the values fall
/// until a higher maximum's surroundings are met. `offsets` and `ends` are as in SurfaceGraph.
std::vector<double> prominences(std::span<const std::int64_t> offsets, std::span<const Index> ends,
                                const Eigen::VectorXd& height);

/// Rows with more than `least` prominence, the most prominent first, `most` at the most.
std::vector<Index> most_prominent(const std::vector<double>& prominences, Index most, double least);

}  // namespace pointmorph

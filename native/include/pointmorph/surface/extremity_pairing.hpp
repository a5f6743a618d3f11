// Stage `extremity_pairing`: extremities that carry no feature (a tail, an ear), and which of them
// belong together on two shapes.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/surface/graph_extremities.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

/// A feature this near to an extremity, in √area along the surface, stands for it.
inline constexpr double kMarked = 0.1;

/// How far apart extremities lie that can't be a pair.
inline constexpr double kNoPair = std::numeric_limits<double>::infinity();

/// Distances along the graph from each feature, a node, to all nodes, in units of `unit`: #nodes by
/// #features.
Eigen::MatrixXd distances_from(const SurfaceGraph& graph, double unit,
                               std::span<const Index> features);

struct UnmarkedExtremities {
    std::vector<Index> rows;  ///< nodes of the graph, or what the owner turns them into
    /// Signatures: distances along the surface from all features in √area, #rows by #features.
    Eigen::MatrixXd distances;
};

/// Extremities that are farther than kMarked from all features, the most prominent first. `from` is
/// distances_from() the features; `unit` is √area.
UnmarkedExtremities unmarked_extremities(const SurfaceGraph& graph, double unit,
                                         const Eigen::MatrixXd& from,
                                         const GraphExtremityOptions& options, Progress& progress);

/// Rows of extremities that belong together: each other's best by far, by the root mean square
/// difference of their distances from all features plus how far `apart` they lie elsewhere (of a
/// source and a target row; kNoPair where they can't be one). None for `largest` or more.
std::vector<IndexPair> paired_extremities(const UnmarkedExtremities& source,
                                          const UnmarkedExtremities& target, double largest,
                                          const std::function<double(Index, Index)>& apart);

}  // namespace pointmorph

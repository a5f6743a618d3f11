// Stage `extremities`: the tips of a shape (feet, nose, tail), and which of them belong together
// under a map.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "pointmorph/coarse_shape.hpp"
#include "pointmorph/progress.hpp"
#include "pointmorph/surface_graph.hpp"
#include "pointmorph/types.hpp"

namespace pointmorph {

struct ExtremityOptions {
    Index most = 12;       ///< the most prominent are kept
    double radius = 0.25;  ///< of the surroundings that a tip sticks out of, in √area
    /// How far a point lies from the mean of its surroundings, in radii, has to fall by this much
    /// on the way to a higher tip.
    double prominence = 0.1;
    /// Tips whose images lie further apart than this, mean of both ways in √area, don't belong
    /// together.
    double reach = 0.3;
};

/// A point that sticks out further than all around it.
struct Extremity {
    Index point;  ///< row of the coarse shape
    /// In radii or, of a graph alone, √area; > 0. The highest tip has its height above the lowest
    /// point.
    double prominence;
};

/// Local maxima of the distance to the mean of the surface around (Gaussian weights along the
/// surface, after the integral invariants of Manay et al. 2004), the most prominent first
/// (persistence of superlevel sets). `distances` are node_distances(). The tip itself is the point
/// around such a node that is furthest from that mean.
std::vector<Extremity> extremities(const CoarseShape& shape, const Eigen::MatrixXd& distances,
                                   const ExtremityOptions& options);

/// Those of a graph alone, connected, with lengths in units of `unit`, √area: local maxima of the
/// mean distance along it (after Hilaga et al. 2001) to `samples` points spread over it (farthest
/// point sampling). At most so many, with more than `prominence`, which is in √area here.
std::vector<Extremity> extremities(const SurfaceGraph& graph, double unit, Index samples,
                                   Index most, double prominence, Progress& progress);

/// One target tip at most for each source tip, and how far apart a map leaves them.
struct ExtremityPair {
    Index source, target;  ///< places in the lists of tips
    double distance;       ///< mean of both ways, in √area
};

/// Least sum of distances under the maps `source_images` (of source points, on the target) and
/// `target_images`, where leaving two tips unpaired costs `reach`. Ascending by source.
std::vector<ExtremityPair> paired_extremities(const CoarseShape& source, const CoarseShape& target,
                                              const Positions& source_images,
                                              const Positions& target_images,
                                              const std::vector<Extremity>& source_tips,
                                              const std::vector<Extremity>& target_tips,
                                              const ExtremityOptions& options);

/// Row and column of every cost that is below `largest` and the least of its row and of its column
/// by far: all others there are more than `by_far` times as high.
std::vector<IndexPair> each_others_best(const Eigen::MatrixXd& costs, double largest,
                                        double by_far);

/// The column of each row, none twice, with the least sum of costs; no fewer columns than rows
/// (Kuhn 1955, Munkres 1957; by shortest augmenting paths).
std::vector<Index> least_assignment(const Eigen::MatrixXd& costs);

/// Pairings that differ little from `now` (places in lists of `sources` and `targets` tips): with a
/// pair more or less, with one tip exchanged for one left alone, with two swapped, and with three
/// exchanged in turn, as nose and ears where a head was turned. Each once, sorted.
std::vector<std::vector<IndexPair>> changed_pairings(const std::vector<IndexPair>& now,
                                                     Index sources, Index targets);

}  // namespace pointmorph

// Stage `extremities`: the tips of a shape (feet, nose, tail), and which of them belong together
// under a map.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/surface/graph_extremities.hpp"

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

/// Local maxima of the distance to the mean of the surface around (Gaussian weights along the
/// surface, after the integral invariants of Manay et al. 2004), the most prominent first
/// (persistence of superlevel sets). `distances` are node_distances(). The tip itself is the point
/// around such a node that is furthest from that mean.
std::vector<Extremity> extremities(const CoarseShape& shape, const Eigen::MatrixXd& distances,
                                   const ExtremityOptions& options);

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

}  // namespace pointmorph

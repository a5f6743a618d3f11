// Stage `extremities`: the ends of a shape's limbs (feet, nose, tail), and which of them belong
// together under a map.
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
    double radius = 0.25;  ///< of the surroundings that one sticks out of, in √area
    /// How far a point lies from the mean of its surroundings, in radii, has to fall by this much
    /// on the way to a higher extremity.
    double prominence = 0.1;
    /// Extremities whose images lie further apart than this, mean of both ways in √area, don't
    /// belong together.
    double reach = 0.3;
};

/// Local maxima of the distance to the mean of the surface around (Gaussian weights along the
/// surface, after the integral invariants of Manay et al. 2004), the most prominent first
/// (persistence of superlevel sets). `distances` are node_distances(). The extremity itself is
/// the point around such a node that is furthest from that mean. Coarse rows.
std::vector<Extremity> extremities(const CoarseShape& shape, const Eigen::MatrixXd& distances,
                                   const ExtremityOptions& options);

/// A shape, where a map takes its points, and its extremities.
struct MappedExtremities {
    const CoarseShape& shape;
    const Positions& images;  ///< #points by 3, on the other shape
    const std::vector<Extremity>& extremities;
};

/// One target extremity at most for each of the source, and how far apart a map leaves them.
struct ExtremityPair {
    Index source, target;  ///< places in the lists of extremities
    double distance;       ///< mean of both ways, in √area
};

/// Least sum of distances under the maps both ways, where leaving two extremities unpaired costs
/// `reach`. Ascending by source.
std::vector<ExtremityPair> paired_extremities(const MappedExtremities& source,
                                              const MappedExtremities& target,
                                              const ExtremityOptions& options);

}  // namespace pointmorph

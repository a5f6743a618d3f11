// Regions of a mesh that keep their shape while the rest gives way. Not for callers of the library.
#pragma once

#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

class RigidRegions {
public:
    /// `weights`: a place each, 0 to 1, or none. Places with a weight that are connected by such
    /// places are a region, which keeps its shape at rest.
    RigidRegions(const Mesh& mesh, const Values& weights);

    double weight(Index place) const { return weights_.rows() > 0 ? weights_[place] : 0.0; }

    /// Moves places by their weight to where the similarity takes them that suits their region best
    /// (Mueller et al., Meshless Deformations Based on Shape Matching, 2005).
    void keep(Positions& x) const;

private:
    struct Region {
        std::vector<Index> places;
        std::vector<double> shares;  ///< of each: its weight times the area around it, sum 1
        Positions rest;              ///< of each, from the weighted mean
        double spread;               ///< mean square of these, > 0
    };

    Values weights_;
    std::vector<Region> regions_;
};

}  // namespace pointmorph

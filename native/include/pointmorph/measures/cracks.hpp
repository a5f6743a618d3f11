// Where an in-between cloud has torn open (paper, Dynamic Re-sampling, says why it does).
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/surface/pairing.hpp"

namespace pointmorph {

/// The share of neighboring points between which the cloud at t is open.
struct Cracks {
    double t;
    double share;  ///< 0 to 1, the larger of both clouds'
};

/// Edges join each point with its six nearest on its own cloud. One is open at t when its
/// midpoint in the in-between cloud is more than two spacings (between those of both ends) away
/// from every point. At most `max_edges` edges a cloud are looked at, evenly over its points.
std::vector<Cracks> find_cracks(const Positions& source, const Positions& target,
                                std::span<const IndexPair> pairs, std::span<const double> times,
                                Progress& progress, Index max_edges = 50000);

}  // namespace pointmorph

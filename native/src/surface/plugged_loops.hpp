// Borders that another component closes, as an eye does its socket. Not for callers of the library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/surface/boundary.hpp"

namespace pointmorph {

/// The loops along which the surface ends: all but those that points of another component lie next
/// to nearly all the way round. `labels` say the component of each point.
std::vector<BoundaryLoop> unplugged_loops(const Positions& positions, const Neighborhoods& nearest,
                                          std::span<const BoundaryLoop> loops,
                                          std::span<const Index> labels);

}  // namespace pointmorph

// Points of a cloud that lie off the surface which the others sample, such as specks of a scan. Not
// for callers of the library.
#pragma once

#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// Rows of scattered points and of tiny clumps off the surface, ascending; none where they would be
/// too many for that. `nearest` is ascending by distance and has 12 or more a point, where there
/// are that many. A place occurs once.
std::vector<Index> stray_points(const Positions& positions, const Neighborhoods& nearest);

}  // namespace pointmorph

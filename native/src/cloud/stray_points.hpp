// Points of a cloud that lie off the surface which the others sample, such as specks of a scan. Not
// for callers of the library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// As many points, as a share of all, as may be left out of a shape: more are a part of it.
inline constexpr double kMostStrays = 0.05;

/// Rows of scattered points and of tiny clumps off the surface, ascending; none where they would be
/// too many for that. `nearest` is ascending by distance and has 12 or more a point, where there
/// are that many. A place occurs once. Rows that are `marked` are none.
std::vector<Index> stray_points(const Positions& positions, const Neighborhoods& nearest,
                                std::span<const Index> marked, Progress& progress);

}  // namespace pointmorph

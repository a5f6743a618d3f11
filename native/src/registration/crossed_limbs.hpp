// Limbs that have run into each other. Not a part of the library.
#pragma once

#include <span>

#include "pointmorph/base/types.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

/// The graph along a surface, cut where two limbs run into each other: no edge leads
/// from one to the other there, and what is straight stays together. The limbs hang together
/// elsewhere as well, as a fore and a hind leg do by the trunk, and one or both go on to an end.
/// `unit` is √area, and `centers` are the rows around which such places are looked for.
SurfaceGraph without_crossings(const Positions& positions, double unit, SurfaceGraph graph,
                               std::span<const Index> centers);

}  // namespace pointmorph

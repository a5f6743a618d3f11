// The map of a part of a shape onto a piece of the whole one: a head onto a body. Not for callers
// of the library.
#pragma once

#include <span>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

struct PartOrWhole {
    Refinement map;
    bool is_part = false;  ///< whether one of the shapes is mapped onto a piece of the other
};

/// refine(), and where one of the clouds ends while the other goes on, also onto pieces of that:
/// the map onto a piece where it fits much better, where the marks say how small the part is, or
/// where `start` was such a map. What lies beyond the piece goes to the nearest end then. Throws
/// Cancelled.
PartOrWhole refine_part_or_whole(const RefinementCloud& source, const RefinementCloud& target,
                                 std::span<const Feature> features,
                                 const RefinementOptions& options, Progress& progress,
                                 const RefinementStart* start);

}  // namespace pointmorph

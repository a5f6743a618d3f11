// Where a map is worst, and what would help there. Internal.
#pragma once

#include <span>
#include <vector>

#include "measures/measured_map.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/measures/quality.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

/// See Quality::worst.
std::vector<Place> worst_places(const MeasuredCloud& from, const MeasuredCloud& to,
                                const MeasuredMaps& maps, const TwoWayMap& map,
                                std::span<const Feature> features, Progress& progress);

}  // namespace pointmorph

// Where a map is more likely wrong than right, and which marks would settle it. Internal.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "measures/judged_surface.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/measures/local_confidence.hpp"
#include "pointmorph/measures/quality.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

/// What is known of the nodes of one cloud. Refers to all of it.
struct JudgedNodes {
    const JudgedSurface& surface;
    const NodeTrees& trees;
    const Values& confidence;            ///< that their images are right
    const std::vector<char>& alone;      ///< whether they are known to have no counterpart
    const std::vector<char>& unreached;  ///< whether none of the other cloud's images is near
};

/// See LocalConfidence.
struct DoubtfulPlaces {
    std::vector<DoubtfulPlace> places;
    std::string warning;
};

/// `right`: see LocalConfidence.
DoubtfulPlaces doubtful_places(const JudgedNodes& source, const JudgedNodes& target, double right,
                               const TwoWayMap& map, std::span<const Feature> features);

}  // namespace pointmorph

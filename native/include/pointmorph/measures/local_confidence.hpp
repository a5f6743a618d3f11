// Stage `local_confidence`: how likely each point of two clouds is mapped to about where it
// belongs, and which marks would settle it where that is in doubt. Not in the paper, whose user
// looks.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/measures/quality.hpp"
#include "pointmorph/registration/diagnostics.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

/// An image this near to its right place, in √area, is right.
inline constexpr double kRightPlace = 0.1;

/// A place where the map is more likely wrong than right.
struct DoubtfulPlace {
    Index source;       ///< row: where a mark would help most
    Index target;       ///< row where the map has it now
    double confidence;  ///< mean over the doubtful points there
    double share;       ///< of the surface covered by them, 0 to 1
    bool unreached;     ///< whether nothing of the other cloud comes near: it may lack this part
    bool on_source;     ///< the model that the doubtful points are of
    std::string where;  ///< "toward +X of Fox", "near \"nose\""
    std::string advice;
};

struct LocalConfidence {
    /// One a point: the probability, 0 to 1, that its image is right.
    Values source, target;
    /// At most five, far apart, the worst first; empty where nothing is more likely wrong.
    std::vector<DoubtfulPlace> doubtful;
    /// How much is likely right, 0 to 1: the mean over the surface of the cloud that is worse off.
    double right = 1.0;
    /// Where that is less than kMostlyRight, what to do, in a sentence; else empty.
    std::string warning;
};

/// Of 252 maps whose truth is known, four of which less was right than 0.7 were above, and none of
/// which more than 0.95 was right were below.
inline constexpr double kMostlyRight = 0.8;

/// A map between two clouds, and what is known of it. Refers to all of it.
struct JudgedMap {
    const TwoWayMap& map;
    const Quality& quality;          ///< of that map
    const Diagnostics& diagnostics;  ///< rows of the clouds
};

/// `features` are the marks that the map was found with; they give the advice its words. The result
/// doesn't depend on the number of threads; with 4000 points or more it differs by a few hundredths
/// in other orientations, otherwise it doesn't depend on the scale, position or orientation of the
/// clouds. Fitted to maps whose truth is known; see docs/stages/measures/local_confidence.md.
LocalConfidence measure_local_confidence(const JudgedMap& judged, std::span<const Feature> features,
                                         Progress& progress);

}  // namespace pointmorph

// Stage `proposals`: what to ask the user. Where the best maps differ, and places of both shapes
// that probably belong together.
#pragma once

#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "pointmorph/registration/pose.hpp"
#include "pointmorph/registration/registration.hpp"

namespace pointmorph {

/// What a rival does to the shape, against the map that was chosen.
enum class Swap {
    kEnds,    ///< exchanges the ends of its longest axis: head and tail
    kSides,   ///< turns the others about it: left and right
    kTurned,  ///< turns most of it some other way
    kPlaces,  ///< differs in some places: a limb, how a head is held
    kRolled   ///< rolls a long thin shape about its length: a snake's belly and back
};
/// "ends", "sides", "turned", "places", "rolled"
std::string name_of(Swap swap);

/// Another map that fits about as well, and a mark that would tell which is right. Rows are those
/// of the shapes it was found on; see Diagnostics::with_rows().
struct Rival {
    double ratio;               ///< its cost, or what that counts as, over the chosen map's
    Swap swap;                  ///< what differs
    double distance;            ///< the largest between a point's two images, in √area
    std::vector<Index> places;  ///< source rows: the middle of what differs, largest area first
    Index source;               ///< where a mark would tell them apart
    Index target;               ///< that point's partner under the chosen map
    Index rival_target;         ///< under this one
};

/// Coarse rows; `target` as it was before it was aligned.
std::vector<Rival> describe_rivals(const CoarseShape& source, const CoarseShape& target,
                                   const Pose& pose);

/// Two places that probably belong together.
struct Proposal {
    Index source, target;  ///< rows
    double confidence;     ///< about how often such a pair lies within 0.1 √area of the truth
    bool is_extremity;     ///< of extremities of both shapes, not a place between
};

/// That of a pair: `confidence` is the map's, `distance` how far apart it leaves the two (mean of
/// both ways, in √area). Fitted to maps between animals.
double proposal_confidence(double confidence, double distance);

/// What features are proposed from. Refers to all of it: the caller keeps it alive.
struct ProposalInput {
    const CoarsePair& shapes;  ///< the target where the registration has it; what is marked already
    const Registration& registration;
    const std::vector<Extremity>&source_extremities, &target_extremities;  ///< coarse rows
    double confidence;                                                     ///< that of the map
};

/// The extremities of both shapes that the map brings together, the most confident first, then
/// `others` spread over what is far from extremities and features. No row of a feature. Coarse
/// rows.
std::vector<Proposal> propose_features(const ProposalInput& input, Index others,
                                       Progress& progress);

}  // namespace pointmorph

// Stage `attempts`: where a registration looks wrong, further ones from other starts; the best is
// kept.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/registration.hpp"
#include "pointmorph/surface/extremity_pairing.hpp"

namespace pointmorph {

/// Lengths are in units of √(surface area).
struct AttemptOptions {
    GraphExtremityOptions extremities;
    /// Tips whose signatures differ by more than this don't belong together; see
    /// tips_by_features().
    double tip_difference = 0.12;
    /// Weight of the difference in mean distance, which a longer tail has as well.
    double offset_weight = 0.1;
    /// The finest level alone, with local areas to tell limbs from bodies.
    RegistrationLevel fine{6, 20, 30.0, 4.0, 2, 4, 3, 2000, 4, 0.2, 0.02};
};

/// A start that was tried, and what came of it.
struct Attempt {
    std::string start;    ///< for the user: "features", "pose", "earlier map", "tips" or "fine"
    double torn = 0.0;    ///< torn_share()
    double energy = 0.0;  ///< registration_energy() of the finest level; 0 for a single attempt
};

struct Attempts {
    Registration registration;   ///< of the attempt that was taken
    std::vector<Attempt> tried;  ///< in this order
    std::size_t taken = 0;       ///< which of them
};

/// Pairs tips by where they lie to the features: least difference between the geodesic distances
/// to each of them, less its mean, which says how long a limb is. Rows of the shapes. None with
/// fewer than three features.
std::vector<IndexPair> tips_by_features(const CoarseShape& source, const CoarseShape& target,
                                        std::span<const IndexPair> features,
                                        const AttemptOptions& options, Progress& progress);

/// Where `first`, a finished registration called `start_name`, looks wrong, registers also through
/// tips, and on the finest level alone, both from the thin plate through the features. Kept is what
/// has the least energy · (1 + torn/`most_torn`); see RegistrationOptions.
Attempts register_best(const CoarseShape& source, const CoarseShape& target,
                       std::span<const IndexPair> features, const std::string& start_name,
                       Registration first, const AttemptOptions& options,
                       const RegistrationOptions& registration, Progress& progress);

}  // namespace pointmorph

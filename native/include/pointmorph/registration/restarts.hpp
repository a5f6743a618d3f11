// Stage `restarts`: where a registration looks wrong, further ones from other starts; the best is
// kept.
#pragma once

#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/registration.hpp"
#include "pointmorph/surface/extremity_pairing.hpp"

namespace pointmorph {

/// Lengths are in units of √(surface area).
struct RestartOptions {
    GraphExtremityOptions extremities;
    /// Extremities whose signatures differ by more than this don't belong together; see
    /// extremities_by_features().
    double largest_difference = 0.12;
    /// Weight of the difference in mean distance, which a longer tail has as well.
    double offset_weight = 0.1;
    /// The finest level alone, with local areas to tell limbs from bodies.
    RegistrationLevel fine{.stiff_rounds = 6,
                           .rounds = 20,
                           .first_stiffness = 30.0,
                           .last_stiffness = 4.0,
                           .solves = 2,
                           .first_smoothing = 4,
                           .last_smoothing = 3,
                           .matched_points = 2000,
                           .full_rounds = 4,
                           .first_area_weight = 0.2,
                           .last_area_weight = 0.02};
};

/// A start that was tried, and what came of it.
struct Restart {
    std::string start;    ///< for the user: "features", "pose", "earlier map", "tips" or "fine"
    double torn = 0.0;    ///< torn_share()
    double energy = 0.0;  ///< of the misfit at the finest level; 0 where nothing else was tried
};

/// A finished registration, and what it was started from.
struct StartedRegistration {
    std::string start;
    Registration registration;
};

struct Restarts {
    Registration registration;   ///< of the start that was taken
    std::vector<Restart> tried;  ///< in this order
    std::size_t taken = 0;       ///< which of them
};

/// Pairs extremities by where they lie to the features: least difference between the geodesic
/// distances to each of them, less its mean, which says how long a limb is. Coarse rows. None with
/// fewer than three features.
std::vector<IndexPair> extremities_by_features(const CoarsePair& shapes,
                                               const RestartOptions& options, Progress& progress);

/// Where `first` looks wrong, registers also through extremities, and on the finest level alone,
/// both from the thin plate through the features. Kept is what has the least
/// energy · (1 + torn/`most_torn`); see RegistrationOptions.
Restarts register_best(const CoarsePair& shapes, StartedRegistration first,
                       const RestartOptions& options, const RegistrationOptions& registration,
                       Progress& progress);

}  // namespace pointmorph

// Stage `registration`: two coarse shapes deform onto each other at once, nearly rigidly, matched
// in the product of both (where I go, where I am).
#pragma once

#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/deformation.hpp"

namespace pointmorph {

/// How one level of nodes is worked through.
struct RegistrationLevel {
    /// Rounds in which the data hardly count (`stiff_data`): rotations spread from the features.
    int stiff_rounds;
    /// Rounds after; stiffness falls geometrically from the first to the last over them.
    int rounds;
    /// Weight of rigidity against the data, whose weights sum to about 2 on either side; > 0.
    double first_stiffness, last_stiffness;
    /// Solutions for the nodes' places, each followed by one for their rotations, in a round.
    int solves;
    /// How often covariances are averaged over the node graph, in the first and the last round.
    int first_smoothing, last_smoothing;
    /// Points of each side that are matched in a round, the nodes among them …
    Index matched_points;
    /// … but in the last so many rounds, where all are.
    int full_rounds;
    /// Weight of local_areas() against lengths in the matching, in the first and the last round;
    /// both > 0, or both 0.
    double first_area_weight = 0.0, last_area_weight = 0.0;
};

/// Lengths are in units of √(surface area).
struct RegistrationOptions {
    /// One for each of the shapes' levels, coarsest first.
    std::vector<RegistrationLevel> levels{{.stiff_rounds = 6,
                                           .rounds = 24,
                                           .first_stiffness = 30.0,
                                           .last_stiffness = 1.0,
                                           .solves = 2,
                                           .first_smoothing = 2,
                                           .last_smoothing = 1,
                                           .matched_points = 1000,
                                           .full_rounds = 0},
                                          {.stiff_rounds = 0,
                                           .rounds = 10,
                                           .first_stiffness = 10.0,
                                           .last_stiffness = 4.0,
                                           .solves = 2,
                                           .first_smoothing = 4,
                                           .last_smoothing = 3,
                                           .matched_points = 2000,
                                           .full_rounds = 4}};
    double stiff_data = 0.05;      ///< factor on the data's weights in stiff rounds
    double normal_weight = 0.1;    ///< of unit normals against lengths in the product space
    double feature_weight = 30.0;  ///< of each feature pair
    double soft_weight = 0.03;     ///< of a soft feature, and a curve's part as long as a node's
                                   ///< spacing, of weight 1
    double region_weight = 20.0;  ///< of a match of points of a region of weight 1, others' being 1
    double label_distance = 0.5;  ///< between points inside and outside of a region of weight 1
    double outlier_distance = 3.0;  ///< in medians: where a match's weight has halved
    /// Parts whose images have jumped away from the rest don't count when they have less than
    /// this share of the nodes.
    double torn_component = 0.04;
    double largest_scale = 3.0;  ///< of a node's surroundings, and the inverse of the smallest
    double tear_stretch = 3.0, tear_gap = 0.06;  ///< of an edge that counts as torn
    /// A result with a larger share of torn edges looks wrong; see torn_share(). Limbs without a
    /// counterpart of their size tear some edges in good maps, too.
    double most_torn = 0.0025;
};

/// Both shapes deformed onto each other.
struct Registration {
    Deformation source, target;                  ///< of the finest level's nodes
    DeformedCloud source_points, target_points;  ///< images of all coarse points
};

/// Where the coarse points of both shapes start.
struct RegistrationStart {
    Positions source, target;  ///< #points by 3
};

/// The level `level` alone, from `start`.
Registration register_level(const CoarsePair& shapes, Index level, const RegistrationStart& start,
                            const RegistrationLevel& schedule, const RegistrationOptions& options,
                            Progress& progress);

/// From `start`, level by level, beginning with `first_level`. The target has been aligned with the
/// source, which has unit area.
Registration register_shapes(const CoarsePair& shapes, const RegistrationStart& start,
                             const RegistrationOptions& options, Progress& progress,
                             Index first_level = 0);

}  // namespace pointmorph

// Stage `registration`: two coarse shapes deform onto each other at once, nearly rigidly, matched
// in the product of both (where I go, where I am).
#pragma once

#include <array>
#include <span>
#include <vector>

#include "pointmorph/coarse_shape.hpp"
#include "pointmorph/deformation.hpp"
#include "pointmorph/progress.hpp"
#include "pointmorph/types.hpp"

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
    std::vector<RegistrationLevel> levels{RegistrationLevel{6, 24, 30.0, 1.0, 2, 2, 1, 1000, 0},
                                          RegistrationLevel{0, 10, 10.0, 4.0, 2, 4, 3, 2000, 4}};
    double stiff_data = 0.05;       ///< factor on the data's weights in stiff rounds
    double normal_weight = 0.1;     ///< of unit normals against lengths in the product space
    double feature_weight = 30.0;   ///< of each feature pair
    double outlier_distance = 3.0;  ///< in medians: where a match's weight has halved
    /// Pieces whose images have jumped away from the rest don't count when they have less than
    /// this share of the nodes.
    double torn_piece = 0.04;
    double largest_scale = 3.0;  ///< of a node's surroundings, and the inverse of the smallest
};

/// Both shapes deformed onto each other.
struct Registration {
    Deformation source, target;                  ///< of the finest level's nodes
    DeformedCloud source_points, target_points;  ///< images of all coarse points
};

/// Where the points of both shapes start.
struct RegistrationStart {
    Positions source, target;  ///< #points by 3
};

/// The thin plate (kernel r) through the features and its inverse; with fewer than five features
/// the points stay where they are.
RegistrationStart thin_plate_start(const CoarseShape& source, const CoarseShape& target,
                                   std::span<const IndexPair> features);

/// One level alone, from `start`.
Registration register_level(const CoarseShape& source, const CoarseShape& target, Index level,
                            std::span<const IndexPair> features, const RegistrationStart& start,
                            const RegistrationLevel& schedule, const RegistrationOptions& options,
                            Progress& progress);

/// Distances along the node graph of the coarsest level, #nodes by #nodes, in √area.
Eigen::MatrixXd node_distances(const CoarseShape& shape);

/// node_distances() of the source and of the target.
using NodeDistances = std::array<Eigen::MatrixXd, 2>;

/// Share of the edges of both surface graphs that are torn: whose ends the last matching takes
/// further apart than `stretch` times their length and `gap`, in √area.
double torn_share(const CoarseShape& source, const CoarseShape& target,
                  const Registration& registration, double stretch, double gap,
                  const RegistrationOptions& options, Progress& progress);

/// How much the shapes had to bend, and what gap is left: a weighted geometric mean over both
/// directions of gaps, round trips, disagreement of normals, residual and change of the rotations
/// and scales at the nodes of `level`, which `registration` belongs to, and of the distortion of
/// distances along the surface. Only the ratio of two of
/// them says something: less is better.
double registration_energy(const CoarseShape& source, const CoarseShape& target, Index level,
                           const Registration& registration, const NodeDistances& distances,
                           const RegistrationOptions& options, Progress& progress);

/// From `start`, level by level, beginning with `first_level`. `features` are rows of the coarse
/// shapes. The target has been aligned with the source, which has unit area.
Registration register_shapes(const CoarseShape& source, const CoarseShape& target,
                             std::span<const IndexPair> features, const RegistrationStart& start,
                             const RegistrationOptions& options, Progress& progress,
                             Index first_level = 0);

}  // namespace pointmorph

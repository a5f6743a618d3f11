// Stage `registration`: two coarse shapes deform onto each other at once, nearly rigidly, matched
// in the product of both (where I go, where I am).
#pragma once

#include <array>
#include <span>
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
    std::vector<RegistrationLevel> levels{RegistrationLevel{6, 24, 30.0, 1.0, 2, 2, 1, 1000, 0},
                                          RegistrationLevel{0, 10, 10.0, 4.0, 2, 4, 3, 2000, 4}};
    double stiff_data = 0.05;      ///< factor on the data's weights in stiff rounds
    double normal_weight = 0.1;    ///< of unit normals against lengths in the product space
    double feature_weight = 30.0;  ///< of each feature pair
    double soft_weight = 0.03;     ///< of a soft feature, and a curve's part as long as a node's
                                   ///< spacing, of weight 1
    double region_weight = 20.0;  ///< of a match of points of a region of weight 1, others' being 1
    double label_distance = 0.5;  ///< between points inside and outside of a region of weight 1
    double outlier_distance = 3.0;  ///< in medians: where a match's weight has halved
    /// Pieces whose images have jumped away from the rest don't count when they have less than
    /// this share of the nodes.
    double torn_piece = 0.04;
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

/// Where the points of both shapes start.
struct RegistrationStart {
    Positions source, target;  ///< #points by 3
};

/// Places that belong together, a row each: the features', then those of some of the guides.
struct MarkedPlaces {
    Positions source, target;
};
MarkedPlaces marked_places(const CoarseShape& source, const CoarseShape& target,
                           std::span<const IndexPair> features);

/// The thin plate (kernel r) through the marked places and its inverse; with fewer than five of
/// them the points stay where they are.
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
NodeDistances node_distances(const CoarseShape& source, const CoarseShape& target);

/// Share of the edges of both surface graphs that are torn: whose ends the last matching takes
/// further apart than `tear_stretch` times their length and `tear_gap`.
double torn_share(const CoarseShape& source, const CoarseShape& target,
                  const Registration& registration, const RegistrationOptions& options,
                  Progress& progress);

/// How much the shapes had to bend, and what gap is left: means over both directions, at the nodes
/// of a level or the edges between them. All ≥ 0, 0 is perfect.
struct Misfit {
    double gap = 0.0;         ///< from images to where they were matched, in √area
    double round_trip = 0.0;  ///< from a point to where it ends up there and back, in √area
    double normals = 0.0;     ///< 1 − cosine
    double opposed = 0.0;     ///< share whose image shows its back
    double residual = 0.0;    ///< of the edges against their ends' similarities, squared, relative
    double turn = 0.0;        ///< change of the rotations along edges
    double scale = 0.0;       ///< and of the logarithms of the scales
    double geodesics = 0.0;   ///< change of distances along the surface, in √area
    double torn = 0.0;        ///< share of the edges whose length changes by a factor over 2

    /// A weighted geometric mean of all but `torn`; only the ratio of two of them says something.
    double energy() const;
};

/// Of `registration`, which belongs to `level`.
Misfit registration_misfit(const CoarseShape& source, const CoarseShape& target, Index level,
                           const Registration& registration, const NodeDistances& distances,
                           const RegistrationOptions& options, Progress& progress);

/// Its energy().
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

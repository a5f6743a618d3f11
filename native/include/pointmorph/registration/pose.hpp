// Stage `pose`: how the target lies to the source, where features don't say it.
#pragma once

#include <limits>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/alternatives.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "pointmorph/registration/misfit.hpp"
#include "pointmorph/registration/pose_symmetry.hpp"
#include "pointmorph/registration/registration.hpp"

namespace pointmorph {

/// How widely ways to pair the extremities are searched.
struct PoseEffort {
    Index variants;    ///< that each of the best maps is tried with …
    Index rounds;      ///< … so often, or until nothing better is found
    double promising;  ///< maps that are worse than the best by this factor aren't varied further
};

/// An axis of both shapes that points up.
enum class UpAxis { kNone, kX, kY, kZ };

struct PoseOptions {
    /// Spreads along two axes that are taken for one another differ by no more than this factor;
    /// 1 or more.
    double spread_ratio = 1.8;
    /// A pose is dropped when it leaves the features further apart than the best one does by this
    /// much, root mean square, in √area.
    double feature_distance = 0.3;
    /// So many of the best distinct maps are tried again, and at last continued to the finest
    /// level and compared there …
    Index finalists = 4;
    Index semifinalists = 8;  ///< … out of so many that were registered for longer
    /// Contenders from up to so many other pose clusters are among those.
    Index other_clusters = 2;
    /// Two maps are distinct when their images lie further apart than this in √area: the mean, or
    /// .35 times the mean of the worst 3 % where that is more (a limb).
    double distinct = 0.05;
    double same = 0.02;  ///< the same for maps that extremities have led halfway
    Index points = 600;  ///< of each shape in a trial, the nodes among them
    double tilt = 0.44;  ///< angle about each axis by which the best poses are tilted, in radians
    ExtremityOptions extremities;
    SymmetryOptions symmetry;
    PoseEffort effort{.variants = 8, .rounds = 3, .promising = 1.3};
    /// Energies are multiplied by .1 + the unlikeness, to this power: how differently the surface
    /// is formed around points and around their images. 0: it doesn't count.
    double likeness = 0.5;
    /// Rounds of the effort before likeness counts. Earlier, maps aren't close enough to tell.
    Index plain_rounds = 1;
    /// After it, where the best map is torn (`most_torn`), or where a larger share than
    /// `most_opposed` of its images are back faces. Many rounds of few variants: it ends soon where
    /// it finds nothing.
    PoseEffort second_effort{.variants = 6, .rounds = 6, .promising = 1.5};
    double most_opposed = 0.002;
    // What is worse than the best by such a factor isn't followed further:
    double halfway_factor = 1.15;    ///< of maps that extremities have led halfway, in one round
    double contender_factor = 1.15;  ///< of clusters, and of maps registered for longer
    /// Of clusters whose extremities are varied, and of maps that see the shapes from another side.
    double varied_factor = 1.3;
    /// At the finest level maps are ranked by energy · (1 + so many times the share of torn edges).
    /// With more, maps would be preferred that lay head on tail where a limb has no partner, as
    /// right maps tear there. Two maps of one pose differ less: restarts weigh tears more.
    double tear_weight = 20.0;
    /// Whoever gives two shapes has mostly stood them alike. So energies are multiplied by more,
    /// the farther a map rotates the target from how it was given: by up to `as_given`, at
    /// `as_given_angle` (radians) and beyond. 1 or more.
    double as_given = 1.2;
    double as_given_angle = 1.0;
    /// The less two shapes have in common, the less their fit says of how they belong together:
    /// where the least product of misfit and Candidate::unlikeness at the finest level is r times
    /// `alike`, above 0, and more than that, `unlike` · (r² − 1) · r⁶ is added to that factor.
    double alike = 0.03;
    double unlike = 0.4;
    /// Tells tilting from turning about the vertical: models face anywhere, but seldom lie on their
    /// sides. So `unlike` counts for the fourth power of the angle by which a map tilts this axis
    /// of the target, over `as_given_angle`, and no more than `facing` of it for turning. With
    /// none, it counts for the rotation as a whole.
    UpAxis up = UpAxis::kNone;
    double facing = 0.1;
    /// The quick trial of every pose, on the coarsest level.
    RegistrationLevel trial{.stiff_rounds = 2,
                            .rounds = 8,
                            .first_stiffness = 10.0,
                            .last_stiffness = 1.5,
                            .solves = 1,
                            .first_smoothing = 2,
                            .last_smoothing = 1,
                            .matched_points = 450,
                            .full_rounds = 0};
    /// What makes energies of trials comparable: the best of them are registered for longer.
    RegistrationLevel longer{.stiff_rounds = 0,
                             .rounds = 8,
                             .first_stiffness = 5.0,
                             .last_stiffness = 1.0,
                             .solves = 1,
                             .first_smoothing = 2,
                             .last_smoothing = 1,
                             .matched_points = 450,
                             .full_rounds = 0};
    /// What continues the best of those, on all points, before the finest level.
    RegistrationLevel relaxation{.stiff_rounds = 0,
                                 .rounds = 12,
                                 .first_stiffness = 5.0,
                                 .last_stiffness = 1.0,
                                 .solves = 2,
                                 .first_smoothing = 2,
                                 .last_smoothing = 1,
                                 .matched_points = 1000,
                                 .full_rounds = 0};
};

/// A map that was continued to the finest level.
struct Candidate {
    Similarity alignment;       ///< rotates and moves the target to where the registration has it
    Registration registration;  ///< of the finest level, for the target so moved
    Misfit misfit{};
    double unlikeness = 1.0;  ///< the factor of the energy that says how unlike what it maps is
    /// That of the misfit · (1 + SymmetryOptions::weight · asymmetry) · (.1 + unlikeness) to the
    /// power of PoseOptions::likeness · what turning the target costs, PoseOptions::as_given
    double energy = 0.0;
    double torn = 0.0;  ///< torn_share()
    double cost = 0.0;  ///< energy · (1 + PoseOptions::tear_weight · torn)
    /// Whether it is the best map rolled about the length of long thin shapes: energy and cost are
    /// what they count as then.
    bool is_rolled = false;
};

/// Images of the source's points on the target at rest.
Positions images_at_rest(const Candidate& map);

struct Pose {
    Candidate best;
    /// Other maps, distinct from the best and from one another, the best first.
    std::vector<Candidate> rivals;
    /// Cost of the best distinct map over that of this one, 1 or more: near 1, the shapes fit
    /// another way just as well. Infinite where no other was found.
    double margin = std::numeric_limits<double>::infinity();
    /// See pose_confidence().
    double confidence = 1.0;
    /// All other maps but the worst, distinct or not. Coarse rows of the coarsest level's nodes.
    Alternatives alternatives;
    std::vector<Extremity> source_extremities, target_extremities;  ///< coarse rows
};

/// Another map, compared with the one that was chosen.
struct Competitor {
    double ratio;     ///< its cost over the chosen one's
    double distance;  ///< mean over the source between a point's two images, in √area
};

/// How likely a map is right, 0 to 1: falls with the share of images that are back faces
/// (logistic), and with every competitor that fits nearly as well, the more the further it lies
/// apart: two maps of the same cost that have nothing in common are right half the time at most.
/// Fitted to maps between animals; "right" is a mean landmark error of at most .07 √area.
double pose_confidence(const Misfit& misfit, std::span<const Competitor> competitors);

/// Registers from every one of the candidate_poses(), with extremities that may belong together as
/// guides, and keeps the map that bends the shapes least for how well it brings them together and
/// treats their sides alike; in doubt, one that leaves them as they were given.
Pose find_pose(const CoarsePair& shapes, const PoseOptions& options,
               const RegistrationOptions& registration, Progress& progress);

}  // namespace pointmorph

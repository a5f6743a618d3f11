// Stage `pose`: how the target lies to the source, where features don't say it.
#pragma once

#include <limits>
#include <span>
#include <vector>

#include "pointmorph/coarse_shape.hpp"
#include "pointmorph/extremities.hpp"
#include "pointmorph/progress.hpp"
#include "pointmorph/registration.hpp"
#include "pointmorph/similarity.hpp"
#include "pointmorph/types.hpp"

namespace pointmorph {

struct PoseOptions {
    /// Spreads along two axes that are taken for one another differ by no more than this factor;
    /// 1 or more.
    double spread_ratio = 1.8;
    /// A pose is dropped when it leaves the features further apart than the best one does by this
    /// much, root mean square, in √area.
    double feature_distance = 0.3;
    /// So many of the best poses are tried in earnest.
    Index finalists = 3;
    /// Two maps are distinct when their images lie further apart than this in √area: the mean, or
    /// .35 times the mean of the worst 3 % where that is more (a limb).
    double distinct = 0.08;
    Index points = 1000;  ///< of each shape in a trial, the nodes among them
    double swing = 0.44;  ///< turns about each axis that the best pose is tried with; radians
    ExtremityOptions extremities;
    /// The pose in which the shapes were given wins where its energy is within this factor of the
    /// best one's: where shape alone can hardly tell, the user has. 1 or more.
    double as_given = 1.1;
    Index variants = 6;  ///< ways to pair the tips that the two best maps are tried with
    /// The quick trial of every pose, on the coarsest level.
    RegistrationLevel trial{3, 10, 10.0, 1.5, 1, 2, 1, 700, 0};
};

struct Pose {
    /// Turns and moves the target to where the registration has it.
    Similarity alignment;
    /// Of the coarsest level, for the target moved by `alignment`.
    Registration registration;
    /// See registration_energy().
    double energy = 0.0;
    /// Energy of the best distinct map over that of this one, 1 or more: near 1, the shapes fit
    /// another way just as well. Infinite where no other was found.
    double margin = std::numeric_limits<double>::infinity();
};

/// Rotations (and shifts) of the target onto the source, both of unit area: the 24 that take
/// principal axes to principal axes, as far as the spreads along them agree, and the least turn or
/// best fit by two or more features. None that contradicts the features. At least one.
std::vector<Similarity> candidate_poses(const CoarseShape& source, const CoarseShape& target,
                                        std::span<const IndexPair> features,
                                        const PoseOptions& options);

/// Registers from every candidate, on the coarsest level, and keeps the one that bends the shapes
/// least for how well it brings them together; in doubt, that in which they were given.
Pose find_pose(const CoarseShape& source, const CoarseShape& target,
               std::span<const IndexPair> features, const PoseOptions& options,
               const RegistrationOptions& registration, Progress& progress);

/// A coarse shape turned and moved; `move.scale` is 1.
CoarseShape moved(const CoarseShape& shape, const Similarity& move);

}  // namespace pointmorph

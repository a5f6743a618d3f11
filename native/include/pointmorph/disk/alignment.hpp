// Stage `alignment`: two disks whose features coincide (paper, Feature Alignment, eq. (4)).
#pragma once

#include <optional>
#include <span>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

struct AlignmentOptions {
    /// Features must end closer than this, in units of the disks' local point spacing at the
    /// feature (limbs shrink to specks, where any absolute distance is a whole foot); 1e-6 to 1.
    double error = 1e-3;
    /// Radius of influence d of a feature as a multiple of the largest distance ‖p‖ that it has
    /// had to go; above 0.5, the paper's condition for a one-to-one warp, to 1000. Larger is
    /// smoother: the paper shows 2, 5 and 8.
    double influence = 8.0;
    /// The same as a distance in the disk instead of a multiple; above 0, to 2.
    std::optional<double> influence_radius;
    /// Alternate warps of both disks at the most; 1 or more.
    Index max_sweeps = 1000;
};

struct Alignment {
    double rotation = 0.0;  ///< of the source disk, radians, anticlockwise
    Index sweeps = 0;       ///< alternate warps of both disks
    double residual = 0.0;  ///< largest distance between two features, in local spacings
};

/// The rotation of the source disk, radians, that minimizes Σ ‖u¹ − u²‖² over the features (closed
/// form). 0 where all rotations are equally good, for instance without features.
double best_rotation(const DiskPoints& source, const DiskPoints& target,
                     std::span<const IndexPair> features);

/// Rotates `source` (unless `keep_rotation`: pinned boundary features have fixed it), then warps
/// both disks alternately by eq. (4) until the error is met. `features` are pairs of rows.
///
/// The map of either disk is one-to-one: every step is at most d/4 long, and d is at most the
/// feature's distance to the circle, so that points of the circle stay where the rotation has put
/// them and no point leaves the disk. Features whose discs of influence overlap so that they push
/// one another away get a smaller d.
///
/// Throws OptionError; FeatureError for features that can't meet (two on one point of one disk but
/// not of the other, one on the circle and not at the same place there in the other);
/// ConvergenceError. The disks are left as they were then.
Alignment align_features(DiskPoints& source, DiskPoints& target,
                         std::span<const IndexPair> features, bool keep_rotation,
                         const AlignmentOptions& options, Progress& progress);

}  // namespace pointmorph

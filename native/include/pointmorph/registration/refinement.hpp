// Stage `refinement`: two clouds and their features → two smooth maps, each the other's inverse as
// far as the shapes allow. Past the paper: nearly rigid, both ways at once, matched in the product
// space.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/diagnostics.hpp"
#include "pointmorph/registration/pose.hpp"
#include "pointmorph/registration/product_space.hpp"
#include "pointmorph/registration/registration.hpp"
#include "pointmorph/registration/restarts.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

struct RefinementOptions {
    CoarseShapeOptions coarse;
    RegistrationOptions registration;
    RestartOptions restarts;
    PoseOptions pose;
    /// With so many features or more they alone say how the target lies to the source; with fewer,
    /// other poses are tried. 3 or more.
    Index features_that_fix_the_pose = 8;
    /// In √area; see refine().
    double trusted_distance = 0.3;
    /// Below this the user is told what may be wrong and which mark would settle it; 0 to 1.
    double clear_confidence = 0.9;
    /// Propose features even where the pose was known.
    bool propose = false;
    Index other_proposals = 4;  ///< places between the extremities that are proposed too
    /// Weight of unit normals against lengths (in √area) in the last matching of a cloud of 10,000
    /// points; falls with the spacing of larger ones. 0 to 1.
    double normal_weight = 0.02;
};

/// Maps to start from instead of features and poses: an image for every point of both clouds, in
/// the other cloud's coordinates. #source by 3 and #target by 3. An earlier result, before a
/// feature was added or moved, say.
struct RefinementStart {
    Positions source_images, target_images;
};

struct Refinement {
    /// Where every point goes on the other surface: not snapped to its samples, in the other
    /// cloud's own coordinates. #source by 3 and #target by 3.
    Positions source_images, target_images;
    /// Takes the target to where the source is, as it was aligned before anything bent.
    Similarity alignment;
    /// The nearest both ways in the product space, features apart; every point is in a pair.
    Pairing pairs;
    /// Both clouds in that space, as pair_points() and mutual_pairs() want them.
    ProductPoints source_product, target_product;
    /// Rows of the clouds.
    Diagnostics diagnostics;
    /// Normals of the two clouds face opposite sides; the target's were taken the other way round.
    bool inside_out = false;
};

/// A cloud as refine() takes it. Refers to all of it: the caller keeps it alive.
struct RefinementCloud {
    const Positions& positions;  ///< #points by 3
    /// #points by 3, of unit length; they face outward, on both clouds or on neither.
    const Normals& normals;
    /// The points' neighborhoods, ascending by distance, where they have been found already.
    /// Equally near points then come in another order than those that are looked up here, and the
    /// result differs by rounding.
    const Neighborhoods* nearest = nullptr;
    /// Rows along borders where the surface ends that goes on in the other cloud.
    std::span<const Index> ends{};
    /// Both clouds are scaled as if they had area 1. This one's, where it isn't estimated: it has
    /// something more than the other, and is as large as that elsewhere.
    double area = 0.0;
};

/// `features` are valid for the clouds and in canonical() order. The maps take hard points and the
/// ends of hard curves exactly onto each other, hard curves to a fraction of a spacing, and no
/// point of a hard region out of it; soft ones are brought as near as their weight against the
/// rest can. With fewer than `features_that_fix_the_pose` points, counting those of curves and a
/// region as one unless all lie on a line, or none, the clouds may lie in any orientation. `start`,
/// where there is one, is pulled to the features and replaces the search for the pose; it isn't
/// used where it leaves a feature farther from its partner than `trusted_distance`: such a map has
/// legs or ends exchanged. Clouds have no order or scale to keep to; the result rotates, scales and
/// moves with them.
Refinement refine(const RefinementCloud& source, const RefinementCloud& target,
                  std::span<const Feature> features, const RefinementOptions& options,
                  Progress& progress, const RefinementStart* start = nullptr);

}  // namespace pointmorph

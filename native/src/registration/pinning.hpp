// Images moved so that marks meet, with everything around them. Not for callers of the library.
#pragma once

#include <functional>
#include <span>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/registration/coarse_shape.hpp"

namespace pointmorph {

/// Rows or places of one shape, and of the other, where images of these should come to lie.
struct MarkedRows {
    std::span<const IndexPair> pairs;
    Index IndexPair::*here;
    Index IndexPair::*there;
};

/// Farthest that the image of a mark lies from its partner. `images` are those of the points here,
/// `other` the positions there.
double largest_offset(const Positions& images, const Positions& other, const MarkedRows& marks);

/// Images of coarse points so moved that features and guides come to lie near their partners, with
/// everything around: offsets averaged with Gaussian weights that fall with the distance (Shepard's
/// method, fading out).
Positions pulled_to_marks(Positions images, const CoarseShape& shape, const CoarseShape& other,
                          const MarkedRows& features);

/// Images of points at `positions` so moved that those of the marks lie on their partners at
/// `other`, and those around smoothly with them: by (1 − (d/r)²)² of the offset within r, some
/// spacings.
Positions pinned_to_marks(Positions images, const Positions& positions, const Positions& other,
                          const MarkedRows& marks, double spacing);

/// A surface whose points have images. Refers to all of it: the caller keeps it alive.
struct ImagedSurface {
    const KdTree<3>& tree;
    const Normals& normals;
    double spacing;
    /// How the surroundings of a row have rotated and grown.
    std::function<Matrix3(Index)> linear;
};

/// Images so moved that those of a curve's places (`own`) lie on the other's (`other`, as many),
/// and those around smoothly with them, in ever smaller surroundings: what lies beside the curve a
/// little later, the curve itself to the last.
Positions pinned_to_curve(Positions images, const ImagedSurface& surface, const OrientedView& own,
                          const Positions& other, Progress& progress);

/// Images of a region's points that lie outside of the partner put onto its nearest point.
/// `members` and `other_members` say how much points belong to the region.
Positions clamped_to_region(Positions images, const Values& members, const KdTree<3>& other,
                            const Values& other_members);

}  // namespace pointmorph

// Stage `anchored_start`: a first map between two shapes, from distances along the surface.
#pragma once

#include <span>

#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/registration.hpp"

namespace pointmorph {

/// Three are often all on the middle (nose, back, tail), from where left and right are equally far.
constexpr std::size_t kFewestAnchors = 4;

/// Takes every point to the place that lies as far from each anchor along the surface as it does,
/// each distance over the mean of those from that anchor to the others. So bending doesn't matter
/// (Elad and Kimmel, On bending invariant signatures for surfaces, 2003), nor how the shapes lie in
/// space, and proportions not much. The two sides of a limb come to lie on its axis.
/// `distances` are node_distances() of both shapes; `anchors` are nodes of the coarsest level that
/// belong together, `kFewestAnchors` or more.
RegistrationStart anchored_start(const CoarseShape& source, const CoarseShape& target,
                                 const NodeDistances& distances,
                                 std::span<const IndexPair> anchors);

}  // namespace pointmorph

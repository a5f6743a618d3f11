// A first map between two shapes that have little in common, from where they lie in space. Not a
// part of the library.
#pragma once

#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/registration.hpp"

namespace pointmorph {

/// Takes every point to where the cheapest way of moving one shape's nodes onto all of the other's
/// has them go: squared distances count, and how far normals point away from each other. So all of
/// the other shape is covered, whatever the two have in common (optimal transport; Solomon et al.,
/// *Convolutional Wasserstein distances*, 2015, morph shapes that way).
RegistrationStart transported_start(const CoarseShape& source, const CoarseShape& target);

}  // namespace pointmorph

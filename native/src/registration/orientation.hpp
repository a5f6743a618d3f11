// Whether two shapes show their outsides alike. Not for callers of the library.
#pragma once

#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"

namespace pointmorph {

/// Whether the normals of one shape face outward and those of the other inward: told from the
/// volumes where both shapes enclose one, else from how the normals agree when the source's points
/// are at `start`, on the target.
bool is_inside_out(const CoarseShape& source, const CoarseShape& target, const Positions& start);

/// Volume that the oriented points enclose, if they do; below 0 where they face inward.
double signed_volume(const CoarseShape& shape);

/// Mean agreement of the normals of source points, where they start, with the nearest target
/// points': about 1 for the same shape, below 0 where one is inside out.
double normal_agreement(const CoarseShape& source, const CoarseShape& target,
                        const Positions& start);

}  // namespace pointmorph

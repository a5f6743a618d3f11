// A cloud with what the stages need to know about the surface that it samples.
#pragma once

#include <string>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// Refers to all of it: the caller keeps it alive.
struct SampledSurface {
    const Positions& positions;    ///< #points by 3
    const Normals& normals;        ///< #points by 3, unit length; outward unless a stage says else
    const Neighborhoods& nearest;  ///< ascending by distance, 12 or more a point
    std::string name = "cloud";    ///< as the user knows it; errors quote it

    Index size() const { return to_index(positions.rows()); }
};

}  // namespace pointmorph

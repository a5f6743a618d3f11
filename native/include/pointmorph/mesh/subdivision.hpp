// Stage `subdivision`: more triangles where a mesh has long edges.
#pragma once

#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

struct SubdivisionOptions {
    double longest = 0.04;       ///< edges longer than this are halved; in √area
    Index most_places = 100000;  ///< it ends before there are more
};

/// The same surface, with every edge halved that is too long, again and again: no gaps open, and
/// triangles keep their shape or are cut in two or three. The first places are those of `mesh`, and
/// `places` its own.
Mesh subdivided(const Mesh& mesh, const SubdivisionOptions& options);

}  // namespace pointmorph

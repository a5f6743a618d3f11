// A wrapped mesh that slides along the surface until its faces are more like the source's. Not for
// callers of the library.
#pragma once

#include <functional>
#include <utility>
#include <vector>

#include "mesh/elastic_sheet.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

/// What the mesh slides along. Lengths are those of `x` in relax().
struct RelaxGround {
    std::vector<char> is_fixed;  ///< of each vertex: whether it stays, to the bit
    /// Where a place that faces so would lie on the surface, and the surface's normal there.
    std::function<std::pair<Vector3, Vector3>(Index vertex, const Vector3& place,
                                              const Vector3& normal)>
        landed;
    Normals sides;        ///< of the surface where each vertex is, unit rows
    bool is_onto = true;  ///< whether vertices go onto it; else each keeps its way to it
};

/// So many times, every vertex goes half of the way to where the sheet, laid into the tangent
/// planes, would have it for the vertices around it, in its tangent plane, and then along the
/// normal back to the surface. It stays where it was if a face around it would turn away from the
/// surface, lose three quarters of its area or get another crease. The sheet's metric is that of
/// before, averaged over so many rings.
void relax(const Mesh& mesh, ElasticSheet& sheet, const RelaxGround& ground, Index iterations,
           Positions& x, Progress& progress);

}  // namespace pointmorph

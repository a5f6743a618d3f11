// Creases of a wrapped mesh, smoothed with what is around them. Not for callers of the library.
#pragma once

#include <functional>
#include <vector>

#include "mesh/creases.hpp"
#include "mesh/elastic_sheet.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/mesh/closest_point.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

/// What places are put onto. Lengths are those of `x` in mend().
struct MendTarget {
    /// Where a place that faces so would lie on the surface.
    std::function<Vector3(Index vertex, const Vector3& place, const Vector3& normal)> landed;
    Positions samples;       ///< of the surface, evenly spread
    double reach = 0.008;    ///< as far from the faces, samples may be: nothing is taken away there
    double farthest = 0.02;  ///< no vertex is moved by more at once
};

/// The vertices around creased faces become a membrane between those farther off, put onto the
/// surface: in patches of one or two rings of faces, each only if it then has fewer such edges, and
/// covers the surface as before. Larger patches would take small features away, such as lips.
/// `tree` is one of the mesh's triangles, at `x`. Fixed vertices stay.
void mend(const Mesh& mesh, const ElasticSheet& sheet, const MendTarget& target,
          const std::vector<char>& is_fixed, TriangleTree& tree, Positions& x, Progress& progress);

}  // namespace pointmorph

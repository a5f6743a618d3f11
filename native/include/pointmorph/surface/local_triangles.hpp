// Stage `local_triangles`: which three points of a cloud lie around one place of its surface.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// Three rows, ascending.
using Triangle = std::array<Index, 3>;

/// Every point's neighbors are laid into its tangent plane and triangulated around it (Delaunay);
/// a triangle that any of its corners finds is one. Sorted, none twice. They cover the surface, but
/// where points see their surroundings differently they may overlap: no mesh.
///
/// `normals` have unit length; `nearest` is ascending by distance, 16 are enough, the first 60
/// count at the most, and of these only neighbors on the same sheet. No triangle has a circle
/// through its corners of more than `reach` times a corner's `spacing`: holes and borders stay
/// open.
std::vector<Triangle> local_triangles(const Positions& positions, const Normals& normals,
                                      const Neighborhoods& nearest, const Values& spacing,
                                      double reach, Progress& progress);

/// In a list of triangles, one that doesn't count.
inline constexpr Triangle kNoTriangle = {-1, -1, -1};

/// Triangles whose first corner is the lowest, of so many rows, without those that don't count:
/// ascending, each once. By counting, as few have the same lowest corner.
std::vector<Triangle> sorted_once(std::span<const Triangle> triangles, Index rows,
                                  Progress& progress);

}  // namespace pointmorph

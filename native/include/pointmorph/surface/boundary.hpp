// Stage `boundary`: the ordered boundary of an open patch (paper: "by the methods proposed by
// Floater or by user interaction").
//
// Floater and Reimers (2001) find boundary points and order them with local triangulations of each
// point's neighborhood. So does this: every point gets its Delaunay star in the tangent plane.
// Discs that are empty of points and much larger than usual lie outside of the surface; from there
// the outside is followed inward, triangle by triangle, as long as they are larger than usual.
// What it leaves is the surface, and the edges between both are the boundary.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

struct BoundaryOptions {
    /// A disc without points lies outside when its radius, in spacings of the points that it
    /// touches, is this many times that of the cloud's larger interior discs; 1.2 to 10. Smaller
    /// finds smaller holes, and takes gaps in the sampling for holes.
    double opening = 2.4;
    /// Loops shorter than this many local spacings are taken for gaps in the sampling; 4 or more.
    double min_loop = 10.0;
};

/// A closed sequence of rows: each point once, the first follows the last. Anticlockwise seen
/// from outside: the surface lies on the left when one walks along it with the normal up.
using BoundaryLoop = std::vector<Index>;

/// All boundary loops of the cloud, longest first, each from its lowest row; none on a closed
/// surface. `normals` are unit length and agree in sign; `nearest` is ascending by distance, 12 or
/// more neighbors. Of points that coincide, the lowest row stands for all. Where the spacing
/// varies from place to place as in the vertices of a mesh, a gap in a flat region (the sole of a
/// foot) counts as surface, since meshes have few vertices there; among random samples, a hole in a
/// flat region counts from 1.75 · `min_loop` on, or where a gap so large can't be chance.
std::vector<BoundaryLoop> find_boundary_loops(const Positions& positions, const Normals& normals,
                                              const Neighborhoods& nearest,
                                              const BoundaryOptions& options, Progress& progress);

/// Checks a loop that the caller gave (rows in range, at least three, none twice) and turns it
/// anticlockwise; its first row stays the first. `name` is the cloud's, for errors. Throws
/// FeatureError.
BoundaryLoop oriented_loop(const Positions& positions, const Normals& normals,
                           const Neighborhoods& nearest, BoundaryLoop loop,
                           const std::string& name);

/// Whether a surface that ends along borders so long goes on in one with borders so long (lengths
/// over √area): the other has hardly any.
constexpr bool goes_on(double borders, double others_borders) {
    constexpr double kHardlyAny = 0.3, kPinhole = 0.05;
    return borders > kPinhole && others_borders <= kHardlyAny * borders;
}

/// Length of the closed polygon.
double loop_length(const Positions& positions, std::span<const Index> loop);

}  // namespace pointmorph

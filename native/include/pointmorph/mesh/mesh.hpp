// Stage `mesh`: the faces of a shape as one surface of triangles, with what is connected, its
// borders and which way it faces.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

/// #triangles by 3 rows of some positions, anticlockwise seen from outside.
using Triangles = Eigen::Matrix<Index, Eigen::Dynamic, 3, Eigen::RowMajor>;

/// A *vertex* is a row of the cloud, a *place* one of this surface: vertices at the very same place
/// share it, or where the surface ends but for rounding, so that seams and what importers leave
/// behind are closed. Lengths are those of the unit ball; see `unit`.
struct Mesh {
    Normalization unit;         ///< takes the vertices to where the places are
    Positions positions;        ///< #places by 3
    std::vector<Index> places;  ///< #vertices: the place of each
    Triangles triangles;        ///< rows of `positions`, each with an area
    /// Of meshes of clouds: the polygon that each triangle is a piece of, and its corners as rows
    /// of the cloud, where several may share a place.
    std::vector<Index> polygons;
    Triangles vertices{0, 3};
    Normals normals;           ///< #triangles by 3, unit length
    Values areas;              ///< #triangles
    Normals place_normals;     ///< #places by 3, unit length: the mean around, by angle
    std::vector<Index> parts;  ///< #places: the connected part of each, the largest area first
    Values part_areas;         ///< #parts with an area; places without triangles are in none (−1)
    /// Closed sequences of places along which the surface ends, longest first; see BoundaryLoop.
    std::vector<std::vector<Index>> borders;
    Index parts_turned = 0;  ///< so many showed their inside, and were reversed

    double area() const { return areas.sum(); }
};

/// The surface of the cloud's faces. Polygons are cut into triangles where that bends and narrows
/// them least, also where they aren't convex. Faces that lie against their neighbors are turned to
/// agree with the larger part of what they are connected to over edges of two faces; closed parts
/// with a negative volume are reversed, unless they lie within another one, and with the largest
/// one all that is open. Faces with fewer than three places,
/// or without an area, are left out: there may be no triangles at all. `cloud` is valid; see
/// validate().
Mesh make_mesh(const Cloud& cloud, Progress& progress);
Mesh make_mesh(const Cloud& cloud);

/// The surface of given triangles as they are: parts, borders, normals. `places`, `polygons` and
/// `vertices` stay empty.
/// Triangles have an area.
Mesh mesh_of(const Normalization& unit, Positions positions, Triangles triangles);

/// Length of all borders, over √area.
double border_length(const Mesh& mesh);

/// Corners of triangles that cover one polygon with `corners`, rows of `positions`: the best ear
/// is cut off again and again (Meisters, Polygons Have Ears, 1975).
std::vector<std::array<Index, 3>> triangulate(const Positions& positions,
                                              std::span<const Index> corners, Progress& progress);

/// The same of many polygons, one after the other, as rows of `faces.corners`; none of a polygon
/// with fewer than three.
Triangles triangle_corners(const Positions& positions, const Polygons& faces, Progress& progress);

}  // namespace pointmorph

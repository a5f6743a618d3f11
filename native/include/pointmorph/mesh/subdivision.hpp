// Stage `subdivision`: more triangles where a mesh has long edges.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

struct SubdivisionOptions {
    double longest = 0.04;       ///< edges longer than this are halved; in √area
    Index most_places = 100000;  ///< it ends before there are more
};

/// A triangle of another one: its corners are corners of that (0 to 2), or the middles of its sides
/// (3 to 5: of the side from corner k − 3 to the next).
struct Piece {
    Index triangle;
    std::array<Index, 3> corners;
};

/// The pieces of triangles whose sides are halved where `middles` (#triangles by 3, of the side
/// from corner k to the next) isn't −1. Both triangles at an edge have the same there.
std::vector<Piece> pieces_of(const Positions& positions, const Triangles& triangles,
                             const Triangles& middles);

/// The triangles of pieces.
Triangles triangles_of(std::span<const Piece> pieces, const Triangles& corners,
                       const Triangles& middles);

/// The places at both ends of an edge.
using EdgeEnds = std::array<Index, 2>;

/// A mesh with more places. The first are those of the mesh that it came from, and `places` its
/// own.
struct Subdivision {
    Mesh mesh;
    std::vector<EdgeEnds> ends;  ///< of the edge that each further place is in the middle of
};

/// Values at all places of a subdivision from values at those of the mesh that it came from, one
/// row a place.
template <class Array>
Array extended(const Array& values, std::span<const EdgeEnds> ends) {
    Array result(values.rows() + static_cast<Eigen::Index>(ends.size()), values.cols());
    result.topRows(values.rows()) = values;
    for (std::size_t k = 0; k < ends.size(); ++k)
        result.row(values.rows() + static_cast<Eigen::Index>(k)) =
            0.5 * (result.row(ends[k][0]) + result.row(ends[k][1]));
    return result;
}

/// Whether there is an edge that subdivided() would halve.
bool has_long_edges(const Mesh& mesh, const SubdivisionOptions& options);

/// The same surface, with every edge halved that is too long, again and again: no gaps open, and
/// triangles keep their shape or are cut in two or three.
Subdivision subdivided(const Mesh& mesh, const SubdivisionOptions& options);

}  // namespace pointmorph

// A mesh with more triangles where the surface that it is wrapped onto has what it can't show.
#pragma once

#include <array>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

struct DensityOptions {
    /// Faces that lie farther than this from the other shape, or it from them, are cut; in √area.
    double tolerance = 0.002;
    Index most_vertices = 200000;  ///< about; it ends before there are more
    Index rounds = 2;              ///< of cutting and wrapping anew
};

/// The vertices of the mesh come first, in order; then those in the middle of its edges, of the
/// halves of these and so on. No vertex lies in the middle of a triangle's side. Vertices that
/// share a place, as along seams, still do.
struct DenserMesh {
    Triangles faces{0, 3};                   ///< rows of vertices
    std::vector<Index> polygons;             ///< the face of the mesh that each is a piece of
    std::vector<std::array<Index, 2>> ends;  ///< of each further vertex: the two it is halfway of
    Positions positions;                     ///< where all vertices end on the other shape
};

}  // namespace pointmorph

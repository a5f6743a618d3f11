// Which way the faces of a mesh show. Not for callers of the library.
#pragma once

#include "mesh/mesh_edges.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

/// Turns triangles so that neighbors over edges of two triangles agree, most of the area as given.
/// Wants the areas. Returns whether any had to be turned.
bool make_agree(const MeshEdges& edges, Mesh& mesh);

/// Turns closed parts whose faces show their inside, counted in `parts_turned`. Those that lie
/// within another closed one, as cavities do, go with that one; open and thin ones, which tell
/// nothing themselves, go with the largest part. Of a surface that is there twice, back to back,
/// both go together. Wants the areas and parts. Returns whether any was turned; throws Cancelled.
bool turn_outward(const MeshEdges& edges, Mesh& mesh, Progress& progress);

}  // namespace pointmorph

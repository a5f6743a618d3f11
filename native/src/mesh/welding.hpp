// Which vertices of a mesh share a place: those along seams do, and those of parts that only touch
// don't. Not for callers of the library.
#pragma once

#include "mesh/mesh_edges.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

/// Gives each vertex a place, in the order of the vertices: one for all at the very same spot.
void weld(const Positions& vertices, Mesh& mesh);

/// Joins places where the surface ends and that differ only by rounding, as exporters and
/// transforms leave them along seams: by less than 1e-5 in the unit ball, and a twentieth of the
/// edges there. Of several, the first stands for all. `mesh` is that of weld() with triangles,
/// which are to be taken anew where the result is true. Throws Cancelled; no fraction is said.
bool close_rounded_seams(const MeshEdges& edges, Mesh& mesh, Progress& progress);

/// Gives vertices at one spot places of their own again where no edge joins the faces around them.
/// `mesh` is that of weld() with triangles. Edges join the two triangles that a vertex pair has, or
/// two that have nothing else there; of more that have nothing else, those that enclose an inside
/// between them. Vertices without triangles go with another corner of their face there, or else
/// with the first vertex at the spot. Returns whether it has. Throws Cancelled; no fraction is
/// said.
bool part_what_touches(const Polygons& faces, const MeshEdges& edges, Mesh& mesh,
                       Progress& progress);

}  // namespace pointmorph

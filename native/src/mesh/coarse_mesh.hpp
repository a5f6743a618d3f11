// Meshes of fewer triangles for the long lengths of a large one. Not for callers of the library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

/// Some places of a mesh and triangles between them; its own `places` stay empty.
struct CoarseMesh {
    Mesh mesh;
    std::vector<Index> rows;  ///< of the fine mesh's places: its own, ascending
};

/// A mesh for each of the counts: about so many evenly spread places, `kept` among them (rows, each
/// once, ascending). Every other place belongs to the one that is nearest along the edges, and a
/// triangle whose corners belong to three different places is a triangle between these: what was
/// connected stays connected.
std::vector<CoarseMesh> coarse_meshes(const Mesh& fine, std::span<const Index> counts,
                                      std::span<const Index> kept, Progress& progress);

}  // namespace pointmorph

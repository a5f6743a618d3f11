// Faces around some faces of a mesh, to be moved by themselves. Not for callers of the library.
#pragma once

#include <vector>

#include "mesh/elastic_sheet.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

/// Some faces and the vertices among them that may move, both ascending.
struct MeshPatch {
    std::vector<Index> faces;
    std::vector<Index> vertices;
};

/// The faces within so many `rings` of those given, connected ones together. Vertices move whose
/// faces are all in the patch, unless they are fixed.
std::vector<MeshPatch> patches_around(const Mesh& mesh, const ElasticSheet& sheet,
                                      const std::vector<Index>& faces,
                                      const std::vector<char>& is_fixed, int rings);

}  // namespace pointmorph

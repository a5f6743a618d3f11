// The mesh of one shape of a morph, wrapped onto the other. Not for callers of the library.
#pragma once

#include <span>

#include "morph/mesh_side.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/mesh/wrapping.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

/// One shape as the other's target. `images` are those of its samples (of a bare cloud, of its
/// points) on the mesh.
struct WrapSide {
    const Cloud& cloud;
    const MeshSide* mesh;  ///< null for a bare cloud
    const Positions& images;
};

/// The mesh that is wrapped, and where the map takes its samples and its vertices.
struct WrapSource {
    const MeshSide& mesh;
    const Positions& sample_images;
    const Positions& images;
};

/// Where the vertices of the source end on the target; of a mesh with long edges, as vertices of
/// the same mesh with more. `pinned`: rows of vertices with rows of the target, which end there to
/// the bit.
Positions wrapped_vertices(const WrapSource& source, const WrapSide& target,
                           std::span<const IndexPair> pinned, const WrapOptions& options,
                           Progress& progress);

}  // namespace pointmorph

// The mesh of one shape of a morph, wrapped onto the other. Not for callers of the library.
#pragma once

#include <span>
#include <vector>

#include "morph/mesh_side.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/mesh/subdivision.hpp"
#include "pointmorph/mesh/wrapping.hpp"
#include "pointmorph/morph/denser_mesh.hpp"
#include "pointmorph/morph/morph.hpp"
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
    const Cloud& cloud;
    const VertexHolds& holds;
    const MeshSide& mesh;
    const Positions& sample_images;
    const Positions& images;
    /// Whether the mesh is left as it is where the other goes on beyond its border.
    bool leaves_missing = true;
};

/// Whether the vertices start as the target's own mesh, which is then what they end as.
bool is_same_mesh(const WrapSource& source, const WrapSide& target);

/// A shape's mesh, to be wrapped onto the other shape. Refers to what it is made of.
class WrapOnto {
public:
    /// `pinned`: rows of vertices with rows of the target, which end there to the bit.
    WrapOnto(const WrapSource& source, const WrapSide& target, std::span<const IndexPair> pinned,
             Progress& progress);

    /// In lengths of the unit ball.
    const WrapTarget& target() const { return target_; }

    /// Where the places of the shape's mesh end, in these lengths. `mesh` may have more places, as
    /// in Subdivision.
    Positions wrapped(const Mesh& mesh, std::span<const EdgeEnds> ends, const WrapOptions& options,
                      Progress& progress);

    /// Places of vertices in the target's own lengths; those that are pinned or fixed exactly.
    Positions restored(const Positions& vertices) const;

private:
    const WrapSource source_;
    const WrapSide other_;
    std::span<const IndexPair> pinned_;
    Normalization unit_;
    WrapTarget target_;
};

/// The mesh with more triangles where the target has what it can't show.
DenserMesh denser_mesh(const WrapSource& source, const WrapSide& target,
                       std::span<const IndexPair> pinned, const WrapOptions& wrapping,
                       const DensityOptions& options, Progress& progress);

/// Where the vertices of the source end on the target; of a mesh with long edges, as vertices of
/// the same mesh with more. `holds` are kept to. `pinned`: rows of vertices with rows of the
/// target, which end there to the bit.
Positions wrapped_vertices(const WrapSource& source, const WrapSide& target,
                           std::span<const IndexPair> pinned, const WrapOptions& options,
                           Progress& progress);

/// A side whose mesh is wrapped, and the other one.
struct Morph::WrappedSides {
    WrapSource source;
    WrapSide target;
    std::vector<IndexPair> pinned;
};

}  // namespace pointmorph

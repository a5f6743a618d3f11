// A shape of a morph that has faces: what stands for it while the map is found, and how its
// vertices get theirs. Not for callers of the library.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/mesh/mesh.hpp"
#include "pointmorph/mesh/mesh_samples.hpp"
#include "pointmorph/mesh/vertex_images.hpp"
#include "pointmorph/morph/morph_input.hpp"
#include "pointmorph/morph/morph_options.hpp"
#include "pointmorph/surface/boundary.hpp"
#include "pointmorph/surface/features.hpp"
#include "pointmorph/surface/pairing.hpp"

namespace pointmorph {

/// Made once, const afterward.
class MeshSide {
public:
    /// `features` in rows of the cloud; those of `side` are among the samples. The cloud's faces
    /// have an area.
    MeshSide(const Cloud& cloud, Mesh mesh, std::span<const Feature> features,
             Marked Feature::*side, Progress& progress);

    const Mesh& mesh() const { return mesh_; }
    const MeshSamples& samples() const { return samples_; }
    /// Of the samples, in the cloud's lengths.
    double spacing() const { return mesh_.unit.scale * spacing_; }

    /// The samples, with normals, in the cloud's lengths.
    Cloud sampled(const Cloud& cloud) const;
    /// What a feature marks, in rows of the samples. Curves lose vertices that are closer together
    /// than samples are; a region has all samples between its vertices.
    Marked sampled(const Feature& feature, const Marked& marked) const;
    /// Values at the samples from values at the vertices.
    Positions sampled(const Positions& at_vertices) const;

    /// The vertex next to each sample.
    std::vector<Index> vertices_of_samples() const;
    /// The sample next to each vertex.
    std::vector<Index> samples_of_vertices() const;
    /// #vertices by 3, from images of the samples.
    Positions images(const Positions& of_samples, Progress& progress) const;
    SampleValues values(const SampleValues& of_samples, Progress& progress) const;

    /// The cloud with the normals and radii that it lacked, from the faces, and with given normals
    /// reversed where they showed the inside.
    Cloud completed(Cloud cloud) const;

private:
    void find_marks(std::span<const Feature> features, Marked Feature::*side);
    /// Reverses those of parts where they are against the faces' `normals` (#vertices by 3).
    void reverse_against(const Normals& normals, Normals& given) const;
    std::vector<Index> thinned(const Feature& curve, const Marked& marked) const;
    Index row_of(Index vertex) const;

    Mesh mesh_;
    std::vector<Index> kept_;  ///< places, ascending
    MeshSamples samples_;
    Positions kept_positions_;             ///< of the samples at kept places, as they were given
    std::optional<VertexImages> carried_;  ///< rows are places
    std::vector<Index> vertices_;          ///< the first vertex at each place
    double spacing_ = 0.0;                 ///< of the samples, in lengths of the mesh
};

/// Whether the map is found on samples of the cloud's faces. The paper's method knows points only.
bool is_sampled(const Cloud& cloud, const MorphOptions& options);

/// None where the options, or faces without an area, leave the points as they are. `features` in
/// rows of the cloud.
std::optional<MeshSide> mesh_side(const Cloud& cloud, std::span<const Feature> features,
                                  Marked Feature::*side, const MorphOptions& options,
                                  Progress& progress);

/// The sides that have faces, and the morph of their samples.
struct MeshSides {
    std::optional<MeshSide> source, target;

    bool any() const { return source || target; }
};

/// Of both shapes; see mesh_side().
MeshSides mesh_sides(const MorphInput& input, const MorphOptions& options, Progress& progress);

/// What is left of the morph of the samples once the vertices have been carried.
struct MeshMorph {
    std::shared_ptr<const MeshSides> shared_sides;  ///< with the morphs of the same meshes
    Positions source_images, target_images;         ///< of samples; of the points of bare clouds
    VertexHolds source_holds, target_holds;

    const MeshSides& sides() const { return *shared_sides; }
};

/// The input for a morph of the samples; of bare clouds as they are.
MorphInput sampled_input(const MorphInput& input, const MeshSides& sides);

/// Rows of vertices along a boundary that has rows of samples, each once.
BoundaryLoop rows_along(std::span<const Index> vertices_of_samples, const BoundaryLoop& boundary);

/// Vertices of both shapes in the product space.
struct ProductView {
    const SampleValues& source;
    const SampleValues& target;
};
/// The nearest both ways; of hard regions, inside of their partners. `pinned` go apart.
Pairing pairs_in_domain(const ProductView& points, std::span<const Feature> features,
                        std::span<const IndexPair> pinned, Progress& progress);

/// What to tell the user of faces that were reversed.
std::vector<std::string> turned_faces(const MorphInput& input, const MeshSides& sides);

}  // namespace pointmorph

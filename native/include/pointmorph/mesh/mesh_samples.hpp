// Stage `mesh_samples`: points spread evenly over the faces of a mesh, whose vertices may lie as
// they like.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

struct MeshSampleOptions {
    /// Samples; 0: as many as the mesh has detail for, see sample_count().
    Index count = 0;
    /// Parts with less of the area get this many all the same, as long as they are few.
    Index least_per_part = 64;
    /// Vertices whose normal is farther from that of a face, in degrees, lie on a crease there: the
    /// samples of the face take its own.
    double crease = 40.0;
    /// Else random points, each in a share of the area of its own: many are made at once.
    bool even = true;
};

/// Rows of `positions` and all others: samples. Lengths are those of the mesh.
struct MeshSamples {
    Positions positions;           ///< #samples by 3
    Normals normals;               ///< #samples by 3, unit length; smooth but at creases
    std::vector<Index> triangles;  ///< the triangle of each
    Positions weights;             ///< of its three corners, ≥ 0, sum 1
    std::vector<Index> parts;      ///< the part of each
    std::vector<Index> border;     ///< the longest border, in order; empty where there is none
    std::vector<Index> kept;       ///< the sample at each place that was to be kept

    Index size() const { return to_index(positions.rows()); }

    /// Values at the samples from values at the places (or at the vertices, through
    /// Mesh::places), one row a place.
    template <class Array>
    Array mixed(const Mesh& mesh, const Array& values) const {
        Array result(positions.rows(), values.cols());
        for (Index i = 0; i < size(); ++i) {
            const auto corners = mesh.triangles.row(triangles[to_size(i)]);
            result.row(i) = weights(i, 0) * values.row(corners[0]) +
                            weights(i, 1) * values.row(corners[1]) +
                            weights(i, 2) * values.row(corners[2]);
        }
        return result;
    }
};

/// 3,000 to 12,000, eight a place; more where a mesh has more than 48,000 places: a fourth of them,
/// 50,000 at most.
Index sample_count(const Mesh& mesh);

/// Blue noise over the faces (see blue_noise()), part by part, at the same density but for small
/// parts; `kept` places are among them, and so are points along all borders, as far apart as the
/// others, farther only where there is next to no area for their length. Both sides of a thin sheet
/// get their own. `mesh` has triangles.
MeshSamples sample_mesh(const Mesh& mesh, std::span<const Index> kept,
                        const MeshSampleOptions& options, Progress& progress);

}  // namespace pointmorph

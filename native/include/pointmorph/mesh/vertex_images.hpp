// Stage `vertex_images`: the vertices of a mesh, carried by a map of its samples.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Values at samples, one row a sample; at vertices likewise.
using SampleValues = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Vertices or samples of a mesh. Refers to all of it: the caller keeps it alive.
struct PointsOfParts {
    const Positions& positions;  ///< #points by 3
    const Normals& normals;      ///< #points by 3, unit length
    /// The part of the mesh that each belongs to, −1 for none; empty where there is one part.
    std::span<const Index> parts{};
};

/// Which samples say where each vertex goes: the nearest of its part in position and normal, so
/// that those of the other side of a thin sheet don't, with weights that fade to 0 at the farthest.
/// Made once; carries any map of the samples.
class VertexImages {
public:
    /// There are samples; `spacing` is their distance from each other.
    VertexImages(const PointsOfParts& vertices, const PointsOfParts& samples, double spacing,
                 Progress& progress);

    Index size() const { return to_index(offsets_.rows()); }

    /// #vertices by 3, by an affine fit of the samples' `images` (#samples by 3) around each vertex
    /// that keeps to a turn and a scale where the samples leave it open: exact for similarities. A
    /// vertex at the very place of a sample has its image.
    Positions positions(const Positions& images, Progress& progress) const;

    /// #vertices by as many values as given: by an affine fit as well, flat where the samples leave
    /// it open.
    SampleValues values(const SampleValues& of_samples, Progress& progress) const;

    /// The sample that tells most about each vertex.
    std::vector<Index> nearest() const;

    static constexpr Index kNeighbors = 12;

private:
    std::span<const Index> rows(Index vertex) const {
        return {rows_.data() + to_size(vertex * neighbors_), to_size(neighbors_)};
    }

    Index neighbors_ = 0;       ///< of each vertex
    std::vector<Index> rows_;   ///< samples, the nearest first
    Eigen::VectorXd weights_;   ///< of these, sum 1 for each vertex
    Positions samples_;         ///< their positions
    Positions offsets_;         ///< #vertices by 3: from the weighted mean of the samples
    std::vector<char> at_one_;  ///< whether the vertex is where its nearest sample is
};

/// VertexImages(…).positions(images), for a single map: nothing is kept of it.
Positions carried_positions(const PointsOfParts& vertices, const PointsOfParts& samples,
                            const Positions& images, double spacing, Progress& progress);

}  // namespace pointmorph

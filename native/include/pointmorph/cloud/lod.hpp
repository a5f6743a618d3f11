// Stage `lod`: simplification by hierarchical clustering (paper, Fast Parameterization, step 1).
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

struct LodOptions {
    /// A cluster is split while it holds more points than this (the paper's threshold); 1 or more.
    Index max_cluster_size = 12;
};

/// Clusters C_i of a cloud and their centroids y_i.
struct Lod {
    Positions centroids;         ///< #clusters by 3
    std::vector<Index> cluster;  ///< #rows simplified: the cluster of each
    std::vector<Index> offsets;  ///< #clusters + 1, into `members`
    std::vector<Index> members;  ///< rows of the cloud, cluster by cluster

    Index size() const { return to_index(centroids.rows()); }
    std::span<const Index> operator[](Index c) const {
        const auto i = to_size(c);
        return {members.data() + offsets[i], members.data() + offsets[i + 1]};
    }
};

/// Splits the points `rows` of the cloud by planes through the centroid with normal v2 (the
/// direction of greatest variation) until no cluster holds more than `max_cluster_size` points.
/// Points that coincide are split by row, so that it always ends. `cluster[i]` belongs to
/// `rows[i]`.
Lod simplify(const Positions& positions, std::span<const Index> rows, const LodOptions& options,
             Progress& progress);

}  // namespace pointmorph

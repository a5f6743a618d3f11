// The few thousand points of a cloud among which curves are searched for. Internal.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/surface/extremity_pairing.hpp"
#include "pointmorph/surface/sampled_surface.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

struct CoarseCloud {
    std::vector<Index> rows;  ///< of the cloud, the features first
    Positions positions;
    Normals normals;
    KdTree<3> tree;
    std::vector<Index> cells;  ///< #cloud: the nearest coarse point on the same side
    SurfaceGraph graph;
    double spacing;  ///< of these points
    double unit;     ///< √area

    /// The `features` and others, about `points` in all. `dense_tree` holds the positions of
    /// `dense`.
    CoarseCloud(const SampledSurface& dense, const KdTree<3>& dense_tree,
                std::span<const Index> features, Index points, Progress& progress);
    /// The same with the first points in another order: point k is the one that was `first[k]`.
    CoarseCloud(const CoarseCloud& other, std::span<const Index> first);

private:
    CoarseCloud(const SampledSurface& dense, SubsetCells chosen, double area, Progress& progress);
};

/// Distances along the surface from the first `features` coarse points to all of them, in √area:
/// #points by #features.
Eigen::MatrixXd distances_from_features(const CoarseCloud& coarse, std::size_t features);

/// Extremities of the coarse points, `most` at the most, the most prominent first.
std::vector<Extremity> extremities(const CoarseCloud& coarse, Index most, Progress& progress);

/// unmarked_extremities() as rows of the cloud, `most` before those near a feature are left out.
/// `from` is distances_from_features().
UnmarkedExtremities unmarked_extremities(const CoarseCloud& coarse, const Eigen::MatrixXd& from,
                                         Index most, Progress& progress);

}  // namespace pointmorph

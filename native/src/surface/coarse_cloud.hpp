// The few thousand points of a cloud among which curves are searched for; not for callers of the
// library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/surface/extremity_pairing.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

struct CoarseCloud {
    std::vector<Index> rows;  ///< of the cloud, the features first
    Positions positions;
    Normals normals;
    KdTree<3> tree;
    std::vector<Index> cells;  ///< #cloud: the nearest coarse point on the same sheet
    SurfaceGraph graph;
    double spacing;  ///< of these points
    double unit;     ///< √area

    /// `features` and others to make `points` in all.
    CoarseCloud(const KdTree<3>& dense, const Normals& dense_normals, const Neighborhoods& nearest,
                std::span<const Index> features, Index points, Progress& progress);

private:
    CoarseCloud(Subset chosen, double area, const KdTree<3>& dense, const Normals& dense_normals,
                const Neighborhoods& nearest, Progress& progress);
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

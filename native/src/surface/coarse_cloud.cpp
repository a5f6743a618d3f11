#include "surface/coarse_cloud.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

namespace {

/// The nearest coarse point of every point of the cloud, on the same side of the surface.
std::vector<Index> cells_of(const SampledSurface& dense, const KdTree<3>& tree,
                            const Normals& normals, Progress& progress) {
    constexpr std::size_t kNear = 4;
    std::vector<Index> result(to_size(dense.size()));
    parallel_for(dense.size(), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i)
            result[to_size(i)] = nearest_on_sheet(tree, normals, dense.positions.row(i),
                                                  dense.normals.row(i), kNear);
    });
    return result;
}

}  // namespace

CoarseCloud::CoarseCloud(const SampledSurface& dense, const KdTree<3>& dense_tree,
                         std::span<const Index> features, Index points, Progress& progress)
    : CoarseCloud(dense, poisson_disk_subset(dense_tree, dense.normals, features, points, progress),
                  estimated_area(dense_tree), progress) {}

CoarseCloud::CoarseCloud(const SampledSurface& dense, Subset chosen, double area,
                         Progress& progress)
    : rows(std::move(chosen.rows)),
      positions(gather(dense.positions, rows)),
      normals(gather(dense.normals, rows)),
      tree(positions),
      cells(cells_of(dense, tree, normals, progress)),
      graph(surface_graph(dense.positions, dense.normals, dense.nearest, rows, cells)),
      spacing(std::max(chosen.radius, std::sqrt(area / static_cast<double>(rows.size())))),
      unit(std::sqrt(area)) {}

Eigen::MatrixXd distances_from_features(const CoarseCloud& coarse, std::size_t features) {
    std::vector<Index> first(features);
    std::iota(first.begin(), first.end(), 0);
    return distances_from(coarse.graph, coarse.unit, first);
}

std::vector<Extremity> extremities(const CoarseCloud& coarse, Index most, Progress& progress) {
    return extremities(coarse.graph, coarse.unit, {.most = most}, progress);
}

UnmarkedExtremities unmarked_extremities(const CoarseCloud& coarse, const Eigen::MatrixXd& from,
                                         Index most, Progress& progress) {
    UnmarkedExtremities unmarked =
        unmarked_extremities(coarse.graph, coarse.unit, from, {.most = most}, progress);
    for (Index& row : unmarked.rows) row = coarse.rows[to_size(row)];
    return unmarked;
}

}  // namespace pointmorph

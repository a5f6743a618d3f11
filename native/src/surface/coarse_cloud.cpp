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

/// The nearest coarse point of every point of the cloud, on the same side of the surface; `known`
/// are those that are known.
std::vector<Index> cells_of(const SampledSurface& dense, const KdTree<3>& tree,
                            const Normals& normals, std::vector<Index> known, Progress& progress) {
    constexpr std::size_t kNear = 4;
    parallel_for(dense.size(), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i)
            if (known[to_size(i)] < 0)
                known[to_size(i)] = nearest_on_sheet(tree, normals, dense.positions.row(i),
                                                     dense.normals.row(i), kNear);
    });
    return known;
}

/// Rows with the first ones in another order.
template <class Array>
Array with_first(Array rows, std::span<const Index> first) {
    std::vector<Index> order(first.begin(), first.end());
    const Array some = gather(rows, order);
    if constexpr (requires { rows.rows(); })
        rows.topRows(some.rows()) = some;
    else
        std::ranges::copy(some, rows.begin());
    return rows;
}

/// Which point each has become.
Index place_of(Index point, std::span<const Index> places) {
    return to_size(point) < places.size() ? places[to_size(point)] : point;
}

SurfaceGraph with_first(const SurfaceGraph& graph, std::span<const Index> first,
                        std::span<const Index> places) {
    SurfaceGraph result;
    result.neighbors.reserve(graph.neighbors.size());
    result.lengths.reserve(graph.lengths.size());
    std::vector<std::pair<Index, double>> around;
    for (Index i = 0; i < graph.size(); ++i) {
        const auto before = to_size(place_of(i, first));
        around.clear();
        for (auto e = to_size(graph.offsets[before]); e < to_size(graph.offsets[before + 1]); ++e)
            around.emplace_back(place_of(graph.neighbors[e], places), graph.lengths[e]);
        std::ranges::sort(around);
        for (const auto& [j, length] : around) {
            result.neighbors.push_back(j);
            result.lengths.push_back(length);
        }
        result.offsets.push_back(static_cast<std::int64_t>(result.neighbors.size()));
    }
    return result;
}

std::vector<Index> inverse(std::span<const Index> permutation) {
    std::vector<Index> result(permutation.size());
    for (std::size_t k = 0; k < permutation.size(); ++k)
        result[to_size(permutation[k])] = to_index(k);
    return result;
}

}  // namespace

CoarseCloud::CoarseCloud(const CoarseCloud& other, std::span<const Index> first)
    : rows(with_first(other.rows, first)),
      positions(with_first(other.positions, first)),
      normals(with_first(other.normals, first)),
      tree(positions),
      cells(other.cells),
      graph(with_first(other.graph, first, inverse(first))),
      spacing(other.spacing),
      unit(other.unit) {
    const std::vector<Index> places = inverse(first);
    for (Index& cell : cells) cell = place_of(cell, places);
}

CoarseCloud::CoarseCloud(const SampledSurface& dense, const KdTree<3>& dense_tree,
                         std::span<const Index> features, Index points, Progress& progress)
    : CoarseCloud(dense, poisson_disk_cells(dense_tree, dense.normals, features, points, progress),
                  estimated_area(dense_tree), progress) {}

CoarseCloud::CoarseCloud(const SampledSurface& dense, SubsetCells chosen, double area,
                         Progress& progress)
    : rows(std::move(chosen.subset.rows)),
      positions(gather(dense.positions, rows)),
      normals(gather(dense.normals, rows)),
      tree(positions),
      cells(cells_of(dense, tree, normals, std::move(chosen.nearest), progress)),
      graph(surface_graph(dense.positions, dense.normals, dense.nearest, rows, cells)),
      spacing(std::max(chosen.subset.radius, std::sqrt(area / static_cast<double>(rows.size())))),
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

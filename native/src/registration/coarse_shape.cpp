#include "pointmorph/registration/coarse_shape.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "registration/crossed_limbs.hpp"
#include "registration/from_nodes.hpp"

namespace pointmorph {

namespace {

constexpr Index kAreaNeighbors = 12;

/// Area per point, π r²/k from the distance r to the k-th neighbor.
Values point_areas(const Positions& positions, const Neighborhoods& nearest) {
    Values areas = Values::Zero(positions.rows());
    for (Index i = 0; i < nearest.size(); ++i) {
        const auto near = nearest[i].first(std::min(to_size(kAreaNeighbors), nearest[i].size()));
        if (near.empty()) continue;
        areas[i] = std::numbers::pi *
                   (positions.row(near.back()) - positions.row(i)).squaredNorm() /
                   static_cast<double>(near.size());
    }
    // All at one place: any weights do, as long as there are some.
    if (!(areas.sum() > 0.0)) areas.setOnes();
    return areas;
}

}  // namespace

CoarseShape coarse_shape(const KdTree<3>& tree, const Normals& normals,
                         std::span<const Index> required, const CoarseShapeOptions& options,
                         Progress& progress, const Neighborhoods* nearest) {
    CoarseShape shape;
    shape.cloud_rows =
        poisson_disk_subset(tree, normals, required, options.points, progress, nearest).rows;
    shape.positions = gather(tree.points(), shape.cloud_rows);
    shape.normals = gather(normals, shape.cloud_rows);

    const KdTree<3> coarse_tree(shape.positions);
    const Neighborhoods near = nearest_neighbors(coarse_tree, options.graph.neighbors, progress);
    shape.areas = point_areas(shape.positions, near);
    shape.graph = surface_graph(shape.positions, shape.normals, near, options.graph, &tree,
                                nearest ? spacings_around(tree.points(), *nearest, shape.cloud_rows)
                                        : spacings_around(tree, shape.positions, progress));

    std::vector<Index> first(required.size());
    std::iota(first.begin(), first.end(), 0);
    std::vector<Subset> levels;
    for (const Index nodes : options.nodes)
        levels.push_back(
            poisson_disk_subset(coarse_tree, shape.normals, first, nodes, progress, &near));
    if (!levels.empty())
        shape.graph = without_crossings(shape.positions, std::sqrt(shape.areas.sum()),
                                        std::move(shape.graph), levels.front().rows);
    for (const Subset& nodes : levels)
        shape.levels.push_back(deformation_graph(shape.graph, nodes, progress));
    return shape;
}

LocalAreas local_areas(const CoarseShape& shape, Progress& progress) {
    const DeformationGraph& nodes = shape.levels.back();
    constexpr std::array<double, LocalAreas::ColsAtCompileTime> kRadii{0.1, 0.15, 0.2, 0.3};
    const double all = shape.areas.sum(), unit = std::sqrt(all);
    Values area = Values::Zero(nodes.size());
    for (Index i = 0; i < shape.size(); ++i)
        for (std::size_t k = 0; k < kNodesPerPoint; ++k)
            area[nodes.point_nodes[to_size(i)][k]] +=
                nodes.point_weights[to_size(i)][k] * shape.areas[i] / all;

    const SurfaceGraph graph = node_graph(shape.positions, nodes);
    LocalAreas of_nodes(nodes.size(), LocalAreas::ColsAtCompileTime);
    parallel_for(nodes.size(), progress, [&](Index begin, Index end) {
        GeodesicSearch search(graph);
        for (Index i = begin; i < end; ++i) {
            auto sums = of_nodes.row(i);
            sums.setConstant(1e-6);
            for (const auto& [j, distance] : search.from(i, kRadii.back() * unit))
                for (std::size_t r = 0; r < kRadii.size(); ++r)
                    if (distance < kRadii[r] * unit) sums[static_cast<Eigen::Index>(r)] += area[j];
            for (std::size_t r = 0; r < kRadii.size(); ++r) {
                double& sum = sums[static_cast<Eigen::Index>(r)];
                sum = std::log(sum / (kRadii[r] * kRadii[r]));
            }
        }
    });
    return from_nodes(nodes, of_nodes);
}

Eigen::MatrixXd node_distances(const CoarseShape& shape) {
    const DeformationGraph& nodes = shape.levels.front();
    const SurfaceGraph graph = node_graph(shape.positions, nodes);
    Eigen::MatrixXd distances = Eigen::MatrixXd::Zero(nodes.size(), nodes.size());
    GeodesicSearch search(graph);
    for (Index i = 0; i < nodes.size(); ++i)
        for (const auto& [j, distance] : search.reached(i)) distances(i, j) = distance;
    return distances;
}

NodeDistances node_distances(const CoarseShape& source, const CoarseShape& target) {
    NodeDistances distances;
    parallel_invoke(
        2, [&](int k, bool) { distances[to_size(k)] = node_distances(k == 0 ? source : target); });
    return distances;
}

CoarseShape moved(const CoarseShape& shape, const Similarity& move) {
    CoarseShape result = shape;
    result.positions = move.apply(shape.positions);
    result.normals = move.rotated(shape.normals);
    result.guides.places = move.apply(shape.guides.places);
    return result;
}

}  // namespace pointmorph

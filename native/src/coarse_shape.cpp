#include "pointmorph/coarse_shape.hpp"

#include <cmath>
#include <numbers>
#include <numeric>

#include "pointmorph/cloud.hpp"
#include "pointmorph/parallel.hpp"
#include "pointmorph/subset.hpp"

namespace pointmorph {

namespace {

/// Area per point, π r²/k from the distance r to the k-th neighbour.
Values point_areas(const KdTree<3>& tree, Progress& progress) {
    constexpr Index kNeighbors = 12;
    Values areas(tree.size());
    parallel_for(tree.size(), progress, [&](Index begin, Index end) {
        std::vector<Index> near(
            std::min<std::size_t>(kNeighbors + 1, static_cast<std::size_t>(tree.size())));
        std::vector<double> squared(near.size());
        for (Index i = begin; i < end; ++i) {
            tree.nearest(tree.points().row(i).data(), near, squared);
            areas[i] = std::numbers::pi * squared.back() /
                       static_cast<double>(std::max<std::size_t>(near.size() - 1, 1));
        }
    });
    // All at one place: any weights do, as long as there are some.
    if (!(areas.sum() > 0.0)) areas.setOnes();
    return areas;
}

}  // namespace

CoarseShape coarse_shape(const KdTree<3>& tree, const Normals& normals,
                         std::span<const Index> required, const CoarseShapeOptions& options,
                         Progress& progress) {
    CoarseShape shape;
    shape.rows = blue_noise_subset(tree, normals, required, options.points, progress).rows;
    shape.positions = gather(tree.points(), shape.rows);
    shape.normals = gather(normals, shape.rows);

    const KdTree<3> coarse_tree(shape.positions);
    shape.areas = point_areas(coarse_tree, progress);
    shape.graph = surface_graph(coarse_tree, shape.normals, options.graph, progress, &tree);

    std::vector<Index> first(required.size());
    std::iota(first.begin(), first.end(), 0);
    for (const Index nodes : options.nodes)
        shape.levels.push_back(deformation_graph(
            shape.graph, blue_noise_subset(coarse_tree, shape.normals, first, nodes, progress),
            progress));
    return shape;
}

}  // namespace pointmorph

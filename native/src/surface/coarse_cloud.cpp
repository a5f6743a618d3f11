#include "surface/coarse_cloud.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <span>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

namespace {

std::vector<Index> nearest_on_sheet(const KdTree<3>& tree, const Normals& normals,
                                    const Positions& points, const Normals& point_normals,
                                    Progress& progress) {
    std::vector<Index> result(to_size(points.rows()));
    parallel_for(static_cast<Index>(points.rows()), progress, [&](Index begin, Index end) {
        std::array<Index, 4> near;
        std::array<double, 4> squared;
        for (Index i = begin; i < end; ++i) {
            Index& mine = result[to_size(i)];
            const auto agrees = [&](Index k) {
                return normals.row(k).dot(point_normals.row(i)) > 0.0;
            };
            tree.nearest(points.row(i).data(), std::span(near).first(1),
                         std::span(squared).first(1));
            mine = near[0];
            if (agrees(near[0])) continue;
            const Index found = tree.nearest(points.row(i).data(), near, squared);
            const auto best = std::find_if(near.begin(), near.begin() + found, agrees);
            if (best != near.begin() + found) mine = *best;
        }
    });
    return result;
}

}  // namespace

CoarseCloud::CoarseCloud(const KdTree<3>& dense, const Normals& dense_normals,
                         const Neighborhoods& nearest, std::span<const Index> features,
                         Index points, Progress& progress)
    : CoarseCloud(blue_noise_subset(dense, dense_normals, features, points, progress),
                  estimated_area(dense), dense, dense_normals, nearest, progress) {}

CoarseCloud::CoarseCloud(Subset chosen, double area, const KdTree<3>& dense,
                         const Normals& dense_normals, const Neighborhoods& nearest,
                         Progress& progress)
    : rows(std::move(chosen.rows)),
      positions(gather(dense.points(), rows)),
      normals(gather(dense_normals, rows)),
      tree(positions),
      cells(nearest_on_sheet(tree, normals, dense.points(), dense_normals, progress)),
      graph(surface_graph(dense.points(), dense_normals, nearest, rows, cells)),
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

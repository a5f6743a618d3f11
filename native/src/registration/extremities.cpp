#include "pointmorph/registration/extremities.hpp"

#include <algorithm>
#include <cmath>

#include "pointmorph/base/assignment.hpp"

namespace pointmorph {

std::vector<Extremity> extremities(const CoarseShape& shape, const Eigen::MatrixXd& distances,
                                   const ExtremityOptions& options) {
    const DeformationGraph& graph = shape.levels.front();
    const Index count = graph.size();
    Values areas = Values::Zero(count);
    for (Index i = 0; i < shape.size(); ++i)
        areas[graph.point_nodes[to_size(i)][0]] += shape.areas[i];
    const double radius = options.radius * std::sqrt(areas.sum());
    Positions means(count, 3);  // of what lies around each node
    Eigen::VectorXd height(count);
    for (Index k = 0; k < count; ++k) {
        Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
        double weights = 0.0;
        for (Index l = 0; l < count; ++l) {
            const double ratio = distances(k, l) / radius;
            const double weight = areas[l] * std::exp(-1.5 * ratio * ratio);
            sum += weight * shape.positions.row(graph.node_rows[to_size(l)]);
            weights += weight;
        }
        means.row(k) = sum / std::max(weights, 1e-300);
        height[k] =
            (shape.positions.row(graph.node_rows[to_size(k)]) - means.row(k)).norm() / radius;
    }
    const std::vector<double> prominent = prominences(graph.edge_offsets, graph.edge_ends, height);
    const std::vector<Index> peaks = most_prominent(prominent, options.most, options.prominence);

    std::vector<Extremity> result;
    for (const Index k : peaks)
        result.push_back({graph.node_rows[to_size(k)], prominent[to_size(k)]});
    const auto out = [&](std::size_t t, Index i) {
        return (shape.positions.row(i) - means.row(peaks[t])).squaredNorm();
    };
    for (Index i = 0; i < shape.size(); ++i)
        for (std::size_t t = 0; t < result.size(); ++t)
            if (graph.point_nodes[to_size(i)][0] == peaks[t] && out(t, i) > out(t, result[t].point))
                result[t].point = i;
    return result;
}

std::vector<ExtremityPair> paired_extremities(const MappedExtremities& source,
                                              const MappedExtremities& target,
                                              const ExtremityOptions& options) {
    const auto s = static_cast<Eigen::Index>(source.extremities.size());
    const auto t = static_cast<Eigen::Index>(target.extremities.size());
    Eigen::MatrixXd costs(s, t);
    for (Eigen::Index i = 0; i < s; ++i)
        for (Eigen::Index j = 0; j < t; ++j) {
            const Index a = source.extremities[to_size(i)].point;
            const Index b = target.extremities[to_size(j)].point;
            costs(i, j) = 0.5 * ((source.images.row(a) - target.shape.positions.row(b)).norm() +
                                 (target.images.row(b) - source.shape.positions.row(a)).norm());
        }
    std::vector<ExtremityPair> pairs;
    for (const auto& [i, j] : cheapest_pairs(costs, options.reach))
        pairs.push_back({i, j, costs(i, j)});
    return pairs;
}

}  // namespace pointmorph

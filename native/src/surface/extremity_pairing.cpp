#include "pointmorph/surface/extremity_pairing.hpp"

#include <cmath>

#include "pointmorph/base/assignment.hpp"

namespace pointmorph {

Eigen::MatrixXd distances_from(const SurfaceGraph& graph, double unit,
                               std::span<const Index> features) {
    Eigen::MatrixXd from =
        Eigen::MatrixXd::Zero(graph.size(), static_cast<Eigen::Index>(features.size()));
    GeodesicSearch search(graph);
    for (std::size_t k = 0; k < features.size(); ++k)
        for (const auto& [i, distance] : search.reached(features[k]))
            from(i, static_cast<Eigen::Index>(k)) = distance / unit;
    return from;
}

UnmarkedExtremities unmarked_extremities(const SurfaceGraph& graph, double unit,
                                         const Eigen::MatrixXd& from,
                                         const GraphExtremityOptions& options, Progress& progress) {
    UnmarkedExtremities unmarked;
    if (options.most > 0)
        for (const Extremity& found : extremities(graph, unit, options, progress))
            if ((from.row(found.point).array() >= kMarked).all())
                unmarked.rows.push_back(found.point);
    unmarked.distances = from(unmarked.rows, Eigen::all);
    return unmarked;
}

std::vector<IndexPair> paired_extremities(const UnmarkedExtremities& source,
                                          const UnmarkedExtremities& target, double largest,
                                          const std::function<double(Index, Index)>& apart) {
    constexpr double kByFar = 1.5;
    Eigen::MatrixXd costs(source.distances.rows(), target.distances.rows());
    for (Eigen::Index i = 0; i < costs.rows(); ++i)
        for (Eigen::Index j = 0; j < costs.cols(); ++j) {
            const Eigen::RowVectorXd difference = source.distances.row(i) - target.distances.row(j);
            costs(i, j) = difference.norm() / std::sqrt(static_cast<double>(difference.size())) +
                          apart(source.rows[to_size(i)], target.rows[to_size(j)]);
        }
    std::vector<IndexPair> pairs;
    for (const auto& [i, j] : each_others_best(costs, largest, kByFar))
        pairs.push_back({source.rows[to_size(i)], target.rows[to_size(j)]});
    return pairs;
}

}  // namespace pointmorph

#include "disk/unmarked_tips.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "pointmorph/base/assignment.hpp"
namespace pointmorph {

namespace {}  // namespace

std::vector<Values> distances_from(const CoarseCloud& coarse, std::size_t features) {
    GeodesicSearch search(coarse.graph);
    std::vector<Values> from;
    for (std::size_t k = 0; k < features; ++k) {
        Values distances(coarse.graph.size());
        for (const auto& [i, distance] : search.from(static_cast<Index>(k)))
            distances[i] = distance / coarse.unit;
        from.push_back(std::move(distances));
    }
    return from;
}

std::vector<Extremity> tips_of(const CoarseCloud& coarse, Index most, Progress& progress) {
    constexpr Index kSamples = 30;
    constexpr double kProminence = 0.04;  // in √area
    return extremities(coarse.graph, coarse.unit, kSamples, most, kProminence, progress);
}

UnmarkedTips unmarked_tips(const CoarseCloud& coarse, std::span<const Values> from, Index most,
                           Progress& progress) {
    UnmarkedTips result;
    std::vector<Index> tips;  // coarse rows
    if (most > 0)
        for (const Extremity& tip : tips_of(coarse, most, progress))
            if (std::ranges::all_of(from, [&](const Values& d) { return d[tip.point] > kMarked; }))
                tips.push_back(tip.point);
    for (const Index tip : tips) result.rows.push_back(coarse.rows[to_size(tip)]);
    result.distances.resize(static_cast<Eigen::Index>(tips.size()),
                            static_cast<Eigen::Index>(from.size()));
    for (std::size_t i = 0; i < tips.size(); ++i)
        for (std::size_t k = 0; k < from.size(); ++k)
            result.distances(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) =
                from[k][tips[i]];
    return result;
}

std::vector<IndexPair> paired_tips(const UnmarkedTips& source, const UnmarkedTips& target,
                                   const std::function<bool(bool is_source, Index row)>& in_patch,
                                   const std::function<double(Index, Index)>& apart) {
    constexpr double kLargest = 0.35, kByFar = 1.5;
    const auto on_patch = [&](const UnmarkedTips& tips, bool is_source) {
        std::vector<Index> places;
        for (std::size_t i = 0; i < tips.rows.size(); ++i)
            if (in_patch(is_source, tips.rows[i])) places.push_back(static_cast<Index>(i));
        return places;
    };
    const auto s = on_patch(source, true), t = on_patch(target, false);
    Eigen::MatrixXd costs(s.size(), t.size());
    for (std::size_t i = 0; i < s.size(); ++i)
        for (std::size_t j = 0; j < t.size(); ++j) {
            const Eigen::RowVectorXd difference =
                source.distances.row(s[i]) - target.distances.row(t[j]);
            costs(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) =
                difference.norm() / std::sqrt(static_cast<double>(difference.size())) +
                apart(source.rows[to_size(s[i])], target.rows[to_size(t[j])]);
        }
    std::vector<IndexPair> pairs;
    for (const auto& [i, j] : each_others_best(costs, kLargest, kByFar))
        pairs.push_back({source.rows[to_size(s[to_size(i)])], target.rows[to_size(t[to_size(j)])]});
    return pairs;
}

}  // namespace pointmorph

#include "registration/extremity_variants.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace pointmorph {

namespace {

/// How far a map leaves extremities apart, how differently far apart they are along both shapes,
/// and a price for those left alone.
class MatchCost {
public:
    MatchCost(const PoseSearch& search, const CoarseShape& there, const Registration& map)
        : apart_(search.source.extremities.size(), search.target.extremities.size()),
          fewer_(std::min(search.source.extremities.size(), search.target.extremities.size())) {
        const auto &s = search.source.extremities, &t = search.target.extremities;
        for (std::size_t i = 0; i < s.size(); ++i)
            for (std::size_t j = 0; j < t.size(); ++j)
                apart_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) =
                    0.5 *
                    ((map.source_points.positions.row(s[i].point) - there.positions.row(t[j].point))
                         .norm() +
                     (map.target_points.positions.row(t[j].point) -
                      search.source.thin.positions.row(s[i].point))
                         .norm());
        along_ = {between(search.source, search.distances[0]),
                  between(search.target, search.distances[1])};
    }

    double operator()(const ExtremityMatches& pairs) const {
        constexpr double kAlone = 0.2;
        const double alone = static_cast<double>(fewer_) - static_cast<double>(pairs.size());
        double sum = kAlone * alone;
        for (const IndexPair& p : pairs) {
            double other = 0.0;
            for (const IndexPair& q : pairs)
                other += std::abs(along_[0](p.source, q.source) - along_[1](p.target, q.target));
            sum += apart_(p.source, p.target) + other / static_cast<double>(pairs.size());
        }
        return sum / (alone + static_cast<double>(pairs.size()));
    }

private:
    Eigen::MatrixXd apart_;  ///< under the map, mean of both ways
    NodeDistances along_;    ///< between the extremities of each shape
    std::size_t fewer_;      ///< extremities of the shape that has fewer

    static Eigen::MatrixXd between(const ThinnedShape& shape, const Eigen::MatrixXd& distances) {
        std::vector<Index> nodes;
        for (const Extremity& extremity : shape.extremities)
            nodes.push_back(node_at(shape, extremity.point));
        return distances(nodes, nodes);
    }
};

/// Of `count` extremities those that no pair holds.
std::vector<Index> left_alone(const std::vector<IndexPair>& pairs, Index count,
                              Index IndexPair::*side) {
    std::vector<Index> result;
    for (Index k = 0; k < count; ++k)
        if (std::ranges::find(pairs, k, side) == pairs.end()) result.push_back(k);
    return result;
}

}  // namespace

std::vector<ExtremityMatches> extremity_variants(const PoseSearch& search, const Trial& trial) {
    const CoarseShape there = moved(search.target.thin, trial.alignment);
    const Registration& map = trial.registration;
    ExtremityMatches now;
    for (const ExtremityPair& p : paired_extremities(
             {search.source.thin, map.source_points.positions, search.source.extremities},
             {there, map.target_points.positions, search.target.extremities},
             search.options.extremities))
        now.push_back({p.source, p.target});
    if (now.size() < 2) return {};

    const MatchCost cost(search, there, map);
    std::vector<std::pair<double, ExtremityMatches>> variants;
    for (ExtremityMatches& matches :
         changed_pairings(now, to_index(search.source.extremities.size()),
                          to_index(search.target.extremities.size()))) {
        if (matches.size() < 2) continue;
        const double its_cost = cost(matches);
        variants.emplace_back(its_cost, std::move(matches));
    }
    std::ranges::stable_sort(variants, {}, &std::pair<double, ExtremityMatches>::first);
    std::vector<ExtremityMatches> result{std::move(now)};
    for (auto& variant : variants) result.push_back(std::move(variant.second));
    return result;
}

std::vector<ExtremityMatches> changed_pairings(const ExtremityMatches& now, Index sources,
                                               Index targets) {
    std::vector<ExtremityMatches> result;
    const auto add = [&](auto&& change) {
        change(result.emplace_back(now));
        std::ranges::sort(result.back());
    };
    const std::vector<Index> free_sources = left_alone(now, sources, &IndexPair::source);
    const std::vector<Index> free_targets = left_alone(now, targets, &IndexPair::target);
    using Pairs = ExtremityMatches;
    for (const Index s : free_sources)
        for (const Index t : free_targets) add([&](Pairs& pairs) { pairs.push_back({s, t}); });
    for (std::size_t i = 0; i < now.size(); ++i) {
        for (const Index t : free_targets) add([&](Pairs& pairs) { pairs[i].target = t; });
        for (const Index s : free_sources) add([&](Pairs& pairs) { pairs[i].source = s; });
        add([&](Pairs& pairs) { pairs.erase(pairs.begin() + static_cast<std::ptrdiff_t>(i)); });
        for (std::size_t j = 0; j < i; ++j) {
            add([&](Pairs& pairs) { std::swap(pairs[i].target, pairs[j].target); });
            for (std::size_t k = 0; k < j; ++k) {
                add([&](Pairs& pairs) {
                    std::swap(pairs[i].target, pairs[j].target);
                    std::swap(pairs[j].target, pairs[k].target);
                });
                add([&](Pairs& pairs) {
                    std::swap(pairs[i].target, pairs[k].target);
                    std::swap(pairs[k].target, pairs[j].target);
                });
            }
        }
    }
    return result;
}

}  // namespace pointmorph

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
        along_ = distances_between_extremities(search);
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
};

/// Of `count` extremities those that no pair holds.
std::vector<Index> left_alone(const std::vector<IndexPair>& pairs, Index count,
                              Index IndexPair::*side) {
    std::vector<Index> result;
    for (Index k = 0; k < count; ++k)
        if (std::ranges::find(pairs, k, side) == pairs.end()) result.push_back(k);
    return result;
}

/// `there`: the target as the map has it.
ExtremityMatches matches_under(const PoseSearch& search, const CoarseShape& there,
                               const Registration& map) {
    ExtremityMatches now;
    for (const ExtremityPair& p : paired_extremities(
             {search.source.thin, map.source_points.positions, search.source.extremities},
             {there, map.target_points.positions, search.target.extremities},
             search.options.extremities))
        now.push_back({p.source, p.target});
    return now;
}

/// How much more, or less, the distances contradict each other once the targets of two pairs are
/// swapped.
double change_by_swap(const ExtremityMatches& pairs, std::size_t i, std::size_t j,
                      const NodeDistances& along) {
    const auto& [here, there] = along;
    const auto off = [&](std::size_t a, Index target_of_a, std::size_t k) {
        return std::abs(here(pairs[a].source, pairs[k].source) -
                        there(target_of_a, pairs[k].target));
    };
    double change = 0.0;
    for (std::size_t k = 0; k < pairs.size(); ++k)
        if (k != i && k != j)
            change += off(i, pairs[j].target, k) + off(j, pairs[i].target, k) -
                      off(i, pairs[i].target, k) - off(j, pairs[j].target, k);
    return change;
}

/// A pairing of which some pairs have been swapped.
struct Exchanged {
    double change;  ///< of how much the distances contradict each other
    ExtremityMatches pairs;
    std::vector<char> is_swapped;  ///< of each pair

    void swap(std::size_t i, std::size_t j, const NodeDistances& along) {
        change += change_by_swap(pairs, i, j, along);
        std::swap(pairs[i].target, pairs[j].target);
        is_swapped[i] = is_swapped[j] = 1;
    }

    /// Swaps what else is better swapped, the best first.
    void swap_on(const NodeDistances& along) {
        for (;;) {
            double best = 0.0;
            std::pair<std::size_t, std::size_t> which;
            for (std::size_t i = 0; i < pairs.size(); ++i)
                for (std::size_t j = 0; j < i; ++j) {
                    if (is_swapped[i] != 0 || is_swapped[j] != 0) continue;
                    const double its = change_by_swap(pairs, i, j, along);
                    if (!(its < best)) continue;
                    best = its;
                    which = {i, j};
                }
            if (!(best < 0.0)) return;
            swap(which.first, which.second, along);
        }
    }
};

}  // namespace

NodeDistances distances_between_extremities(const PoseSearch& search) {
    const auto between = [](const ThinnedShape& shape,
                            const Eigen::MatrixXd& distances) -> Eigen::MatrixXd {
        std::vector<Index> nodes;
        for (const Extremity& extremity : shape.extremities)
            nodes.push_back(node_at(shape, extremity.point));
        return distances(nodes, nodes);
    };
    return {between(search.source, search.distances[0]),
            between(search.target, search.distances[1])};
}

ExtremityMatches matches_under(const PoseSearch& search, const Trial& trial) {
    return matches_under(search, moved(search.target.thin, trial.alignment), trial.registration);
}

std::vector<ExtremityMatches> extremity_variants(const PoseSearch& search, const Trial& trial) {
    const CoarseShape there = moved(search.target.thin, trial.alignment);
    ExtremityMatches now = matches_under(search, there, trial.registration);
    if (now.size() < 2) return {};

    const MatchCost cost(search, there, trial.registration);
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

std::vector<ExtremityMatches> exchanged_pairings(const ExtremityMatches& now,
                                                 const NodeDistances& along, std::size_t count) {
    constexpr std::size_t kSpare = 4;  // some come to the same by further swaps
    std::vector<Exchanged> exchanged;
    const Exchanged as_is{0.0, now, std::vector<char>(now.size(), 0)};
    for (std::size_t i = 0; i < now.size(); ++i)
        for (std::size_t j = 0; j < i; ++j) {
            Exchanged one = as_is;
            one.swap(i, j, along);
            for (std::size_t k = 0; k < i; ++k)
                for (std::size_t l = 0; l < k; ++l)
                    if (k != j && l != j) exchanged.emplace_back(one).swap(k, l, along);
        }
    std::ranges::stable_sort(exchanged, {}, &Exchanged::change);
    exchanged.resize(std::min(exchanged.size(), kSpare * count));
    for (Exchanged& one : exchanged) {
        one.swap_on(along);
        std::ranges::sort(one.pairs);
    }
    std::ranges::stable_sort(exchanged, {}, &Exchanged::change);
    std::vector<ExtremityMatches> result;
    for (Exchanged& one : exchanged)
        if (result.size() < count && std::ranges::find(result, one.pairs) == result.end())
            result.push_back(std::move(one.pairs));
    return result;
}

}  // namespace pointmorph

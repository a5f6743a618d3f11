#include "pointmorph/extremities.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

namespace pointmorph {

namespace {

std::size_t at(Index i) {
    return static_cast<std::size_t>(i);
}

constexpr double kInfinite = std::numeric_limits<double>::infinity();

/// Prominence of every local maximum over a graph, 0 elsewhere: how far the values fall until a
/// higher maximum's surroundings are met (union-find from the highest node down).
std::vector<double> prominences(std::span<const std::int64_t> offsets, std::span<const Index> ends,
                                const Eigen::VectorXd& height) {
    const auto count = static_cast<Index>(height.size());
    std::vector<Index> order(at(count)), peak(at(count), -1);
    std::iota(order.begin(), order.end(), 0);
    std::ranges::stable_sort(order, [&](Index i, Index j) { return height[i] > height[j]; });
    std::vector<double> result(at(count), 0.0);
    const auto find = [&](Index i) {
        while (peak[at(i)] != i) i = peak[at(i)] = peak[at(peak[at(i)])];
        return i;
    };
    for (const Index i : order) {
        peak[at(i)] = i;
        Index mine = i;
        for (auto e = static_cast<std::size_t>(offsets[at(i)]);
             e < static_cast<std::size_t>(offsets[at(i) + 1]); ++e) {
            const Index j = ends[e];
            if (peak[at(j)] < 0) continue;
            const Index other = find(j);
            if (other == mine) continue;
            const Index lower = height[other] < height[mine] ? other : mine;
            const Index higher = lower == other ? mine : other;
            result[at(lower)] = height[lower] - height[i];
            peak[at(lower)] = mine = higher;
        }
    }
    if (count > 0) result[at(order.front())] = height[order.front()] - height[order.back()];
    return result;
}

/// The most prominent, in this order.
std::vector<Index> highest(const std::vector<double>& prominent, Index most, double least) {
    std::vector<Index> peaks;
    for (std::size_t k = 0; k < prominent.size(); ++k)
        if (prominent[k] > least) peaks.push_back(static_cast<Index>(k));
    std::ranges::stable_sort(peaks,
                             [&](Index i, Index j) { return prominent[at(i)] > prominent[at(j)]; });
    peaks.resize(std::min(peaks.size(), at(std::max<Index>(most, 0))));
    return peaks;
}

/// Of `count` tips those that no pair holds.
std::vector<Index> left_alone(const std::vector<IndexPair>& pairs, Index count,
                              Index IndexPair::*side) {
    std::vector<Index> result;
    for (Index k = 0; k < count; ++k)
        if (std::ranges::find(pairs, k, side) == pairs.end()) result.push_back(k);
    return result;
}

}  // namespace

std::vector<Extremity> extremities(const CoarseShape& shape, const Eigen::MatrixXd& distances,
                                   const ExtremityOptions& options) {
    const DeformationGraph& graph = shape.levels.front();
    const Index count = graph.size();
    Values areas = Values::Zero(count);
    for (Index i = 0; i < shape.size(); ++i) areas[graph.point_nodes[at(i)][0]] += shape.areas[i];
    const double radius = options.radius * std::sqrt(areas.sum());
    Positions means(count, 3);  // of what lies around each node
    Eigen::VectorXd height(count);
    for (Index k = 0; k < count; ++k) {
        Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
        double weights = 0.0;
        for (Index l = 0; l < count; ++l) {
            const double ratio = distances(k, l) / radius;
            const double weight = areas[l] * std::exp(-1.5 * ratio * ratio);
            sum += weight * shape.positions.row(graph.nodes[at(l)]);
            weights += weight;
        }
        means.row(k) = sum / std::max(weights, 1e-300);
        height[k] = (shape.positions.row(graph.nodes[at(k)]) - means.row(k)).norm() / radius;
    }
    const std::vector<double> prominent = prominences(graph.edge_offsets, graph.edge_ends, height);
    const std::vector<Index> peaks = highest(prominent, options.most, options.prominence);

    std::vector<Extremity> tips;
    for (const Index k : peaks) tips.push_back({graph.nodes[at(k)], prominent[at(k)]});
    const auto out = [&](std::size_t t, Index i) {
        return (shape.positions.row(i) - means.row(peaks[t])).squaredNorm();
    };
    for (Index i = 0; i < shape.size(); ++i)
        for (std::size_t t = 0; t < tips.size(); ++t)
            if (graph.point_nodes[at(i)][0] == peaks[t] && out(t, i) > out(t, tips[t].point))
                tips[t].point = i;
    return tips;
}

std::vector<Extremity> extremities(const SurfaceGraph& graph, double unit, Index samples,
                                   Index most, double prominence, Progress& progress) {
    const Index count = graph.size();
    if (count == 0) return {};
    GeodesicSearch search(graph);
    Eigen::VectorXd nearest = Eigen::VectorXd::Constant(count, kInfinite);
    Eigen::VectorXd height = Eigen::VectorXd::Zero(count);
    // The last one found is the farthest.
    Index sample = search.from(0).back().first;
    for (Index s = 0; s < samples; ++s) {
        for (const auto& [i, distance] : search.from(sample)) {
            nearest[i] = std::min(nearest[i], distance);
            height[i] += distance / (unit * samples);
        }
        nearest.maxCoeff(&sample);
        progress.report(static_cast<double>(s + 1) / samples);
    }
    const std::vector<double> prominent = prominences(graph.offsets, graph.neighbors, height);
    std::vector<Extremity> tips;
    for (const Index k : highest(prominent, most, prominence))
        tips.push_back({k, prominent[at(k)]});
    return tips;
}

std::vector<IndexPair> each_others_best(const Eigen::MatrixXd& costs, double largest,
                                        double by_far) {
    std::vector<IndexPair> pairs;
    for (Eigen::Index i = 0; i < costs.rows(); ++i)
        for (Eigen::Index j = 0; j < costs.cols(); ++j) {
            const double cost = costs(i, j);
            bool best = cost < largest;
            for (Eigen::Index k = 0; k < costs.rows(); ++k)
                best = best && (k == i || costs(k, j) > by_far * cost);
            for (Eigen::Index k = 0; k < costs.cols(); ++k)
                best = best && (k == j || costs(i, k) > by_far * cost);
            if (best) pairs.push_back({static_cast<Index>(i), static_cast<Index>(j)});
        }
    return pairs;
}

std::vector<Index> least_assignment(const Eigen::MatrixXd& costs) {
    const auto rows = static_cast<Index>(costs.rows()), columns = static_cast<Index>(costs.cols());
    // Row 0 and column 0 stand for "none".
    std::vector<double> row_price(at(rows) + 1, 0.0), column_price(at(columns) + 1, 0.0);
    std::vector<Index> row_of(at(columns) + 1, 0), before(at(columns) + 1, 0);
    for (Index row = 1; row <= rows; ++row) {
        row_of[0] = row;
        Index column = 0;
        std::vector<double> slack(at(columns) + 1, kInfinite);
        std::vector<char> reached(at(columns) + 1, 0);
        do {
            reached[at(column)] = 1;
            const Index i = row_of[at(column)];
            double least = kInfinite;
            Index next = 0;
            for (Index j = 1; j <= columns; ++j) {
                if (reached[at(j)]) continue;
                const double reduced = costs(i - 1, j - 1) - row_price[at(i)] - column_price[at(j)];
                if (reduced < slack[at(j)]) {
                    slack[at(j)] = reduced;
                    before[at(j)] = column;
                }
                if (slack[at(j)] < least) {
                    least = slack[at(j)];
                    next = j;
                }
            }
            for (Index j = 0; j <= columns; ++j) {
                if (reached[at(j)]) {
                    row_price[at(row_of[at(j)])] += least;
                    column_price[at(j)] -= least;
                } else {
                    slack[at(j)] -= least;
                }
            }
            column = next;
        } while (row_of[at(column)] != 0);
        while (column != 0) {
            row_of[at(column)] = row_of[at(before[at(column)])];
            column = before[at(column)];
        }
    }
    std::vector<Index> result(at(rows));
    for (Index j = 1; j <= columns; ++j)
        if (row_of[at(j)] > 0) result[at(row_of[at(j)] - 1)] = j - 1;
    return result;
}

std::vector<ExtremityPair> paired_extremities(const CoarseShape& source, const CoarseShape& target,
                                              const Positions& source_images,
                                              const Positions& target_images,
                                              const std::vector<Extremity>& source_tips,
                                              const std::vector<Extremity>& target_tips,
                                              const ExtremityOptions& options) {
    const auto s = static_cast<Eigen::Index>(source_tips.size());
    const auto t = static_cast<Eigen::Index>(target_tips.size());
    Eigen::MatrixXd costs = Eigen::MatrixXd::Constant(s, t + s, options.reach);
    for (Eigen::Index i = 0; i < s; ++i)
        for (Eigen::Index j = 0; j < t; ++j) {
            const Index a = source_tips[static_cast<std::size_t>(i)].point;
            const Index b = target_tips[static_cast<std::size_t>(j)].point;
            costs(i, j) = 0.5 * ((source_images.row(a) - target.positions.row(b)).norm() +
                                 (target_images.row(b) - source.positions.row(a)).norm());
        }
    std::vector<ExtremityPair> pairs;
    const std::vector<Index> columns = least_assignment(costs);
    for (Eigen::Index i = 0; i < s; ++i) {
        const Index j = columns[static_cast<std::size_t>(i)];
        if (j < t && costs(i, j) < options.reach)
            pairs.push_back({static_cast<Index>(i), j, costs(i, j)});
    }
    return pairs;
}

std::vector<std::vector<IndexPair>> changed_pairings(const std::vector<IndexPair>& now,
                                                     Index sources, Index targets) {
    std::vector<std::vector<IndexPair>> result;
    const auto add = [&](auto&& change) {
        change(result.emplace_back(now));
        std::ranges::sort(result.back());
    };
    const std::vector<Index> free_sources = left_alone(now, sources, &IndexPair::source);
    const std::vector<Index> free_targets = left_alone(now, targets, &IndexPair::target);
    using Pairs = std::vector<IndexPair>;
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

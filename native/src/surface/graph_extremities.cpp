#include "pointmorph/surface/graph_extremities.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

namespace pointmorph {

// Union-find from the highest node down.
std::vector<double> prominences(std::span<const std::int64_t> offsets, std::span<const Index> ends,
                                const Eigen::VectorXd& height) {
    const auto count = to_index(height.size());
    std::vector<Index> order(to_size(count)), peak(to_size(count), -1);
    std::iota(order.begin(), order.end(), 0);
    std::ranges::stable_sort(order, [&](Index i, Index j) { return height[i] > height[j]; });
    std::vector<double> result(to_size(count), 0.0);
    const auto find = [&](Index i) {
        while (peak[to_size(i)] != i) i = peak[to_size(i)] = peak[to_size(peak[to_size(i)])];
        return i;
    };
    for (const Index i : order) {
        peak[to_size(i)] = i;
        Index mine = i;
        for (auto e = to_size(offsets[to_size(i)]); e < to_size(offsets[to_size(i) + 1]); ++e) {
            const Index j = ends[e];
            if (peak[to_size(j)] < 0) continue;
            const Index other = find(j);
            if (other == mine) continue;
            const Index lower = height[other] < height[mine] ? other : mine;
            const Index higher = lower == other ? mine : other;
            result[to_size(lower)] = height[lower] - height[i];
            peak[to_size(lower)] = mine = higher;
        }
    }
    if (count > 0) result[to_size(order.front())] = height[order.front()] - height[order.back()];
    return result;
}

std::vector<Index> most_prominent(const std::vector<double>& prominences, Index most,
                                  double least) {
    std::vector<Index> peaks;
    for (std::size_t k = 0; k < prominences.size(); ++k)
        if (prominences[k] > least) peaks.push_back(to_index(k));
    std::ranges::stable_sort(
        peaks, [&](Index i, Index j) { return prominences[to_size(i)] > prominences[to_size(j)]; });
    peaks.resize(std::min(peaks.size(), to_size(std::max<Index>(most, 0))));
    return peaks;
}

std::vector<Extremity> extremities(const SurfaceGraph& graph, double unit,
                                   const GraphExtremityOptions& options, Progress& progress) {
    const Index count = graph.size();
    if (count == 0) return {};
    GeodesicSearch search(graph);
    Eigen::VectorXd nearest =
        Eigen::VectorXd::Constant(count, std::numeric_limits<double>::infinity());
    Eigen::VectorXd height = Eigen::VectorXd::Zero(count);
    // The last one found is the farthest.
    Index sample = search.from(0).back().first;
    for (Index s = 0; s < options.samples; ++s) {
        for (const auto& [i, distance] : search.reached(sample)) {
            nearest[i] = std::min(nearest[i], distance);
            height[i] += distance / (unit * options.samples);
        }
        nearest.maxCoeff(&sample);
        progress.report(static_cast<double>(s + 1) / options.samples);
    }
    const std::vector<double> prominent = prominences(graph.offsets, graph.neighbors, height);
    std::vector<Extremity> result;
    for (const Index k : most_prominent(prominent, options.most, options.prominence))
        result.push_back({k, prominent[to_size(k)]});
    return result;
}

}  // namespace pointmorph

#include "pointmorph/measures/cracks.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t kNearest = 6;
constexpr double kOpen = 2.0;  // spacings

/// Two neighbors of one cloud, each as the first pair that it is in.
struct Edge {
    std::array<Index, 2> pairs;
    std::array<double, 2> source_spacing, target_spacing;  ///< of each end's points
};

/// Spacing of every point, in the order of the neighborhoods, and where each row is in it.
struct Spacing {
    explicit Spacing(const Positions& positions, const OrderedNeighbors& neighbors)
        : number(inverse_order(neighbors.order)),
          values(local_spacing(gather(positions, neighbors.order), neighbors.nearest,
                               to_index(kNearest))) {}

    double operator[](Index row) const { return values[number[to_size(row)]]; }

    std::vector<Index> number;
    Values values;
};

/// Edges of a cloud, evenly over its points.
std::vector<Edge> edges_of(const OrderedNeighbors& near, std::span<const IndexPair> pairs,
                           Index IndexPair::*side, Index max_edges) {
    std::vector<Index> pair_of(near.order.size(), -1);
    for (std::size_t i = pairs.size(); i-- > 0;) pair_of[to_size(pairs[i].*side)] = to_index(i);

    const auto points = static_cast<std::int64_t>(near.order.size());
    const auto width = std::min<std::int64_t>(kNearest, points - 1);
    const std::int64_t count = std::min<std::int64_t>(width * points, max_edges);
    std::vector<Edge> edges(to_size(std::max<std::int64_t>(count, 0)));
    for (std::int64_t e = 0; e < count; ++e) {
        const auto number = to_index(e * points / count);
        const Index other = near.nearest[number][to_size(e % width)];
        const auto pair = [&](Index k) { return pair_of[to_size(near.order[to_size(k)])]; };
        edges[to_size(e)].pairs = {pair(number), pair(other)};
    }
    return edges;
}

/// The in-between cloud at one time.
struct Frame {
    const Positions& source;
    const Positions& target;
    std::span<const IndexPair> pairs;
    double t;

    Eigen::RowVector3d at(Index pair) const {
        const auto [s, d] = pairs[to_size(pair)];
        return (1.0 - t) * source.row(s) + t * target.row(d);
    }
};

/// Places from which every point of a frame may be farther than a limit, each its own.
struct Gaps {
    std::vector<Eigen::RowVector3d> middles;
    std::vector<double> limits;
};

/// How many of the gaps no point of the frame closes.
std::int64_t count_open(const Gaps& gaps, const Frame& frame, Progress& progress) {
    // Gaps of about the same limit share a tree, so that a wide one doesn't widen the search for
    // all.
    std::map<int, std::vector<std::size_t>> groups;
    for (std::size_t g = 0; g < gaps.limits.size(); ++g)
        if (gaps.limits[g] > 0.0) groups[std::ilogb(gaps.limits[g])].push_back(g);
    std::vector<std::atomic<bool>> closed(gaps.limits.size());
    for (const auto& [exponent, members] : groups) {
        Positions middles(static_cast<Eigen::Index>(members.size()), 3);
        for (std::size_t k = 0; k < members.size(); ++k)
            middles.row(static_cast<Eigen::Index>(k)) = gaps.middles[members[k]];
        const KdTree<3> tree(middles);
        const double reach = std::ldexp(1.0, exponent + 1);
        parallel_for(
            to_index(frame.pairs.size()), progress,
            [&](Index begin, Index end) {
                std::vector<std::pair<Index, double>> near;
                for (Index i = begin; i < end; ++i) {
                    tree.within(frame.at(i).data(), reach, near);
                    for (const auto& [k, squared_distance] : near) {
                        const std::size_t g = members[to_size(k)];
                        if (squared_distance <= gaps.limits[g] * gaps.limits[g])
                            closed[g].store(true, std::memory_order_relaxed);
                    }
                }
            },
            0.0, 1.0, 4096);
    }
    return std::ranges::count_if(closed, [](const auto& is) { return !is.load(); });
}

double open_share(std::span<const Edge> edges, const Frame& frame, Progress& progress) {
    if (edges.empty()) return 0.0;
    // Its own ends close most edges.
    std::vector<char> is_short(edges.size());
    const auto gap = [&](const Edge& edge) {
        double limit = 0.0;
        for (std::size_t end = 0; end < 2; ++end)
            limit +=
                kOpen / 2.0 *
                ((1.0 - frame.t) * edge.source_spacing[end] + frame.t * edge.target_spacing[end]);
        const Eigen::RowVector3d middle = (frame.at(edge.pairs[0]) + frame.at(edge.pairs[1])) / 2.0;
        return std::pair(middle, limit);
    };
    parallel_for(to_index(edges.size()), progress, [&](Index begin, Index end) {
        for (auto e = to_size(begin); e < to_size(end); ++e) {
            const auto [middle, limit] = gap(edges[e]);
            is_short[e] = (frame.at(edges[e].pairs[0]) - middle).squaredNorm() <= limit * limit;
        }
    });
    Gaps gaps;
    for (std::size_t e = 0; e < edges.size(); ++e) {
        if (is_short[e]) continue;
        const auto [middle, limit] = gap(edges[e]);
        gaps.middles.push_back(middle);
        gaps.limits.push_back(limit);
    }
    return static_cast<double>(count_open(gaps, frame, progress)) /
           static_cast<double>(edges.size());
}

}  // namespace

std::vector<Cracks> find_cracks(const CrackSide& source, const CrackSide& target,
                                std::span<const IndexPair> pairs, std::span<const double> times,
                                Progress& progress, Index max_edges) {
    std::array<std::optional<OrderedNeighbors>, 2> found;
    const auto neighbors = [&](const CrackSide& side,
                               std::optional<OrderedNeighbors>& own) -> const OrderedNeighbors* {
        if (side.neighbors) return side.neighbors;
        return &own.emplace(ordered_neighbors(side.positions, to_index(kNearest), progress));
    };
    const std::array near{neighbors(source, found[0]), neighbors(target, found[1])};
    std::array<std::optional<Spacing>, 2> spacing;
    std::array<std::vector<Edge>, 2> edges;
    on_both(progress, [&](bool is_source, Progress&) {
        const std::size_t k = is_source ? 0 : 1;
        spacing[k].emplace(is_source ? source.positions : target.positions, *near[k]);
        edges[k] = edges_of(*near[k], pairs, is_source ? &IndexPair::source : &IndexPair::target,
                            max_edges);
    });
    on_both(progress, [&](bool is_source, Progress&) {
        for (Edge& edge : edges[is_source ? 0 : 1])
            for (std::size_t end = 0; end < 2; ++end) {
                const auto [s, d] = pairs[to_size(edge.pairs[end])];
                edge.source_spacing[end] = (*spacing[0])[s];
                edge.target_spacing[end] = (*spacing[1])[d];
            }
    });

    std::vector<Cracks> cracks;
    for (const double t : times) {
        const Frame frame{source.positions, target.positions, pairs, t};
        cracks.push_back({t, std::max(open_share(edges[0], frame, progress),
                                      open_share(edges[1], frame, progress))});
    }
    return cracks;
}

}  // namespace pointmorph

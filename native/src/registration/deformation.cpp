#include "pointmorph/registration/deformation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

#include "base/compiler.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "registration/padded_columns.hpp"

namespace pointmorph {

namespace {

constexpr double kReach = 2.4;       // spacings within which a point looks for its nodes
constexpr double kEdgeLength = 2.1;  // spacings between nodes that hold one another

constexpr double kEndless = std::numeric_limits<double>::infinity();

/// Nodes near every point, ascending by distance: (distance, node).
using Nearby = std::vector<std::vector<std::pair<double, Index>>>;

/// The nearest row that `is_wanted`, and how far it is: the first such of search.from(source,
/// limit), looked for within a reach that grows, since most are near. A row of −1 where there is
/// none.
template <class IsWanted>
std::pair<Index, double> first_near(GeodesicSearch& search, Index source, double reach,
                                    double limit, IsWanted&& is_wanted) {
    constexpr int kSteps = 5;
    for (int step = 0; step <= kSteps; ++step, reach *= 2.0) {
        const bool is_last = step == kSteps || !(reach < limit);
        for (const auto& [i, distance] : search.from(source, is_last ? limit : reach))
            if (is_wanted(i)) return {i, distance};
        if (is_last) break;
    }
    return {-1, limit};
}

Nearby nodes_near_points(const SurfaceGraph& graph, const Subset& subset, Progress& progress) {
    const auto count = to_index(subset.rows.size());
    std::vector<std::vector<std::pair<Index, double>>> balls(to_size(count));
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            GeodesicSearch search(graph);
            for (Index k = begin; k < end; ++k) {
                const auto ball = search.reached(subset.rows[to_size(k)], kReach * subset.radius);
                balls[to_size(k)].assign(ball.begin(), ball.end());
            }
        },
        0.0, 0.8, 64);
    Nearby nearby(to_size(graph.size()));
    for (Index k = 0; k < count; ++k)
        for (const auto& [i, distance] : balls[to_size(k)])
            nearby[to_size(i)].emplace_back(distance, k);
    // A point out of every node's reach (an edge longer than the reach) takes the nearest node.
    std::vector<Index> lost;
    for (Index i = 0; i < graph.size(); ++i)
        if (nearby[to_size(i)].empty()) lost.push_back(i);
    if (!lost.empty()) {
        std::vector<Index> node_of(to_size(graph.size()), -1);
        for (Index k = 0; k < count; ++k) node_of[to_size(subset.rows[to_size(k)])] = k;
        GeodesicSearch search(graph);
        for (const Index i : lost) {
            const auto [j, distance] =
                first_near(search, i, 2.0 * kReach * subset.radius, kEndless,
                           [&](Index row) { return node_of[to_size(row)] >= 0; });
            if (j >= 0) nearby[to_size(i)].emplace_back(distance, node_of[to_size(j)]);
            progress.report(0.8);
        }
    }
    for (auto& list : nearby) std::ranges::sort(list);
    return nearby;
}

/// Edges between nodes as adjacency lists; every component of them hangs together with the rest.
std::vector<std::vector<Index>> node_edges(const SurfaceGraph& graph, const Subset& subset,
                                           const Nearby& nearby, Progress& progress) {
    const auto count = to_index(subset.rows.size());
    std::vector<std::vector<Index>> edges(to_size(count));
    for (Index k = 0; k < count; ++k)
        for (const auto& [distance, other] : nearby[to_size(subset.rows[to_size(k)])])
            if (other != k && distance < kEdgeLength * subset.radius) {
                edges[to_size(k)].push_back(other);
                edges[to_size(other)].push_back(k);
            }
    for (auto& list : edges) {
        std::ranges::sort(list);
        list.erase(std::ranges::unique(list).begin(), list.end());
    }
    // Parts that lie far from the rest (an eyeball): walk on from each until another part is met.
    std::vector<Index> node_of(to_size(graph.size()), -1);
    for (Index k = 0; k < count; ++k) node_of[to_size(subset.rows[to_size(k)])] = k;
    GrowingComponents parts(count);
    for (Index k = 0; k < count; ++k)
        for (const Index other : edges[to_size(k)]) parts.join(k, other);
    std::vector<std::vector<Index>> nodes(to_size(count));  // of the part with this root
    for (Index k = 0; k < count; ++k) nodes[to_size(parts.root(k))].push_back(k);
    std::set<std::pair<std::size_t, Index>> by_size;  // sizes and roots
    for (Index k = 0; k < count; ++k)
        if (!nodes[to_size(k)].empty()) by_size.emplace(nodes[to_size(k)].size(), k);
    std::optional<GeodesicSearch> search;
    while (by_size.size() > 1) {
        progress.report(0.8);
        // From the smallest part: the search stays short.
        const Index smallest = by_size.extract(by_size.begin()).value().second;
        std::vector<Index> own = std::exchange(nodes[to_size(smallest)], {});
        std::ranges::sort(own);
        if (!search) search.emplace(graph);
        double shortest = kEndless;
        IndexPair bridge{-1, -1};
        for (const Index k : own) {
            const auto [i, distance] = first_near(
                *search, subset.rows[to_size(k)], kReach * subset.radius, shortest, [&](Index row) {
                    const Index other = node_of[to_size(row)];
                    return other >= 0 && parts.root(other) != smallest;
                });
            if (i < 0) continue;
            shortest = distance;
            bridge = {k, node_of[to_size(i)]};
        }
        if (bridge.source < 0) return edges;  // the surface graph itself falls apart
        edges[to_size(bridge.source)].push_back(bridge.target);
        edges[to_size(bridge.target)].push_back(bridge.source);
        std::ranges::sort(edges[to_size(bridge.source)]);
        std::ranges::sort(edges[to_size(bridge.target)]);
        const Index other = parts.root(bridge.target);
        std::vector<Index> all = std::exchange(nodes[to_size(other)], {});
        by_size.erase({all.size(), other});
        all.insert(all.end(), own.begin(), own.end());
        parts.join(smallest, other);
        const Index root = parts.root(other);
        by_size.emplace(all.size(), root);
        nodes[to_size(root)] = std::move(all);
    }
    return edges;
}

}  // namespace

DeformationGraph deformation_graph(const SurfaceGraph& graph, const Subset& subset,
                                   Progress& progress) {
    DeformationGraph result;
    result.node_rows = subset.rows;
    result.spacing = subset.radius;
    const Nearby nearby = nodes_near_points(graph, subset, progress);

    result.point_nodes.resize(to_size(graph.size()));
    result.point_weights.resize(to_size(graph.size()));
    for (Index i = 0; i < graph.size(); ++i) {
        const auto& list = nearby[to_size(i)];
        auto& nodes = result.point_nodes[to_size(i)];
        auto& weights = result.point_weights[to_size(i)];
        const auto used = std::min<std::size_t>(list.size(), kNodesPerPoint);
        const double farthest = 1.05 * std::max(list[used - 1].first, 1e-9);
        double sum = 0.0;
        for (std::size_t k = 0; k < used; ++k) {
            nodes[k] = list[k].second;
            weights[k] = std::pow(1.0 - list[k].first / farthest, 2);
            sum += weights[k];
        }
        for (std::size_t k = 0; k < used; ++k) weights[k] /= sum;
        for (std::size_t k = used; k < kNodesPerPoint; ++k) {
            nodes[k] = nodes[0];
            weights[k] = 0.0;
        }
    }

    const auto edges = node_edges(graph, subset, nearby, progress);
    for (const auto& list : edges) {
        for (const Index j : list) {
            result.edge_ends.push_back(j);
            result.edge_weights.push_back(
                1.0 / std::sqrt(static_cast<double>(list.size() * edges[to_size(j)].size())));
        }
        result.edge_offsets.push_back(static_cast<std::int64_t>(result.edge_ends.size()));
    }
    result.pattern = deformation_pattern(result);
    return result;
}

SurfaceGraph node_graph(const Positions& positions, const DeformationGraph& nodes) {
    constexpr double kShortest = 1e-12;
    SurfaceGraph graph;
    graph.offsets = nodes.edge_offsets;
    graph.neighbors = nodes.edge_ends;
    for (Index i = 0; i < nodes.size(); ++i)
        for (auto e = nodes.edge_offsets[to_size(i)]; e < nodes.edge_offsets[to_size(i) + 1]; ++e) {
            const Index j = nodes.edge_ends[to_size(e)];
            graph.lengths.push_back(
                std::max(kShortest, (positions.row(nodes.node_rows[to_size(i)]) -
                                     positions.row(nodes.node_rows[to_size(j)]))
                                        .norm()));
        }
    return graph;
}

namespace {

/// Of the edges around a node: their covariance, column by column, then Σ w |e|²; two zeros.
using Moments = std::array<double, 12>;

/// Moments of all nodes, averaged over the node graph some times.
class NodeMoments {
public:
    NodeMoments(const Positions& positions, const DeformationGraph& graph,
                const Deformation& deformation, int smoothing)
        : graph_(graph), moments_(to_size(graph.size())), average_(moments_.size()) {
        rest_.reserve(moments_.size());
        now_.reserve(moments_.size());
        for (Index i = 0; i < graph.size(); ++i) {
            const Index row = graph.node_rows[to_size(i)];
            rest_.push_back(padded(Vector3(positions.row(row).transpose())));
            now_.push_back(padded(Vector3(deformation.positions.row(i).transpose())));
        }
        if (has_wide_registers())
            find_wide(smoothing);
        else
            find<TwoTwos>(smoothing);
    }

    const Moments& of(Index node) const { return moments_[to_size(node)]; }

private:
    POINTMORPH_WIDE void find_wide(int smoothing) { find<Four>(smoothing); }

    template <class Numbers>
    POINTMORPH_INLINE void find(int smoothing) {
        for (std::size_t i = 0; i < moments_.size(); ++i) add_up_edges<Numbers>(i);
        for (int round = 0; round < smoothing; ++round) {
            for (std::size_t i = 0; i < moments_.size(); ++i) average<Numbers>(i);
            moments_.swap(average_);
        }
    }

    template <class Numbers>
    POINTMORPH_INLINE void add_up_edges(std::size_t i) {
        Numbers columns[3]{}, own, step;
        double squares = 0.0;
        load(now_[i], own);
        for (auto e = to_size(graph_.edge_offsets[i]); e < to_size(graph_.edge_offsets[i + 1]);
             ++e) {
            const auto j = to_size(graph_.edge_ends[e]);
            const double weight = graph_.edge_weights[e];
            const double rest[3] = {rest_[j][0] - rest_[i][0], rest_[j][1] - rest_[i][1],
                                    rest_[j][2] - rest_[i][2]};
            load(now_[j], step);
            step -= own;
            step = weight * step;
            POINTMORPH_UNROLL
            for (std::size_t c = 0; c < 3; ++c) columns[c] += rest[c] * step;
            squares += weight * (rest[0] * rest[0] + rest[1] * rest[1] + rest[2] * rest[2]);
        }
        Moments& moments = moments_[i];
        POINTMORPH_UNROLL
        for (std::size_t c = 0; c < 3; ++c) store(columns[c], moments.data() + 3 * c);
        moments[9] = squares;
    }

    template <class Numbers>
    POINTMORPH_INLINE void average(std::size_t i) {
        Numbers sums[3], its;
        POINTMORPH_UNROLL
        for (std::size_t k = 0; k < 3; ++k) load(moments_[i].data() + 4 * k, sums[k]);
        double weights = 1.0;
        for (auto e = to_size(graph_.edge_offsets[i]); e < to_size(graph_.edge_offsets[i + 1]);
             ++e) {
            const double* const other = moments_[to_size(graph_.edge_ends[e])].data();
            POINTMORPH_UNROLL
            for (std::size_t k = 0; k < 3; ++k) {
                load(other + 4 * k, its);
                sums[k] += graph_.edge_weights[e] * its;
            }
            weights += graph_.edge_weights[e];
        }
        Moments& average = average_[i];
        POINTMORPH_UNROLL
        for (std::size_t k = 0; k < 3; ++k) {
            std::array<double, 4> its_sums;
            store(sums[k], its_sums.data());
            for (std::size_t d = 0; d < 4; ++d) average[4 * k + d] = its_sums[d] / weights;
        }
    }

    const DeformationGraph& graph_;
    std::vector<PaddedColumn> rest_, now_;  ///< places of the nodes
    std::vector<Moments> moments_, average_;
};

}  // namespace

void fit_similarities(const Positions& positions, const DeformationGraph& graph, int smoothing,
                      double largest_scale, Deformation& deformation) {
    const Index count = graph.size();
    const NodeMoments moments(positions, graph, deformation, smoothing);
    std::vector<Matrix3> covariances(to_size(count));
    for (Index i = 0; i < count; ++i)
        covariances[to_size(i)] = Eigen::Map<const Matrix3>(moments.of(i).data());
    std::vector<BestRotation> best(covariances.size());
    best_rotations(covariances, best);
    deformation.rotations.resize(to_size(count));
    deformation.scales.resize(count);
    for (Index i = 0; i < count; ++i) {
        const auto& [rotation, trace] = best[to_size(i)];
        deformation.rotations[to_size(i)] = rotation;
        const double scale = trace / std::max(moments.of(i)[9], 1e-300);
        deformation.scales[i] = std::clamp(scale, 1.0 / largest_scale, largest_scale);
    }
}

namespace {

/// Moves points with their nodes: X(p) = Σ w (linear_k p + constant_k).
class Blending {
public:
    /// `normals`: null for none.
    Blending(const Positions& positions, const Normals* normals, const DeformationGraph& graph,
             const Deformation& deformation)
        : positions_(positions), normals_(normals), graph_(graph), moves_(to_size(graph.size())) {
        for (std::size_t k = 0; k < moves_.size(); ++k) {
            Move& move = moves_[k];
            const Matrix3& rotation = deformation.rotations[k];
            move.linear = scaled(rotation, deformation.scales[to_index(k)]);
            const double* const to = deformation.positions.data() + 3 * k;
            const PaddedColumn rest =
                product(move.linear, positions.data() + 3 * graph.node_rows[k]);
            move.constant = {to[0] - rest[0], to[1] - rest[1], to[2] - rest[2], 0.0};
            if (normals) move.rotation = padded(rotation);
        }
    }

    DeformedCloud of(std::span<const Index> rows) const {
        const auto size = static_cast<Eigen::Index>(rows.size());
        DeformedCloud cloud{Positions(size, 3), Normals(normals_ ? size : 0, 3),
                            std::vector<Matrix3>(rows.size())};
        if (has_wide_registers())
            place_all_wide(rows, cloud);
        else
            place_all<TwoTwos>(rows, cloud);
        return cloud;
    }

private:
    struct Move {
        PaddedColumns linear;
        PaddedColumn constant;
        PaddedColumns rotation;
    };

    POINTMORPH_WIDE void place_all_wide(std::span<const Index> rows, DeformedCloud& cloud) const {
        place_all<Four>(rows, cloud);
    }

    template <class Numbers>
    POINTMORPH_INLINE void place_all(std::span<const Index> rows, DeformedCloud& cloud) const {
        for (std::size_t r = 0; r < rows.size(); ++r) place<Numbers>(rows[r], r, cloud);
    }

    template <class Numbers>
    POINTMORPH_INLINE void place(Index i, std::size_t row, DeformedCloud& cloud) const {
        Numbers linear[3]{}, rotation[3]{}, constant{}, its, place, turned;
        for (std::size_t k = 0; k < kNodesPerPoint; ++k) {
            const double w = graph_.point_weights[to_size(i)][k];
            const Move& move = moves_[to_size(graph_.point_nodes[to_size(i)][k])];
            for (std::size_t c = 0; c < 3; ++c) {
                load(move.linear[c], its);
                linear[c] += w * its;
            }
            load(move.constant, its);
            constant += w * its;
            if (!normals_) continue;
            for (std::size_t c = 0; c < 3; ++c) {
                load(move.rotation[c], its);
                rotation[c] += w * its;
            }
        }
        for (std::size_t c = 0; c < 3; ++c)
            store_three(linear[c], cloud.linear[row].data() + 3 * c);
        multiply(linear[0], linear[1], linear[2], positions_.data() + 3 * i, place);
        place += constant;
        store_three(place, cloud.positions.data() + 3 * row);
        if (!normals_) return;
        const double* const rest = normals_->data() + 3 * i;
        multiply(rotation[0], rotation[1], rotation[2], rest, turned);
        const double length =
            std::sqrt(turned[0] * turned[0] + turned[1] * turned[1] + turned[2] * turned[2]);
        double* const normal = cloud.normals.data() + 3 * row;
        for (int d = 0; d < 3; ++d) normal[d] = length > 1e-9 ? turned[d] / length : rest[d];
    }

    const Positions& positions_;
    const Normals* const normals_;
    const DeformationGraph& graph_;
    std::vector<Move> moves_;  ///< of the nodes
};

std::vector<Index> all_rows(const Positions& positions) {
    std::vector<Index> rows(to_size(positions.rows()));
    std::iota(rows.begin(), rows.end(), 0);
    return rows;
}

}  // namespace

DeformedCloud deformed(const Positions& positions, const Normals& normals,
                       const DeformationGraph& graph, const Deformation& deformation,
                       std::span<const Index> rows) {
    return Blending(positions, &normals, graph, deformation).of(rows);
}

DeformedCloud deformed(const Positions& positions, const Normals& normals,
                       const DeformationGraph& graph, const Deformation& deformation) {
    return Blending(positions, &normals, graph, deformation).of(all_rows(positions));
}

DeformedCloud deformed_places(const Positions& positions, const DeformationGraph& graph,
                              const Deformation& deformation) {
    return Blending(positions, nullptr, graph, deformation).of(all_rows(positions));
}

}  // namespace pointmorph

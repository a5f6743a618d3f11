#include "pointmorph/registration/deformation.hpp"

#include <Eigen/OrderingMethods>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

#include "base/compiler.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/similarity.hpp"

namespace pointmorph {

namespace {

constexpr int kNodes = kNodesPerPoint;
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

/// Where the factor has entries, by the elimination tree (Davis, LDL, 2005).
void analyze_factor(DeformationPattern& pattern) {
    const auto count = to_index(pattern.matrix.cols());
    const Index* const outer = pattern.matrix.outerIndexPtr();
    const Index* const inner = pattern.matrix.innerIndexPtr();
    std::vector<Index> parent(to_size(count), -1), seen(to_size(count), -1), path;
    std::vector<std::vector<Index>> below(to_size(count));  // rows under each diagonal
    pattern.row_begins = {0};
    for (Index k = 0; k < count; ++k) {
        seen[to_size(k)] = k;
        std::vector<Index> row;
        for (Index e = outer[k]; e < outer[k + 1]; ++e) {
            path.clear();
            for (Index i = inner[e]; seen[to_size(i)] != k; i = parent[to_size(i)]) {
                if (parent[to_size(i)] < 0) parent[to_size(i)] = k;
                path.push_back(i);
                seen[to_size(i)] = k;
            }
            row.insert(row.begin(), path.begin(), path.end());
        }
        for (const Index i : row) {
            pattern.row_columns.push_back(i);
            pattern.row_places.push_back(to_index(below[to_size(i)].size()) + 1);
            below[to_size(i)].push_back(k);
        }
        pattern.row_begins.push_back(to_index(pattern.row_columns.size()));
    }
    for (Index i = 0; i < count; ++i) {
        pattern.columns.push_back(to_index(pattern.rows.size()));
        pattern.rows.push_back(i);
        pattern.rows.insert(pattern.rows.end(), below[to_size(i)].begin(), below[to_size(i)].end());
        auto from = to_index(pattern.rows.size()) - 1;
        while (from > pattern.columns.back() + 1 &&
               pattern.rows[to_size(from)] == pattern.rows[to_size(from - 1)] + 1)
            --from;
        pattern.dense_from.push_back(from);
    }
    pattern.columns.push_back(to_index(pattern.rows.size()));
    for (std::size_t e = 0; e < pattern.row_places.size(); ++e)
        pattern.row_places[e] += pattern.columns[to_size(pattern.row_columns[e])];
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
        const auto used = std::min<std::size_t>(list.size(), kNodes);
        const double farthest = 1.05 * std::max(list[used - 1].first, 1e-9);
        double sum = 0.0;
        for (std::size_t k = 0; k < used; ++k) {
            nodes[k] = list[k].second;
            weights[k] = std::pow(1.0 - list[k].first / farthest, 2);
            sum += weights[k];
        }
        for (std::size_t k = 0; k < used; ++k) weights[k] /= sum;
        for (std::size_t k = used; k < kNodes; ++k) {
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

std::shared_ptr<const DeformationPattern> deformation_pattern(const DeformationGraph& graph) {
    const Index count = graph.size();
    std::vector<std::vector<Index>> columns(to_size(count));  // rows ≥ column
    const auto add = [&](Index i, Index j) {
        columns[to_size(std::min(i, j))].push_back(std::max(i, j));
    };
    for (Index i = 0; i < count; ++i) {
        add(i, i);
        for (auto e = to_size(graph.edge_offsets[to_size(i)]);
             e < to_size(graph.edge_offsets[to_size(i) + 1]); ++e)
            if (graph.edge_ends[e] > i) add(i, graph.edge_ends[e]);
    }
    for (const auto& nodes : graph.point_nodes)
        for (std::size_t k = 0; k < kNodes; ++k)
            for (std::size_t l = 0; l < k; ++l) add(nodes[k], nodes[l]);
    for (auto& rows : columns) {
        std::ranges::sort(rows);
        rows.erase(std::ranges::unique(rows).begin(), rows.end());
    }

    DeformationPattern::Matrix lower(count, count);
    std::vector<Eigen::Triplet<double, Index>> entries;
    for (Index j = 0; j < count; ++j)
        for (const Index i : columns[to_size(j)]) entries.emplace_back(i, j, 1.0);
    lower.setFromTriplets(entries.begin(), entries.end());
    DeformationPattern::Matrix whole = lower.selfadjointView<Eigen::Lower>();
    Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, Index> node_of;
    Eigen::AMDOrdering<Index>()(whole, node_of);
    const auto row_of = node_of.inverse().eval();

    DeformationPattern result;
    result.order.assign(row_of.indices().data(), row_of.indices().data() + count);
    result.matrix.resize(count, count);
    result.matrix.selfadjointView<Eigen::Upper>() =
        lower.selfadjointView<Eigen::Lower>().twistedBy(row_of);
    std::fill_n(result.matrix.valuePtr(), result.matrix.nonZeros(), 0.0);

    // Columns are short, so that counting what comes before is quicker than halving.
    const auto place = [&](Index i, Index j) {
        const auto [row, column] = std::minmax(result.order[to_size(i)], result.order[to_size(j)]);
        const Index* const inner = result.matrix.innerIndexPtr();
        Index k = result.matrix.outerIndexPtr()[column];
        while (inner[k] != row) ++k;
        return k;
    };
    result.diagonal.resize(to_size(count));
    result.laplacian.assign(graph.edge_ends.size(), -1);
    for (Index i = 0; i < count; ++i) {
        result.diagonal[to_size(i)] = place(i, i);
        for (auto e = to_size(graph.edge_offsets[to_size(i)]);
             e < to_size(graph.edge_offsets[to_size(i) + 1]); ++e)
            if (graph.edge_ends[e] < i) result.laplacian[e] = place(i, graph.edge_ends[e]);
    }
    result.blocks.resize(graph.point_nodes.size());
    for (std::size_t p = 0; p < result.blocks.size(); ++p) {
        std::size_t b = 0;
        for (std::size_t k = 0; k < kNodes; ++k)
            for (std::size_t l = 0; l <= k; ++l)
                result.blocks[p][b++] = place(graph.point_nodes[p][k], graph.point_nodes[p][l]);
    }
    analyze_factor(result);
    return std::make_shared<const DeformationPattern>(std::move(result));
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

void fit_similarities(const Positions& positions, const DeformationGraph& graph, int smoothing,
                      double largest_scale, Deformation& deformation) {
    const Index count = graph.size();
    using Moments = Eigen::Matrix<double, 10, 1>;  // 3 × 3 covariance, then Σ w |e|²
    std::vector<Moments> moments(to_size(count), Moments::Zero()), average(to_size(count));
    for (Index i = 0; i < count; ++i) {
        auto& m = moments[to_size(i)];
        Eigen::Map<Matrix3> covariance(m.data());
        for (auto e = to_size(graph.edge_offsets[to_size(i)]);
             e < to_size(graph.edge_offsets[to_size(i) + 1]); ++e) {
            const Index j = graph.edge_ends[e];
            const Vector3 rest = (positions.row(graph.node_rows[to_size(j)]) -
                                  positions.row(graph.node_rows[to_size(i)]))
                                     .transpose();
            const Vector3 now =
                (deformation.positions.row(j) - deformation.positions.row(i)).transpose();
            covariance.noalias() += graph.edge_weights[e] * now * rest.transpose();
            m[9] += graph.edge_weights[e] * rest.squaredNorm();
        }
    }
    for (int round = 0; round < smoothing; ++round) {
        for (Index i = 0; i < count; ++i) {
            Moments sum = moments[to_size(i)];
            double weights = 1.0;
            for (auto e = to_size(graph.edge_offsets[to_size(i)]);
                 e < to_size(graph.edge_offsets[to_size(i) + 1]); ++e) {
                sum += graph.edge_weights[e] * moments[to_size(graph.edge_ends[e])];
                weights += graph.edge_weights[e];
            }
            average[to_size(i)] = sum / weights;
        }
        moments.swap(average);
    }
    std::vector<Matrix3> covariances(to_size(count));
    for (std::size_t i = 0; i < covariances.size(); ++i)
        covariances[i] = Eigen::Map<const Matrix3>(moments[i].data());
    std::vector<BestRotation> best(covariances.size());
    best_rotations(covariances, best);
    deformation.rotations.resize(to_size(count));
    deformation.scales.resize(count);
    for (Index i = 0; i < count; ++i) {
        const auto& [rotation, trace] = best[to_size(i)];
        deformation.rotations[to_size(i)] = rotation;
        const double scale = trace / std::max(moments[to_size(i)][9], 1e-300);
        deformation.scales[i] = std::clamp(scale, 1.0 / largest_scale, largest_scale);
    }
}

namespace {

/// `normals`: null for none.
DeformedCloud deform(const Positions& positions, const Normals* normals,
                     const DeformationGraph& graph, const Deformation& deformation,
                     std::span<const Index> rows) {
    // X(p) = Σ w (linear_k p + constant_k)
    const Index count = graph.size();
    std::vector<Matrix3> linear_of(to_size(count));
    std::vector<Vector3> constant_of(to_size(count));
    for (Index k = 0; k < count; ++k) {
        linear_of[to_size(k)] = deformation.scales[k] * deformation.rotations[to_size(k)];
        constant_of[to_size(k)] =
            deformation.positions.row(k).transpose() -
            linear_of[to_size(k)] * positions.row(graph.node_rows[to_size(k)]).transpose();
    }
    const auto size = static_cast<Eigen::Index>(rows.size());
    DeformedCloud result{Positions(size, 3), Normals(normals ? size : 0, 3),
                         std::vector<Matrix3>(rows.size())};
    for (std::size_t r = 0; r < rows.size(); ++r) {
        const Index i = rows[r];
        const Vector3 p = positions.row(i).transpose();
        Matrix3 linear = Matrix3::Zero(), rotation = Matrix3::Zero();
        Vector3 constant = Vector3::Zero();
        for (std::size_t k = 0; k < kNodes; ++k) {
            const double w = graph.point_weights[to_size(i)][k];
            const auto node = to_size(graph.point_nodes[to_size(i)][k]);
            if (normals) rotation += w * deformation.rotations[node];
            linear += w * linear_of[node];
            constant += w * constant_of[node];
        }
        const auto row = static_cast<Eigen::Index>(r);
        result.positions.row(row) = linear * p + constant;
        result.linear[r] = linear;
        if (!normals) continue;
        const Vector3 normal = rotation * normals->row(i).transpose();
        const double length = normal.norm();
        if (length > 1e-9)
            result.normals.row(row) = normal / length;
        else
            result.normals.row(row) = normals->row(i);
    }
    return result;
}

std::vector<Index> all_rows(const Positions& positions) {
    std::vector<Index> rows(to_size(positions.rows()));
    std::iota(rows.begin(), rows.end(), 0);
    return rows;
}

}  // namespace

DeformedCloud deformed(const Positions& positions, const Normals& normals,
                       const DeformationGraph& graph, const Deformation& deformation,
                       std::span<const Index> rows) {
    return deform(positions, &normals, graph, deformation, rows);
}

DeformedCloud deformed(const Positions& positions, const Normals& normals,
                       const DeformationGraph& graph, const Deformation& deformation) {
    return deform(positions, &normals, graph, deformation, all_rows(positions));
}

DeformedCloud deformed_places(const Positions& positions, const DeformationGraph& graph,
                              const Deformation& deformation) {
    return deform(positions, nullptr, graph, deformation, all_rows(positions));
}

namespace {

/// Row by row: what is left of a row once the columns before have been taken from it. Diagonals are
/// stored as their inverses.
POINTMORPH_INLINE void fill_factor(const DeformationPattern& p, std::span<const double> matrix,
                                   std::span<double> its_factor) {
    const Index count = to_index(p.order.size());
    const Index* const outer = p.matrix.outerIndexPtr();
    const Index* const inner = p.matrix.innerIndexPtr();
    double* const POINTMORPH_RESTRICT factor = its_factor.data();
    std::vector<double> left(to_size(count), 0.0);
    double* const POINTMORPH_RESTRICT row = left.data();
    for (Index k = 0; k < count; ++k) {
        for (Index e = outer[k]; e < outer[k + 1]; ++e) row[inner[e]] = matrix[to_size(e)];
        double diagonal = row[k];
        for (Index e = p.row_begins[to_size(k)]; e < p.row_begins[to_size(k) + 1]; ++e) {
            const Index i = p.row_columns[to_size(e)], end = p.row_places[to_size(e)];
            const Index begin = p.columns[to_size(i)];
            const double entry = row[i] * factor[begin];
            row[i] = 0.0;
            const Index dense = std::min(p.dense_from[to_size(i)], end);
            Index at = begin + 1;
            for (; at < dense; ++at) row[p.rows[to_size(at)]] -= factor[at] * entry;
            if (at < end) {
                double* const POINTMORPH_RESTRICT rest = row + p.rows[to_size(at)];
                for (Index j = 0; j < end - at; ++j) rest[j] -= factor[at + j] * entry;
            }
            diagonal -= entry * entry;
            factor[end] = entry;
        }
        row[k] = 0.0;
        factor[p.columns[to_size(k)]] = 1.0 / std::sqrt(std::max(diagonal, 1e-300));
    }
}

POINTMORPH_WIDE void fill_factor_wide(const DeformationPattern& pattern,
                                      std::span<const double> matrix, std::span<double> factor) {
    fill_factor(pattern, matrix, factor);
}

/// Three numbers, and one that is 0.
using FourOfRow = std::array<double, 4>;

/// Solves L Lᵀ x = b for three right sides at once, in place.
POINTMORPH_INLINE void substitute(const DeformationPattern& p, std::span<const double> factor,
                                  std::vector<FourOfRow>& sides) {
    const std::size_t count = sides.size();
    Four here, there;
    for (std::size_t k = 0; k < count; ++k) {
        const auto begin = to_size(p.columns[k]), end = to_size(p.columns[k + 1]);
        std::memcpy(&here, sides[k].data(), sizeof here);
        here = factor[begin] * here;
        std::memcpy(sides[k].data(), &here, sizeof here);
        for (std::size_t at = begin + 1; at < end; ++at) {
            double* const row = sides[to_size(p.rows[at])].data();
            std::memcpy(&there, row, sizeof there);
            there -= factor[at] * here;
            std::memcpy(row, &there, sizeof there);
        }
    }
    for (std::size_t k = count; k-- > 0;) {
        const auto begin = to_size(p.columns[k]), end = to_size(p.columns[k + 1]);
        std::memcpy(&here, sides[k].data(), sizeof here);
        for (std::size_t at = begin + 1; at < end; ++at) {
            std::memcpy(&there, sides[to_size(p.rows[at])].data(), sizeof there);
            here -= factor[at] * there;
        }
        here = factor[begin] * here;
        std::memcpy(sides[k].data(), &here, sizeof here);
    }
}

POINTMORPH_WIDE void substitute_wide(const DeformationPattern& pattern,
                                     std::span<const double> factor,
                                     std::vector<FourOfRow>& sides) {
    substitute(pattern, factor, sides);
}

}  // namespace

DeformationSolver::DeformationSolver(const Positions& positions, const DeformationGraph& graph)
    : positions_(positions),
      graph_(graph),
      pattern_(*graph.pattern),
      matrix_(to_size(graph.pattern->matrix.nonZeros())),
      factor_(graph.pattern->rows.size()) {}

void DeformationSolver::factorize(double stiffness, std::span<const Attraction> attractions) {
    stiffness_ = stiffness;
    double* const values = matrix_.data();
    std::ranges::fill(matrix_, 0.0);
    // A trace of the identity holds what nothing else holds.
    for (Index i = 0; i < graph_.size(); ++i) values[pattern_.diagonal[to_size(i)]] = 1e-9;
    for (Index i = 0; i < graph_.size(); ++i)
        for (auto e = to_size(graph_.edge_offsets[to_size(i)]);
             e < to_size(graph_.edge_offsets[to_size(i) + 1]); ++e) {
            values[pattern_.diagonal[to_size(i)]] += stiffness * graph_.edge_weights[e];
            if (pattern_.laplacian[e] >= 0)
                values[pattern_.laplacian[e]] -= stiffness * graph_.edge_weights[e];
        }
    for (const Attraction& a : attractions) {
        const auto& weights = graph_.point_weights[to_size(a.point)];
        const auto& nodes = graph_.point_nodes[to_size(a.point)];
        const auto& block = pattern_.blocks[to_size(a.point)];
        std::size_t b = 0;
        for (std::size_t k = 0; k < kNodes; ++k)
            for (std::size_t l = 0; l <= k; ++l, ++b)
                values[block[b]] += (k != l && nodes[k] == nodes[l] ? 2.0 : 1.0) * a.weight *
                                    weights[k] * weights[l];
    }
    (has_wide_registers() ? fill_factor_wide : fill_factor)(pattern_, matrix_, factor_);
}

void DeformationSolver::solve(std::span<const Attraction> attractions,
                              Deformation& deformation) const {
    const Index count = graph_.size();
    std::vector<Matrix3> linear(to_size(count));
    Positions constant(count, 3);  // X(p) = Σ w (x_k + linear_k p − constant_k)
    for (Index k = 0; k < count; ++k) {
        linear[to_size(k)] = deformation.scales[k] * deformation.rotations[to_size(k)];
        constant.row(k) =
            linear[to_size(k)] * positions_.row(graph_.node_rows[to_size(k)]).transpose();
    }
    std::vector<FourOfRow> right(to_size(count), FourOfRow{});
    const auto row_of = [&](Index node) {
        return Eigen::Map<Eigen::RowVector3d>(right[to_size(pattern_.order[to_size(node)])].data());
    };
    for (Index i = 0; i < count; ++i)
        for (auto e = to_size(graph_.edge_offsets[to_size(i)]);
             e < to_size(graph_.edge_offsets[to_size(i) + 1]); ++e) {
            const Index j = graph_.edge_ends[e];
            const Vector3 rest = (positions_.row(graph_.node_rows[to_size(i)]) -
                                  positions_.row(graph_.node_rows[to_size(j)]))
                                     .transpose();
            row_of(i) += stiffness_ * graph_.edge_weights[e] * 0.5 *
                         ((linear[to_size(i)] + linear[to_size(j)]) * rest).transpose();
        }
    for (const Attraction& a : attractions) {
        const auto& weights = graph_.point_weights[to_size(a.point)];
        const auto& nodes = graph_.point_nodes[to_size(a.point)];
        const Vector3 p = positions_.row(a.point).transpose();
        Vector3 wanted = a.target;
        for (std::size_t k = 0; k < kNodes; ++k)
            wanted -=
                weights[k] * (linear[to_size(nodes[k])] * p - constant.row(nodes[k]).transpose());
        wanted *= a.weight;
        for (std::size_t k = 0; k < kNodes; ++k)
            row_of(nodes[k]) += weights[k] * wanted.transpose();
    }
    (has_wide_registers() ? substitute_wide : substitute)(pattern_, factor_, right);
    deformation.positions.resize(count, 3);
    for (Index i = 0; i < count; ++i) deformation.positions.row(i) = row_of(i);
}

}  // namespace pointmorph

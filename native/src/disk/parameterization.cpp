#include "pointmorph/disk/parameterization.hpp"

#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <numeric>
#include <utility>

#include "disk/disk_system.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

namespace {

/// Neighbors whose normals agree less than this lie on the other side of a thin sheet.
constexpr double kOpposed = -0.1;

/// Shorter distances count as this share of the spacing, so that reciprocal-distance weights stay
/// finite where points coincide.
constexpr double kClosest = 1e-3;

/// Fewer boundary points can't carry the shape of a disk.
constexpr std::size_t kFewestBoundaryNodes = 12;

using SparseMatrix = Eigen::SparseMatrix<double>;
using Clock = std::chrono::steady_clock;

/// Length along the closed loop from its first point to each point, and all around at the end.
std::vector<double> arc_lengths(const Positions& positions, std::span<const Index> loop,
                                BoundarySpacing spacing) {
    std::vector<double> along(loop.size() + 1, 0.0);
    for (std::size_t i = 0; i < loop.size(); ++i) {
        const Index next = loop[(i + 1) % loop.size()];
        const double step = spacing == BoundarySpacing::kUniform
                                ? 1.0
                                : (positions.row(next) - positions.row(loop[i])).norm();
        along[i + 1] = along[i] + step;
    }
    if (!(along.back() > 0.0)) std::iota(along.begin(), along.end(), 0.0);  // all coincide
    return along;
}

/// Remainder in [0, divisor).
double modulo(double value, double divisor) {
    const double remainder = std::fmod(value, divisor);
    return remainder < 0.0 ? remainder + divisor : remainder;
}

/// The points of the linear system: all of the cloud, or those of the simplified cloud.
struct Nodes {
    Positions positions;
    Normals normals;
    Neighborhoods neighbors;        ///< mutual
    std::vector<double> angle;      ///< of boundary nodes
    std::vector<char> on_boundary;  ///< #nodes
    Values weight;                  ///< how many points of the cloud each stands for
    double closest = 0.0;           ///< the shortest distance that weights distinguish

    explicit Nodes(Index count)
        : positions(count, 3),
          normals(count, 3),
          angle(to_size(count), 0.0),
          on_boundary(to_size(count), 0),
          weight(Values::Ones(count)) {}

    Index size() const { return to_index(positions.rows()); }

    void put_on_boundary(Index node, double its_angle) {
        on_boundary[to_size(node)] = 1;
        angle[to_size(node)] = its_angle;
    }
};

double median_spacing(const Positions& positions, const Neighborhoods& nearest) {
    Values spacing = local_spacing(positions, nearest);
    const auto middle = spacing.data() + spacing.size() / 2;
    std::nth_element(spacing.data(), middle, spacing.data() + spacing.size());
    return *middle;
}

/// Nodes of components without a boundary node.
std::vector<char> unreached(const Nodes& nodes, const ConnectedComponents& components) {
    std::vector<char> reached(to_size(components.count()), 0);
    for (std::size_t i = 0; i < nodes.on_boundary.size(); ++i)
        if (nodes.on_boundary[i]) reached[to_size(components.label[i])] = 1;
    std::vector<char> result(nodes.on_boundary.size());
    for (std::size_t i = 0; i < result.size(); ++i)
        result[i] = !reached[to_size(components.label[i])];
    return result;
}

/// Joins mutual neighbors on the same side of thin parts. A component that this cuts off from the
/// boundary gets its neighbors on the other side back; what is still cut off is tied to the rest or
/// an error. Returns how many points that concerns.
Index connect(Nodes& nodes, const Neighborhoods& nearest, bool join_parts,
              const std::string& name) {
    const auto same_side = [&](Index i, Index j) {
        return nodes.normals.row(i).dot(nodes.normals.row(j)) > kOpposed;
    };
    nodes.closest = kClosest * median_spacing(nodes.positions, nearest);
    nodes.neighbors = symmetrized(filtered(nearest, same_side));
    auto lost = unreached(nodes, connected_components(nodes.neighbors));
    if (std::ranges::find(lost, 1) == lost.end()) return 0;

    nodes.neighbors = symmetrized(filtered(nearest, [&](Index i, Index j) {
        return same_side(i, j) || lost[to_size(i)] || lost[to_size(j)];
    }));
    lost = unreached(nodes, connected_components(nodes.neighbors));
    double points = 0.0;
    for (std::size_t i = 0; i < lost.size(); ++i)
        if (lost[i]) points += nodes.weight[static_cast<Eigen::Index>(i)];
    if (points > 0.0 && join_parts)
        nodes.neighbors = in_one_piece(nodes.positions, std::move(nodes.neighbors));
    else if (points > 0.0)
        throw TopologyError(
            name, "one connected patch",
            std::to_string(std::llround(points)) + " points that aren't connected to the boundary",
            "Remove separate parts, or raise parameterization_neighbors or "
            "parameterization_radius.");
    return to_index(std::llround(points));
}

/// Solves eq. (2) for the nodes that aren't on the boundary. Multiplied by the sum of its weights,
/// row i reads Σ_j w_ij (u_i − u_j) = 0 with w_ij = 1 / ‖x_i − x_j‖, which makes the system
/// symmetric and positive definite: conjugate gradients with an incomplete Cholesky factor.
DiskPoints solve(const Nodes& nodes, const ParameterizationOptions& options,
                 const std::string& name, Parameterization& result, Progress& progress) {
    const auto start = Clock::now();
    DiskPoints disk(nodes.size(), 2);
    std::vector<Index> unknown(to_size(nodes.size()), -1);
    for (Index i = 0; i < nodes.size(); ++i) {
        const auto n = to_size(i);
        if (nodes.on_boundary[n])
            disk.row(i) << std::cos(nodes.angle[n]), std::sin(nodes.angle[n]);
        else
            unknown[n] = result.unknowns++;
    }
    if (result.unknowns == 0) return disk;

    SparseMatrix matrix(result.unknowns, result.unknowns);
    Eigen::VectorXi entries(result.unknowns);
    for (Index i = 0; i < nodes.size(); ++i)
        if (const Index row = unknown[to_size(i)]; row >= 0)
            entries[row] = static_cast<int>(nodes.neighbors[i].size()) + 1;
    matrix.reserve(entries);
    DiskPoints right = DiskPoints::Zero(result.unknowns, 2);
    for (Index i = 0; i < nodes.size(); ++i) {
        const Index row = unknown[to_size(i)];
        if (row < 0) continue;
        double sum = 0.0;
        for (const Index j : nodes.neighbors[i]) {
            const double distance = (nodes.positions.row(i) - nodes.positions.row(j)).norm();
            const double weight = 1.0 / std::max(distance, nodes.closest);
            sum += weight;
            if (const Index column = unknown[to_size(j)]; column >= 0)
                matrix.insert(column, row) = -weight;
            else
                right.row(row) += weight * disk.row(j);
        }
        matrix.insert(row, row) = sum;
    }
    matrix.makeCompressed();
    progress.report(0.0);
    const DiskSolution solution =
        solve_for_disk(matrix, right, options.tolerance, options.max_iterations, progress);
    result.iterations = solution.iterations;
    result.relative_residual = solution.relative_residual;
    if (!(result.relative_residual <= options.tolerance))
        throw ConvergenceError(name, "a relative residual of " + in_short(options.tolerance),
                               in_short(result.relative_residual) + " after " +
                                   std::to_string(result.iterations) + " iterations",
                               "Raise solver_max_iterations or solver_tolerance.");
    for (Index i = 0; i < nodes.size(); ++i)
        if (const Index row = unknown[to_size(i)]; row >= 0) disk.row(i) = solution.points.row(row);
    result.solve_seconds = std::chrono::duration<double>(Clock::now() - start).count();
    return disk;
}

/// The three nodes nearest to `point` among some, as rows with reciprocal-distance weights of sum
/// 1; fewer where there are fewer. Paper, step 3.
struct Corners {
    std::array<Index, 3> rows{-1, -1, -1};
    std::array<double, 3> weights{0.0, 0.0, 0.0};
};

class NearestCorners {
public:
    NearestCorners(const Positions& nodes, double closest) : nodes_(nodes), closest_(closest) {}

    void reset() { count_ = 0; }

    void offer(const Vector3& point, Index node) {
        const double distance = (nodes_.row(node).transpose() - point).squaredNorm();
        if (count_ == 3 && !(distance < squared_[2])) return;
        std::size_t place = count_ < 3 ? count_++ : 2;
        for (; place > 0 && distance < squared_[place - 1]; --place) {
            squared_[place] = squared_[place - 1];
            rows_[place] = rows_[place - 1];
        }
        squared_[place] = distance;
        rows_[place] = node;
    }

    Corners corners() const {
        Corners result;
        double sum = 0.0;
        for (std::size_t c = 0; c < count_; ++c) {
            result.rows[c] = rows_[c];
            result.weights[c] = 1.0 / std::max(std::sqrt(squared_[c]), closest_);
            sum += result.weights[c];
        }
        for (double& weight : result.weights) weight /= sum;
        return result;
    }

private:
    const Positions& nodes_;
    double closest_;
    std::size_t count_ = 0;
    std::array<Index, 3> rows_{};
    std::array<double, 3> squared_{};
};

Neighborhoods neighbors_of(const Positions& positions, const ParameterizationOptions& options,
                           Progress& progress) {
    const KdTree<3> tree(positions);
    auto nearest = nearest_neighbors(tree, options.neighbors, progress);
    if (!options.radius) return nearest;
    return radius_neighbors(tree, *options.radius * median_spacing(positions, nearest), progress);
}

/// The first `count` neighbors of every point.
Neighborhoods first_neighbors(const Neighborhoods& nearest, Index count) {
    Neighborhoods some;
    for (Index i = 0; i < nearest.size(); ++i) {
        const auto near =
            nearest[i].first(std::min<std::size_t>(nearest[i].size(), to_size(count)));
        some.indices.insert(some.indices.end(), near.begin(), near.end());
        some.offsets.push_back(static_cast<std::int64_t>(some.indices.size()));
    }
    return some;
}

Parameterization solve_all(const SampledSurface& patch, const CircleBoundary& boundary,
                           const ParameterizationOptions& options, Progress& progress) {
    Nodes nodes(patch.size());
    nodes.positions = patch.positions;
    nodes.normals = patch.normals;
    for (std::size_t i = 0; i < boundary.loop.size(); ++i)
        nodes.put_on_boundary(boundary.loop[i], boundary.angles[i]);
    Parameterization result;
    result.joined = connect(nodes,
                            options.radius ? neighbors_of(patch.positions, options, progress)
                                           : first_neighbors(patch.nearest, options.neighbors),
                            options.join_parts, patch.name);
    const Progress::Part part(progress, 0.2, 1.0);
    result.points = solve(nodes, options, patch.name, result, progress);
    return result;
}

/// Clusters of a patch's interior points.
Lod interior_clusters(const SampledSurface& patch, const CircleBoundary& boundary,
                      const LodOptions& options, Progress& progress) {
    std::vector<char> on_loop(to_size(patch.size()), 0);
    for (const Index row : boundary.loop) on_loop[to_size(row)] = 1;
    std::vector<Index> interior;
    for (Index i = 0; i < patch.size(); ++i)
        if (!on_loop[to_size(i)]) interior.push_back(i);
    return simplify(patch.positions, interior, options, progress);
}

/// Positions in the loop of the boundary points that become nodes: as many as the interior's
/// simplification suggests, evenly along the loop's length.
std::vector<std::size_t> chosen_on_boundary(const SampledSurface& patch,
                                            std::span<const Index> loop, Index clusters) {
    const auto along = arc_lengths(patch.positions, loop, BoundarySpacing::kChordLength);
    const auto interior = to_size(patch.size()) - loop.size();
    const double thinning =
        std::sqrt(static_cast<double>(interior) / std::max<double>(clusters, 1.0));
    const std::size_t wanted =
        std::clamp(static_cast<std::size_t>(std::ceil(static_cast<double>(loop.size()) / thinning)),
                   std::min(kFewestBoundaryNodes, loop.size()), loop.size());
    std::vector<std::size_t> chosen;
    for (std::size_t i = 0; i < loop.size() && chosen.size() < wanted; ++i)
        if (along[i] >=
            along.back() * static_cast<double>(chosen.size()) / static_cast<double>(wanted))
            chosen.push_back(i);
    return chosen;
}

/// The clusters' centroids, then the chosen boundary points.
Nodes simplified_nodes(const SampledSurface& patch, const CircleBoundary& boundary,
                       const Lod& lod) {
    const auto chosen = chosen_on_boundary(patch, boundary.loop, lod.size());
    Nodes nodes(lod.size() + to_index(chosen.size()));
    nodes.positions.topRows(lod.size()) = lod.centroids;
    for (Index c = 0; c < lod.size(); ++c) {
        Vector3 sum = Vector3::Zero();
        for (const Index row : lod[c]) sum += patch.normals.row(row).transpose();
        nodes.normals.row(c) = sum.normalized().transpose();
        nodes.weight[c] = static_cast<double>(lod[c].size());
    }
    for (std::size_t b = 0; b < chosen.size(); ++b) {
        const Index node = lod.size() + to_index(b);
        nodes.positions.row(node) = patch.positions.row(boundary.loop[chosen[b]]);
        nodes.normals.row(node) = patch.normals.row(boundary.loop[chosen[b]]);
        nodes.put_on_boundary(node, boundary.angles[chosen[b]]);
    }
    return nodes;
}

/// Step 3: every interior point goes to the weighted mean of the nearest nodes' images, among its
/// cluster's and those joined to it.
void embed_points(const SampledSurface& patch, const Lod& lod, const Nodes& nodes,
                  const DiskPoints& disk, DiskPoints& points, Progress& progress) {
    parallel_for(
        lod.size(), progress,
        [&](Index begin, Index end) {
            NearestCorners nearest(nodes.positions, nodes.closest);
            for (Index c = begin; c < end; ++c)
                for (const Index row : lod[c]) {
                    const Vector3 point = patch.positions.row(row);
                    nearest.reset();
                    nearest.offer(point, c);
                    for (const Index neighbor : nodes.neighbors[c]) nearest.offer(point, neighbor);
                    const Corners corners = nearest.corners();
                    Eigen::RowVector2d u = Eigen::RowVector2d::Zero();
                    for (std::size_t k = 0; k < 3; ++k)
                        if (corners.rows[k] >= 0)
                            u += corners.weights[k] * disk.row(corners.rows[k]);
                    points.row(row) = u;
                }
        },
        0.0, 1.0, 64);
}

/// Of the boundary's points; the others are left open.
DiskPoints boundary_on_circle(const SampledSurface& patch, const CircleBoundary& boundary) {
    DiskPoints points(patch.size(), 2);
    for (std::size_t i = 0; i < boundary.loop.size(); ++i)
        points.row(boundary.loop[i]) << std::cos(boundary.angles[i]), std::sin(boundary.angles[i]);
    return points;
}

Parameterization solve_simplified(const SampledSurface& patch, const CircleBoundary& boundary,
                                  const ParameterizationOptions& options, Progress& progress) {
    Lod lod;
    {
        const Progress::Part part(progress, 0.0, 0.2);
        lod = interior_clusters(patch, boundary, options.lod, progress);
    }
    Nodes nodes = simplified_nodes(patch, boundary, lod);
    Parameterization result;
    {
        const Progress::Part part(progress, 0.2, 0.3);
        result.joined = connect(nodes, neighbors_of(nodes.positions, options, progress),
                                options.join_parts, patch.name);
    }
    DiskPoints disk;
    {
        const Progress::Part part(progress, 0.3, 0.8);
        disk = solve(nodes, options, patch.name, result, progress);
    }
    result.points = boundary_on_circle(patch, boundary);
    const Progress::Part part(progress, 0.8, 1.0);
    embed_points(patch, lod, nodes, disk, result.points, progress);
    return result;
}

}  // namespace

std::vector<double> boundary_angles(const Positions& positions, std::span<const Index> loop,
                                    BoundarySpacing spacing, std::span<const BoundaryPin> pins) {
    const auto along = arc_lengths(positions, loop, spacing);
    const double total = along.back();
    std::vector<double> angles(loop.size());
    if (pins.empty()) {
        for (std::size_t i = 0; i < loop.size(); ++i) angles[i] = kTurn * along[i] / total;
        return angles;
    }
    for (std::size_t p = 0; p < pins.size(); ++p) {
        const bool in_loop = pins[p].position >= 0 && pins[p].position < to_index(loop.size());
        const bool in_order =
            p == 0 || (pins[p - 1].position < pins[p].position &&
                       pins[p - 1].angle < pins[p].angle && pins[p].angle < pins[0].angle + kTurn);
        if (!in_loop || !in_order)
            throw FeatureError("boundary pin " + std::to_string(p),
                               "positions and angles that ascend around the loop",
                               "position " + std::to_string(pins[p].position) + " at angle " +
                                   std::to_string(pins[p].angle),
                               "Give the pins in the loop's order, less than a turn in all.");
    }
    for (std::size_t p = 0; p < pins.size(); ++p) {
        // From this pin to the next, which for the last one is the first, a turn later.
        const bool wraps = p + 1 == pins.size();
        const auto begin = to_size(pins[p].position);
        const auto end =
            wraps ? to_size(pins[0].position) + loop.size() : to_size(pins[p + 1].position);
        const double arc =
            wraps ? pins[0].angle + kTurn - pins[p].angle : pins[p + 1].angle - pins[p].angle;
        const auto at = [&](std::size_t i) {
            return i < loop.size() ? along[i] : along[i - loop.size()] + total;
        };
        const double length = at(end) - at(begin);
        for (std::size_t i = begin; i < end; ++i) {
            const double share =
                length > 0.0 ? (at(i) - at(begin)) / length
                             : static_cast<double>(i - begin) / static_cast<double>(end - begin);
            angles[i % loop.size()] = pins[p].angle + arc * share;
        }
    }
    return angles;
}

MatchedPins match_pins(const Positions& source_positions, std::span<const Index> source_loop,
                       const Positions& target_positions, std::span<const Index> target_loop,
                       BoundarySpacing spacing, std::span<const IndexPair> features) {
    MatchedPins pins;
    if (features.empty()) return pins;
    std::vector<IndexPair> sorted(features.begin(), features.end());
    std::ranges::sort(sorted);
    const auto source_along = arc_lengths(source_positions, source_loop, spacing);
    const auto target_along = arc_lengths(target_positions, target_loop, spacing);
    const auto angle = [](const std::vector<double>& along, Index position) {
        return kTurn * along[to_size(position)] / along.back();
    };

    // Both sequences of angles, unwrapped from the first feature on.
    std::vector<double> source, target;
    const double target_start = angle(target_along, sorted[0].target);
    for (const IndexPair& feature : sorted) {
        source.push_back(angle(source_along, feature.source));
        target.push_back(modulo(angle(target_along, feature.target) - target_start, kTurn));
        const std::size_t i = source.size() - 1;
        if (i > 0 && !(source[i] > source[i - 1] && target[i] > target[i - 1]))
            throw FeatureError("features on the boundary", "the same order around both boundaries",
                               "two that are swapped or coincide",
                               "Check that left and right are not swapped, and that the normals of "
                               "both models point outward.");
    }
    double rotation = 0.0;
    for (std::size_t i = 0; i < source.size(); ++i)
        rotation += (source[i] - target[i]) / static_cast<double>(source.size());
    for (std::size_t i = 0; i < sorted.size(); ++i) {
        const double common = (source[i] + target[i] + rotation) / 2.0;
        pins.source.push_back({sorted[i].source, common});
        pins.target.push_back({sorted[i].target, common});
    }
    const auto lowest = std::ranges::min_element(pins.target, {}, &BoundaryPin::position);
    for (auto pin = pins.target.begin(); pin != lowest; ++pin) pin->angle += kTurn;
    std::ranges::rotate(pins.target, lowest);
    return pins;
}

Parameterization parameterize(const SampledSurface& patch, const CircleBoundary& boundary,
                              const ParameterizationOptions& options, Progress& progress) {
    if (boundary.loop.size() < 3)
        throw TopologyError(patch.name, "a boundary of at least 3 points",
                            std::to_string(boundary.loop.size()), "Give a longer boundary.");
    if (boundary.loop.size() >= to_size(patch.size()))
        return {.points = boundary_on_circle(patch, boundary)};
    if (options.solve == SolveMode::kFull) return solve_all(patch, boundary, options, progress);
    return solve_simplified(patch, boundary, options, progress);
}

}  // namespace pointmorph

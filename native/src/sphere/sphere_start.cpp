#include "sphere/sphere_start.hpp"

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "base/angle.hpp"
#include "base/median.hpp"

namespace pointmorph {

namespace {

using Matrix = Eigen::SparseMatrix<double, Eigen::ColMajor, Index>;

/// The node with the least mean distance to points spread over the shape.
Index middle_of(const SurfaceGraph& graph, Progress& progress) {
    constexpr int kSamples = 24;
    GeodesicSearch search(graph);
    Values sum = Values::Zero(graph.size());
    Values nearest = Values::Constant(graph.size(), std::numeric_limits<double>::infinity());
    Index from = search.from(0).back().first;
    for (int k = 0; k < kSamples; ++k) {
        for (const auto& [i, distance] : search.reached(from)) {
            nearest[i] = std::min(nearest[i], distance);
            sum[i] += distance;
        }
        nearest.maxCoeff(&from);
        progress.throw_if_cancelled();
    }
    Index middle = 0;
    sum.minCoeff(&middle);
    return middle;
}

}  // namespace

CellGraph cell_graph(const Neighborhoods& nearest, const Normals& normals,
                     std::span<const Index> cells, const Positions& nodes) {
    constexpr std::size_t kNear = 8;  // farther ones reach over gaps
    std::vector<std::vector<Index>> across(to_size(nodes.rows()));
    for (Index i = 0; i < nearest.size(); ++i) {
        const auto near = nearest[i];
        for (const Index j : near.first(std::min(kNear, near.size()))) {
            const Index a = cells[to_size(i)], b = cells[to_size(j)];
            if (a == b || a < 0 || b < 0 || normals.row(i).dot(normals.row(j)) <= 0.0) continue;
            across[to_size(a)].push_back(b);
            across[to_size(b)].push_back(a);
        }
    }
    Neighborhoods joined;
    for (auto& around : across) {
        std::ranges::sort(around);
        std::ranges::unique_copy(around, std::back_inserter(joined.indices));
        joined.offsets.push_back(static_cast<std::int64_t>(joined.indices.size()));
    }
    joined = in_one_piece(nodes, std::move(joined));
    CellGraph result;
    for (Index a = 0; a < joined.size(); ++a)
        for (const Index b : joined[a]) {
            constexpr double kShortest = 1e-12;
            const auto crossings = std::ranges::equal_range(across[to_size(a)], b).size();
            const double length = std::max((nodes.row(a) - nodes.row(b)).norm(), kShortest);
            result.graph.lengths.push_back(length);
            result.weights.push_back(std::max(1.0, static_cast<double>(crossings)) / length);
        }
    result.graph.offsets = std::move(joined.offsets);
    result.graph.neighbors = std::move(joined.indices);
    return result;
}

namespace {

/// Calls `visit(neighbor, edge)` for the edges of a node.
template <class Visit>
void each_edge(const SurfaceGraph& graph, Index node, Visit&& visit) {
    for (auto e = to_size(graph.offsets[to_size(node)]);
         e < to_size(graph.offsets[to_size(node) + 1]); ++e)
        visit(graph.neighbors[e], e);
}

/// The plane into which all nodes but the pole go: the pole's neighbors lie on the unit circle, the
/// others are solved for.
class Plane {
public:
    Plane(const CellGraph& cells, const Positions& nodes, const Normals& normals, Index pole)
        : cells_(cells),
          pole_(pole),
          unknown_(to_size(cells.graph.size()), 0),
          points_(DiskPoints::Zero(cells.graph.size(), 2)) {
        // The circle goes round the pole as seen from inside: the pole lies outside of the disk.
        const Vector3 up = normals.row(pole).transpose(), right = up.unitOrthogonal();
        std::vector<std::pair<double, Index>> circle;
        each_edge(cells.graph, pole, [&](Index b, std::size_t) {
            const Vector3 offset = (nodes.row(b) - nodes.row(pole)).transpose();
            circle.emplace_back(angle_of(offset.dot(up.cross(right)), offset.dot(right)), b);
        });
        std::ranges::sort(circle);
        unknown_[to_size(pole)] = -1;
        for (std::size_t k = 0; k < circle.size(); ++k) {
            const Index b = circle[k].second;
            const double angle = -2.0 * std::numbers::pi * static_cast<double>(k) /
                                 static_cast<double>(circle.size());
            points_.row(b) << std::cos(angle), std::sin(angle);
            unknown_[to_size(b)] = -1;
        }
        for (Index& u : unknown_)
            if (u >= 0) u = unknowns_++;
        matrix_.resize(unknowns_, unknowns_);
    }

    bool is_all_circle() const { return unknowns_ == 0; }

    /// Puts every node at the weighted mean of its neighbors. `looseness` has logarithms by node;
    /// an edge's is the mean of its ends'.
    void solve(const Values& looseness) {
        entries_.clear();
        DiskPoints sides = DiskPoints::Zero(unknowns_, 2);
        for (Index a = 0; a < cells_.graph.size(); ++a) {
            const Index row = unknown_[to_size(a)];
            if (row < 0) continue;
            double sum = 0.0;
            each_edge(cells_.graph, a, [&](Index b, std::size_t e) {
                if (b == pole_) return;
                const double w = cells_.weights[e] * std::exp(0.5 * (looseness[a] + looseness[b]));
                sum += w;
                if (unknown_[to_size(b)] < 0)
                    sides.row(row) += w * points_.row(b);
                else if (b < a)
                    entries_.emplace_back(row, unknown_[to_size(b)], -w);
            });
            entries_.emplace_back(row, row, sum);
        }
        matrix_.setFromTriplets(entries_.begin(), entries_.end());
        if (!analyzed_) cholesky_.analyzePattern(matrix_);
        analyzed_ = true;
        cholesky_.factorize(matrix_);
        const DiskPoints solved = cholesky_.solve(sides);
        for (Index a = 0; a < cells_.graph.size(); ++a)
            if (unknown_[to_size(a)] >= 0) points_.row(a) = solved.row(unknown_[to_size(a)]);
    }

    /// By the inverse stereographic projection, half of the nodes on either side of the equator.
    Positions on_sphere() const {
        Positions sphere(points_.rows(), 3);
        const Eigen::RowVector2d center(median(points_.col(0)), median(points_.col(1)));
        const double size = median((points_.rowwise() - center).rowwise().norm());
        for (Index a = 0; a < cells_.graph.size(); ++a) {
            const Eigen::RowVector2d z = (points_.row(a) - center) / size;
            const double squared = z.squaredNorm();
            sphere.row(a) << 2.0 * z.x() / (1.0 + squared), 2.0 * z.y() / (1.0 + squared),
                (1.0 - squared) / (1.0 + squared);
        }
        sphere.row(pole_) << 0.0, 0.0, -1.0;
        return sphere;
    }

private:
    const CellGraph& cells_;
    Index pole_;
    std::vector<Index> unknown_;  ///< by node; −1: known
    Index unknowns_ = 0;
    DiskPoints points_;
    Matrix matrix_;
    std::vector<Eigen::Triplet<double, Index>> entries_;
    Eigen::SimplicialLLT<Matrix, Eigen::Lower, Eigen::AMDOrdering<Index>> cholesky_;
    bool analyzed_ = false;
};

/// Logarithm of how much larger than the mean the squared edges of each node are on the sphere, for
/// their length on the shape.
Values log_scales(const SurfaceGraph& graph, const Positions& sphere) {
    Values scale(graph.size());
    for (Index a = 0; a < graph.size(); ++a) {
        double image = 0.0, length = 0.0;
        each_edge(graph, a, [&](Index b, std::size_t e) {
            image += (sphere.row(a) - sphere.row(b)).squaredNorm();
            length += graph.lengths[e] * graph.lengths[e];
        });
        scale[a] = std::log(std::max(image / length, 1e-60));
    }
    scale.array() -= scale.mean();
    return scale;
}

/// Bounded, and averaged over neighbors, so that a place where all nodes coincide doesn't come
/// loose by itself.
Values smoothed(const SurfaceGraph& graph, Values values) {
    constexpr int kRounds = 2;
    constexpr double kMost = 4.0;
    values = values.cwiseMax(-kMost).cwiseMin(kMost);
    for (int k = 0; k < kRounds; ++k) {
        const Values before = values;
        for (Index a = 0; a < graph.size(); ++a) {
            double sum = before[a], all = 1.0;
            each_edge(graph, a, [&](Index b, std::size_t) {
                sum += before[b];
                all += 1.0;
            });
            values[a] = sum / all;
        }
    }
    return values;
}

}  // namespace

void each_first_sphere(const CellGraph& cells, const Positions& nodes, const Normals& normals,
                       const SphericalOptions& options,
                       const std::function<bool(const Positions&)>& visit, Progress& progress) {
    // For shapes that are nearly balls, the directions from the middle are enough.
    if (!visit((nodes.rowwise() - nodes.colwise().mean()).rowwise().normalized())) return;
    Plane plane(cells, nodes, normals, middle_of(cells.graph, progress));
    if (plane.is_all_circle()) return;
    Values looseness = Values::Zero(cells.graph.size());
    constexpr Index kEvery = 3;
    for (Index round = 0; round < options.opening_rounds; ++round) {
        plane.solve(looseness);
        const Positions sphere = plane.on_sphere();
        if (!sphere.allFinite()) break;
        if (round % kEvery == 0 && !visit(sphere)) return;
        looseness += options.opening * smoothed(cells.graph, log_scales(cells.graph, sphere));
        progress.report(0.1 + 0.2 * (round + 1) / options.opening_rounds);
    }
}

}  // namespace pointmorph

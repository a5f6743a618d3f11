#include "sphere/sphere_start.hpp"

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace pointmorph {

namespace {

using Matrix = Eigen::SparseMatrix<double, Eigen::ColMajor, Index>;

double median(Values values) {
    const auto middle = values.size() / 2;
    std::nth_element(values.begin(), values.begin() + middle, values.end());
    return values[middle];
}

/// The node with the least mean distance to points spread over the shape.
Index middle_of(const SurfaceGraph& graph, Progress& progress) {
    constexpr int kSamples = 24;
    GeodesicSearch search(graph);
    Values sum = Values::Zero(graph.size());
    Values nearest = Values::Constant(graph.size(), std::numeric_limits<double>::infinity());
    Index from = search.from(0).back().first;
    for (int k = 0; k < kSamples; ++k) {
        for (const auto& [i, distance] : search.from(from)) {
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

std::vector<Positions> first_spheres(const CellGraph& cells, const Positions& nodes,
                                     const Normals& normals, const SphericalOptions& options,
                                     Progress& progress) {
    const SurfaceGraph& graph = cells.graph;
    const Index count = graph.size();
    const auto each_edge = [&](Index a, auto&& visit) {
        for (auto e = to_size(Index(graph.offsets[to_size(a)]));
             e < to_size(Index(graph.offsets[to_size(a) + 1])); ++e)
            visit(graph.neighbors[e], e);
    };
    // The circle: around the pole, seen from inside, since it is what lies outside of the disk.
    const Index pole = middle_of(graph, progress);
    const Vector3 up = normals.row(pole).transpose(), right = up.unitOrthogonal();
    std::vector<std::pair<double, Index>> circle;
    each_edge(pole, [&](Index b, std::size_t) {
        const Vector3 offset = (nodes.row(b) - nodes.row(pole)).transpose();
        circle.emplace_back(std::atan2(offset.dot(up.cross(right)), offset.dot(right)), b);
    });
    std::ranges::sort(circle);
    std::vector<Index> unknown(to_size(count), 0);
    DiskPoints plane = DiskPoints::Zero(count, 2);
    unknown[to_size(pole)] = -1;
    for (std::size_t k = 0; k < circle.size(); ++k) {
        const Index b = circle[k].second;
        const double angle =
            -2.0 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(circle.size());
        plane.row(b) << std::cos(angle), std::sin(angle);
        unknown[to_size(b)] = -1;
    }
    Index unknowns = 0;
    for (Index& u : unknown)
        if (u >= 0) u = unknowns++;

    Values looseness = Values::Zero(count);  // logarithms; an edge's is the mean of its ends'
    constexpr Index kEvery = 3;
    constexpr int kSmoothing = 2;
    constexpr double kMost = 4.0;
    Eigen::SimplicialLLT<Matrix, Eigen::Lower, Eigen::AMDOrdering<Index>> cholesky;
    Matrix matrix(unknowns, unknowns);
    std::vector<Eigen::Triplet<double, Index>> entries;
    // What is nearly a ball is there already.
    std::vector<Positions> spheres{
        (nodes.rowwise() - nodes.colwise().mean()).rowwise().normalized()};
    if (unknowns == 0) return spheres;
    Positions sphere(count, 3);
    for (Index round = 0; round < options.opening_rounds; ++round) {
        entries.clear();
        DiskPoints sides = DiskPoints::Zero(unknowns, 2);
        for (Index a = 0; a < count; ++a) {
            const Index row = unknown[to_size(a)];
            if (row < 0) continue;
            double sum = 0.0;
            each_edge(a, [&](Index b, std::size_t e) {
                if (b == pole) return;
                const double w = cells.weights[e] * std::exp(0.5 * (looseness[a] + looseness[b]));
                sum += w;
                if (unknown[to_size(b)] < 0)
                    sides.row(row) += w * plane.row(b);
                else if (b < a)
                    entries.emplace_back(row, unknown[to_size(b)], -w);
            });
            entries.emplace_back(row, row, sum);
        }
        matrix.setFromTriplets(entries.begin(), entries.end());
        if (round == 0) cholesky.analyzePattern(matrix);
        cholesky.factorize(matrix);
        const DiskPoints solved = cholesky.solve(sides);
        for (Index a = 0; a < count; ++a)
            if (unknown[to_size(a)] >= 0) plane.row(a) = solved.row(unknown[to_size(a)]);

        const Eigen::RowVector2d center(median(plane.col(0)), median(plane.col(1)));
        const double size = median((plane.rowwise() - center).rowwise().norm());
        for (Index a = 0; a < count; ++a) {
            const Eigen::RowVector2d z = (plane.row(a) - center) / size;
            const double squared = z.squaredNorm();
            sphere.row(a) << 2.0 * z.x() / (1.0 + squared), 2.0 * z.y() / (1.0 + squared),
                (1.0 - squared) / (1.0 + squared);
        }
        sphere.row(pole) << 0.0, 0.0, -1.0;

        Values scale(count);
        for (Index a = 0; a < count; ++a) {
            double image = 0.0, length = 0.0;
            each_edge(a, [&](Index b, std::size_t e) {
                image += (sphere.row(a) - sphere.row(b)).squaredNorm();
                length += graph.lengths[e] * graph.lengths[e];
            });
            scale[a] = std::log(std::max(image / length, 1e-60));
        }
        scale.array() -= scale.mean();
        if (!sphere.allFinite()) break;
        if (round % kEvery == 0) spheres.push_back(sphere);
        // Smoothly, lest a place where everything coincides comes loose by itself.
        scale = scale.cwiseMax(-kMost).cwiseMin(kMost);
        for (int k = 0; k < kSmoothing; ++k) {
            const Values before = scale;
            for (Index a = 0; a < count; ++a) {
                double sum = before[a], all = 1.0;
                each_edge(a, [&](Index b, std::size_t) {
                    sum += before[b];
                    all += 1.0;
                });
                scale[a] = sum / all;
            }
        }
        looseness += options.opening * scale;
        progress.report(0.1 + 0.1 * (round + 1) / options.opening_rounds);
    }
    return spheres;
}

}  // namespace pointmorph

#include "pointmorph/surface/geodesics.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <span>
#include <utility>

#include "pointmorph/surface/projection.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t kNear = 8;

/// Weighted mean of the normals around, on the anchor's side of the surface.
Eigen::RowVector3d normal_at(const KdTree<3>& surface, const Normals& normals,
                             const Eigen::RowVector3d& point, Index anchor) {
    std::array<Index, kNear> near;
    std::array<double, kNear> squared;
    const auto found = to_size(surface.nearest(point.data(), near, squared));
    const double reach = 1.2 * squared[found - 1];
    Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
    for (std::size_t k = 0; k < found; ++k)
        if (normals.row(near[k]).dot(normals.row(anchor)) > 0.0)
            sum += (reach > 0.0 ? 1.0 - squared[k] / reach : 1.0) * normals.row(near[k]);
    return sum.norm() > 1e-9 ? sum.normalized() : Eigen::RowVector3d(normals.row(anchor));
}

/// Projects the rows `which` of a curve onto the surface.
void project(SurfaceCurve& curve, std::span<const Index> which, const KdTree<3>& surface,
             const Normals& normals, Progress& progress) {
    Positions points(static_cast<Eigen::Index>(which.size()), 3);
    std::vector<Index> anchors;
    for (std::size_t k = 0; k < which.size(); ++k) {
        points.row(static_cast<Eigen::Index>(k)) = curve.points.row(which[k]);
        anchors.push_back(nearest_on_sheet(surface, normals, curve.points.row(which[k]),
                                           curve.normals.row(which[k]), kNear));
    }
    const Positions there = project_onto_surface(points, anchors, surface, normals, progress);
    for (std::size_t k = 0; k < which.size(); ++k) {
        curve.points.row(which[k]) = there.row(static_cast<Eigen::Index>(k));
        curve.normals.row(which[k]) =
            normal_at(surface, normals, curve.points.row(which[k]), anchors[k]);
    }
}

}  // namespace

double curve_length(const Positions& points) {
    double length = 0.0;
    for (Eigen::Index i = 1; i < points.rows(); ++i)
        length += (points.row(i) - points.row(i - 1)).norm();
    return length;
}

bool edges_cross(const Eigen::RowVector3d& a, const Eigen::RowVector3d& b,
                 const Eigen::RowVector3d& c, const Eigen::RowVector3d& d, const Vector3& normal) {
    const Vector3 right = normal.unitOrthogonal(), up = normal.cross(right);
    const auto flat = [&](const Eigen::RowVector3d& point) -> Eigen::Vector2d {
        const Vector3 offset = (point - a).transpose();
        return {offset.dot(right), offset.dot(up)};
    };
    // Twice the signed area of a triangle.
    const auto area = [](const Eigen::Vector2d& p, const Eigen::Vector2d& q,
                         const Eigen::Vector2d& r) {
        return (q - p).x() * (r - p).y() - (q - p).y() * (r - p).x();
    };
    const Eigen::Vector2d p = flat(a), q = flat(b), r = flat(c), s = flat(d);
    return area(p, q, r) * area(p, q, s) < 0.0 && area(r, s, p) * area(r, s, q) < 0.0;
}

std::vector<Index> cheapest_path(const SurfaceGraph& graph, Index from, Index to,
                                 const Values& costs) {
    std::vector<double> distance(to_size(graph.size()), std::numeric_limits<double>::infinity());
    std::vector<Index> before(to_size(graph.size()), -1);
    std::vector<std::pair<double, Index>> queue{{0.0, from}};
    distance[to_size(from)] = 0.0;
    constexpr auto later = std::greater<std::pair<double, Index>>();
    while (!queue.empty()) {
        std::ranges::pop_heap(queue, later);
        const auto [so_far, i] = queue.back();
        queue.pop_back();
        if (so_far > distance[to_size(i)]) continue;
        if (i == to) break;
        for (auto e = to_size(graph.offsets[to_size(i)]);
             e < to_size(graph.offsets[to_size(i) + 1]); ++e) {
            const Index j = graph.neighbors[e];
            const double cost = costs.size() > 0 ? 0.5 * (costs[i] + costs[j]) : 1.0;
            const double through = so_far + cost * graph.lengths[e];
            if (through >= distance[to_size(j)]) continue;
            distance[to_size(j)] = through;
            before[to_size(j)] = i;
            queue.emplace_back(through, j);
            std::ranges::push_heap(queue, later);
        }
    }
    std::vector<Index> path;
    for (Index i = to; i >= 0; i = before[to_size(i)]) path.push_back(i);
    std::ranges::reverse(path);
    return path;
}

SurfaceCurve resampled(const SurfaceCurve& curve, double spacing) {
    const double length = curve_length(curve.points);
    const auto steps = static_cast<Index>(std::clamp(std::round(length / spacing), 1.0, 1e6));
    SurfaceCurve result{Positions(steps + 1, 3), Normals(steps + 1, 3)};
    Index segment = 0;
    double passed = 0.0, here = 0.0;
    for (Index i = 0; i <= steps; ++i) {
        const double goal = length * i / steps;
        while (segment + 1 < curve.size()) {
            here = (curve.points.row(segment + 1) - curve.points.row(segment)).norm();
            if (passed + here >= goal || segment + 2 == curve.size()) break;
            passed += here;
            ++segment;
        }
        const Index next = std::min(segment + 1, curve.size() - 1);
        const double share = here > 0.0 ? std::clamp((goal - passed) / here, 0.0, 1.0) : 0.0;
        result.points.row(i) =
            (1.0 - share) * curve.points.row(segment) + share * curve.points.row(next);
        const Eigen::RowVector3d normal =
            (1.0 - share) * curve.normals.row(segment) + share * curve.normals.row(next);
        result.normals.row(i) = normal.norm() > 1e-9
                                    ? normal.normalized()
                                    : Eigen::RowVector3d(curve.normals.row(segment));
    }
    result.points.row(0) = curve.points.row(0);
    result.points.row(steps) = curve.points.row(curve.size() - 1);
    return result;
}

SurfaceCurve on_surface(SurfaceCurve curve, const KdTree<3>& surface, const Normals& normals,
                        Progress& progress) {
    std::vector<Index> inner;
    for (Index i = 1; i + 1 < curve.size(); ++i) inner.push_back(i);
    project(curve, inner, surface, normals, progress);
    return curve;
}

SurfaceCurve straightened(SurfaceCurve curve, const KdTree<3>& surface, const Normals& normals,
                          Index rounds, double relaxation, Progress& progress) {
    // Every other point moves at a time, so that none moves together with its neighbors.
    std::array<std::vector<Index>, 2> halves;
    for (Index i = 1; i + 1 < curve.size(); ++i) halves[to_size(i % 2)].push_back(i);
    // An edge that gets much longer than the others has left the surface: it would hang between two
    // limbs and pull the whole curve off them.
    constexpr double kLongest = 2.0;
    const double longest =
        kLongest * curve_length(curve.points) / std::max<Index>(1, curve.size() - 1);
    for (Index round = 0; round < rounds; ++round)
        for (const std::vector<Index>& half : halves) {
            const SurfaceCurve before = curve;
            for (const Index i : half)
                curve.points.row(i) +=
                    relaxation * (0.5 * (curve.points.row(i - 1) + curve.points.row(i + 1)) -
                                  curve.points.row(i));
            project(curve, half, surface, normals, progress);
            for (const Index i : half)
                for (const Index j : {i - 1, i + 1}) {
                    const double length = (curve.points.row(i) - curve.points.row(j)).norm();
                    if (length > longest &&
                        length > (before.points.row(i) - before.points.row(j)).norm()) {
                        curve.points.row(i) = before.points.row(i);
                        curve.normals.row(i) = before.normals.row(i);
                        break;
                    }
                }
        }
    return curve;
}

SurfaceCurve geodesic(const KdTree<3>& surface, const Normals& normals, std::span<const Index> path,
                      double spacing, Progress& progress) {
    SurfaceCurve curve{Positions(static_cast<Eigen::Index>(path.size()), 3),
                       Normals(static_cast<Eigen::Index>(path.size()), 3)};
    for (std::size_t i = 0; i < path.size(); ++i) {
        curve.points.row(static_cast<Eigen::Index>(i)) = surface.points().row(path[i]);
        curve.normals.row(static_cast<Eigen::Index>(i)) = normals.row(path[i]);
    }
    // Successive over-relaxation takes about as many rounds as there are points, plain averages
    // their square.
    curve = on_surface(resampled(curve, spacing), surface, normals, progress);
    const double relaxation =
        2.0 / (1.0 + std::sin(std::numbers::pi / std::max<Index>(2, curve.size() - 1)));
    constexpr int kBatches = 8;
    const Index rounds = std::clamp<Index>(curve.size() / 2, 4, 200);
    double length = curve_length(curve.points);
    for (int batch = 0; batch < kBatches; ++batch) {
        curve = straightened(std::move(curve), surface, normals, rounds, relaxation, progress);
        const double now = curve_length(curve.points);
        if (now > length * (1.0 - 1e-5)) break;
        length = now;
    }
    return curve;
}

ClosedCurve closed_curve(std::span<const SurfaceCurve> parts) {
    ClosedCurve result;
    Index count = 0;
    for (const SurfaceCurve& part : parts) count += part.size() - 1;
    result.curve = {Positions(count, 3), Normals(count, 3)};
    Index row = 0;
    for (const SurfaceCurve& part : parts) {
        const Index steps = part.size() - 1;
        result.corners.push_back(row);
        result.curve.points.middleRows(row, steps) = part.points.topRows(steps);
        result.curve.normals.middleRows(row, steps) = part.normals.topRows(steps);
        row += steps;
    }
    return result;
}

}  // namespace pointmorph

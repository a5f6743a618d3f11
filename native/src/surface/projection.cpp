#include "pointmorph/surface/projection.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t kNeighbors = 16;
using Vector2 = Eigen::Vector2d;

double cross(const Vector2& a, const Vector2& b) {
    return a.x() * b.y() - a.y() * b.x();
}

/// Convex hull of the first `count` points, anticlockwise (Andrew's monotone chain), at the front
/// of `hull`; returns its size.
std::size_t convex_hull(std::array<Vector2, kNeighbors>& points, std::size_t count,
                        std::array<Vector2, 2 * kNeighbors>& hull) {
    std::sort(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(count),
              [](const Vector2& a, const Vector2& b) {
                  return a.x() < b.x() || (a.x() == b.x() && a.y() < b.y());
              });
    std::size_t size = 0;
    const auto add = [&](const Vector2& p, std::size_t first) {
        while (size >= first + 2 &&
               cross(hull[size - 1] - hull[size - 2], p - hull[size - 2]) <= 0.0)
            --size;
        hull[size++] = p;
    };
    for (std::size_t i = 0; i < count; ++i) add(points[i], 0);
    const std::size_t lower = size - 1;
    for (std::size_t i = count - 1; i-- > 0;) add(points[i], lower);
    return std::max<std::size_t>(1, size - 1);  // the last is the first again
}

/// The point of the hull that is nearest to the origin: the origin itself where it's inside.
Vector2 nearest_in_hull(const std::array<Vector2, 2 * kNeighbors>& hull, std::size_t size) {
    bool inside = size > 2;
    Vector2 best = hull[0];
    for (std::size_t i = 0; i < size; ++i) {
        const Vector2& a = hull[i];
        const Vector2 edge = hull[(i + 1) % size] - a;
        inside = inside && cross(edge, -a) >= 0.0;
        const double squared = edge.squaredNorm();
        const double along = squared > 0.0 ? std::clamp(-a.dot(edge) / squared, 0.0, 1.0) : 0.0;
        const Vector2 foot = a + along * edge;
        if (foot.squaredNorm() < best.squaredNorm()) best = foot;
    }
    return inside ? Vector2::Zero() : best;
}

}  // namespace

Positions project_onto_surface(const Positions& images, std::span<const Index> anchors,
                               const KdTree<3>& surface, const Normals& normals, Progress& progress,
                               const Neighborhoods* nearest) {
    Positions result(images.rows(), 3);
    const Positions& samples = surface.points();
    parallel_for(to_index(images.rows()), progress, [&](Index begin, Index end) {
        std::array<Index, kNeighbors> near;
        std::array<double, kNeighbors> squared;
        std::array<Vector2, kNeighbors> flat;
        std::array<Vector2, 2 * kNeighbors> hull;
        for (Index i = begin; i < end; ++i) {
            const Index anchor = anchors[to_size(i)];
            std::size_t found;
            double farthest;  // of those found, from the anchor
            if (nearest && (*nearest)[anchor].size() + 1 >= kNeighbors) {
                found = kNeighbors;
                near.front() = anchor;
                std::copy_n((*nearest)[anchor].begin(), kNeighbors - 1, near.begin() + 1);
                farthest = (samples.row(near.back()) - samples.row(anchor)).norm();
            } else {
                found = to_size(surface.nearest(samples.row(anchor).data(), near, squared));
                farthest = std::sqrt(squared[found - 1]);
            }
            // One reach for all images of an anchor, which holds it well inside.
            const double reach = 1.5 * farthest;
            found = to_size(
                std::remove_if(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(found),
                               [&](Index j) {
                                   return normals.row(j).dot(normals.row(anchor)) <= 0.0 &&
                                          j != anchor;
                               }) -
                near.begin());

            Vector3 mean = Vector3::Zero(), normal = Vector3::Zero();
            double sum = 0.0, height = 0.0;
            for (std::size_t k = 0; k < found; ++k) {
                const double ratio = (samples.row(near[k]) - images.row(i)).squaredNorm() /
                                     std::max(reach * reach, 1e-300);
                const double inside = std::max(0.0, 1.0 - ratio);
                const double weight = (inside * inside) * (inside * inside);
                mean += weight * samples.row(near[k]).transpose();
                normal += weight * normals.row(near[k]).transpose();
                height += weight * normals.row(near[k]).dot(images.row(i) - samples.row(near[k]));
                sum += weight;
            }
            if (!(sum > 1e-12)) {  // farther off than the neighborhood is wide
                mean = samples.row(anchor).transpose();
                normal = normals.row(anchor).transpose();
                height = normal.dot(images.row(i).transpose() - mean);
                sum = 1.0;
            }
            mean /= sum;
            normal.normalize();
            const Vector3 x = images.row(i).transpose();
            // On a curved surface the mean lies inside as far as the tangent planes lie outside.
            height = 0.5 * (height / sum + normal.dot(x - mean));
            const Vector3 foot = x - height * normal;

            const Vector3 right = normal.unitOrthogonal(), up = normal.cross(right);
            std::array<bool, 4> in_quadrant{};
            for (std::size_t k = 0; k < found; ++k) {
                const Vector3 offset = samples.row(near[k]).transpose() - foot;
                flat[k] = {offset.dot(right), offset.dot(up)};
                if (flat[k].x() != 0.0 && flat[k].y() != 0.0)
                    in_quadrant[(flat[k].x() > 0.0 ? 1u : 0u) + (flat[k].y() > 0.0 ? 2u : 0u)] =
                        true;
            }
            result.row(i) = foot;
            // With a sample in each quadrant around it, it lies between them.
            if (std::ranges::all_of(in_quadrant, std::identity())) continue;
            const Vector2 inside = nearest_in_hull(hull, convex_hull(flat, found, hull));
            result.row(i) = foot + inside.x() * right + inside.y() * up;
        }
    });
    return result;
}

}  // namespace pointmorph

#include "surface/delaunay_star.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace pointmorph {

bool StarBuilder::build(Index i, std::span<const Index> rows) {
    cell_.clear();
    point_ = positions_.row(i);
    normal_ = normals_.row(i);
    const double farthest =
        rows.empty() ? 0.0 : (positions_.row(rows.back()).transpose() - point_).norm();
    if (farthest == 0.0) return true;
    const double side = 16.0 * farthest;
    cell_ = {{-side, -side, -1}, {side, -side, -1}, {side, side, -1}, {-side, side, -1}};
    reach_ = 8.0 * side * side;

    // An orthonormal frame around the normal without a special case (Duff et al. 2017).
    const Vector3& n = normal_;
    const double sign = std::copysign(1.0, n[2]);
    const double a = -1.0 / (sign + n[2]), b = n[0] * n[1] * a;
    u_ = {1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]};
    v_ = {b, sign + n[1] * n[1] * a, -n[1]};
    return extend(rows);
}

bool StarBuilder::extend(std::span<const Index> rows) {
    for (const Index j : rows) {
        const Vector3 d = positions_.row(j).transpose() - point_;
        const double squared = d.squaredNorm();
        if (squared >= reach_) return true;
        if (squared == 0.0 || normals_.row(j).dot(normal_) < kOpposed) continue;
        // The direction as seen in the tangent plane, the distance as in space: the surface,
        // unrolled. A point right above or below has no direction.
        const double x = d.dot(u_), y = d.dot(v_);
        const double flat = x * x + y * y;
        if (flat < 0.04 * squared) continue;
        const double stretch = std::sqrt(squared / flat);
        cut(x * stretch, y * stretch, squared, j);
    }
    return false;
}

std::span<const Spoke> StarBuilder::spokes() {
    spokes_.clear();
    for (std::size_t k = 0; k < cell_.size(); ++k) {
        const Corner& end = cell_[k + 1 < cell_.size() ? k + 1 : 0];
        if (cell_[k].row < 0) continue;
        const double radius = end.row < 0 ? kInfinity : std::sqrt(end.x * end.x + end.y * end.y);
        spokes_.push_back({cell_[k].row, radius});
    }
    return spokes_;
}

double StarBuilder::spacing() const {
    std::array<double, 3> shortest = {kInfinity, kInfinity, kInfinity};
    for (const Corner& corner : cell_) {
        double squared = corner.squared;
        if (corner.row < 0) continue;
        for (double& s : shortest)
            if (squared < s) std::swap(squared, s);
    }
    for (std::size_t k = 3; k-- > 0;)
        if (shortest[k] < kInfinity) return std::sqrt(shortest[k]);
    return 0.0;
}

double StarBuilder::largest_radius() const {
    for (const Corner& corner : cell_)
        if (corner.row < 0) return kInfinity;
    return std::sqrt(0.25 * reach_);
}

void StarBuilder::cut(double x, double y, double squared, Index row) {
    const auto beyond = [&](const Corner& c) { return c.x * x + c.y * y - 0.5 * squared; };
    // Points that coincide, or lie on one circle up to rounding, share a corner.
    const double tolerance = 1e-12 * squared;
    cut_.clear();
    double here = beyond(cell_.front());
    bool changed = false;
    for (std::size_t k = 0; k < cell_.size(); ++k) {
        const Corner& c = cell_[k];
        const Corner& next = cell_[k + 1 < cell_.size() ? k + 1 : 0];
        const double there = beyond(next);
        const bool here_stays = here <= tolerance, there_stays = there <= tolerance;
        if (here_stays) cut_.push_back(c);
        if (here_stays != there_stays) {
            const double t = here / (here - there);
            Corner corner = here_stays ? Corner{0.0, 0.0, row, squared} : c;
            corner.x = c.x + t * (next.x - c.x);
            corner.y = c.y + t * (next.y - c.y);
            cut_.push_back(corner);
            changed = true;
        }
        here = there;
    }
    if (!changed) return;
    cell_.swap(cut_);
    double farthest = 0.0;
    for (const Corner& c : cell_) farthest = std::max(farthest, c.x * c.x + c.y * c.y);
    reach_ = 4.0 * farthest;
}

}  // namespace pointmorph

#include "surface/delaunay_star.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace pointmorph {

void StarBuilder::look_at(Index i) {
    point_ = positions_.row(i);
    normal_ = normals_.row(i);
    // An orthonormal frame around the normal without a special case (Duff et al. 2017).
    const Vector3& n = normal_;
    const double sign = std::copysign(1.0, n[2]);
    const double a = -1.0 / (sign + n[2]), b = n[0] * n[1] * a;
    u_ = {1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]};
    v_ = {b, sign + n[1] * n[1] * a, -n[1]};
}

bool StarBuilder::unroll(Index j, double& x, double& y, double& squared) const {
    const Vector3 d = positions_.row(j).transpose() - point_;
    squared = d.squaredNorm();
    if (squared == 0.0 || normals_.row(j).dot(normal_) < kOpposed) return false;
    x = d.dot(u_), y = d.dot(v_);
    const double flat = x * x + y * y;
    if (flat < 0.04 * squared) return false;
    const double stretch = std::sqrt(squared / flat);
    x *= stretch;
    y *= stretch;
    return true;
}

bool StarBuilder::build(Index i, std::span<const Index> rows) {
    cell_.clear();
    look_at(i);
    const double farthest =
        rows.empty() ? 0.0 : (positions_.row(rows.back()).transpose() - point_).norm();
    if (farthest == 0.0) return true;
    const double side = 16.0 * farthest;
    cell_ = {{-side, -side, -1}, {side, -side, -1}, {side, side, -1}, {-side, side, -1}};
    reach_ = 8.0 * side * side;
    return extend(rows);
}

bool StarBuilder::is_surrounded(Index i, std::span<const Index> rows, double factor) {
    // Half of the directions in which a disc's center may lie; the others are opposite to these.
    constexpr std::size_t kHalf = 8, kAll = 2 * kHalf;
    constexpr double kOne = 0.92387953251128674, kTwo = 0.70710678118654752,
                     kThree = 0.38268343236508977;
    constexpr std::array<double, kHalf> kCosines{1.0, kOne,    kTwo,  kThree,
                                                 0.0, -kThree, -kTwo, -kOne},
        kSines{0.0, kThree, kTwo, kOne, 1.0, kOne, kTwo, kThree};
    look_at(i);
    std::array<double, 3> xs, ys, squares;  // of the nearest, by which the spacing is known
    std::size_t known = 0;
    double twice_radius = 0.0;
    std::uint32_t covered = 0;
    // A disc whose center lies in the direction c, at a distance r, holds a neighbor at d where
    // c · d > d² / 2r. What holds at both ends of a sixteenth of a turn holds in between.
    const auto cover = [&](double x, double y, double squared) {
        const double least = squared / twice_radius;
        std::uint32_t within = 0;
        for (std::size_t m = 0; m < kHalf; ++m) {
            const double along = kCosines[m] * x + kSines[m] * y;
            within |= (along > least ? 1u : 0u) << m;
            within |= (-along > least ? 1u : 0u) << (m + kHalf);
        }
        const std::uint32_t next = (within >> 1) | ((within & 1u) << (kAll - 1));
        covered |= within & next;
        return covered == (1u << kAll) - 1;
    };
    for (const Index j : rows) {
        double x, y, squared;
        if (!unroll(j, x, y, squared)) continue;
        if (known < 3) {
            xs[known] = x;
            ys[known] = y;
            squares[known++] = squared;
            if (known < 3) continue;
            // No spoke but two can be shorter than the third nearest point is far.
            twice_radius = 2.0 * factor * std::sqrt(squared);
            for (std::size_t k = 0; k < 3; ++k)
                if (cover(xs[k], ys[k], squares[k])) return true;
            continue;
        }
        if (squared >= twice_radius * twice_radius) return false;
        if (cover(x, y, squared)) return true;
    }
    return false;
}

bool StarBuilder::extend(std::span<const Index> rows) {
    for (const Index j : rows) {
        if ((positions_.row(j).transpose() - point_).squaredNorm() >= reach_) return true;
        double x, y, squared;
        if (unroll(j, x, y, squared)) cut(x, y, squared, j);
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
    // Points that coincide, or lie on one circle up to rounding, share a corner.
    const double tolerance = 1e-12 * squared;
    const std::size_t count = cell_.size();
    beyond_.resize(count);
    double farthest_beyond = -kInfinity;
    for (std::size_t k = 0; k < count; ++k) {
        beyond_[k] = cell_[k].x * x + cell_[k].y * y - 0.5 * squared;
        farthest_beyond = std::max(farthest_beyond, beyond_[k]);
    }
    if (farthest_beyond <= tolerance) return;
    cut_.clear();
    bool changed = false;
    for (std::size_t k = 0; k < count; ++k) {
        const std::size_t after = k + 1 < count ? k + 1 : 0;
        const Corner &c = cell_[k], &next = cell_[after];
        const double here = beyond_[k], there = beyond_[after];
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
    }
    if (!changed) return;
    cell_.swap(cut_);
    double farthest = 0.0;
    for (const Corner& c : cell_) farthest = std::max(farthest, c.x * c.x + c.y * c.y);
    reach_ = 4.0 * farthest;
}

}  // namespace pointmorph

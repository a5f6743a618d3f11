#include "pointmorph/surface/local_triangles.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr double kSameSheet = 0.3;  // cosine between normals
constexpr double kSteepest = 0.7;   // sine of the angle between a neighbor and the tangent plane
constexpr Index kOpen = -1;         // the neighbor beyond an edge of the box

/// A cell's corner, and the neighbor beyond the edge from it to the next corner.
struct Corner {
    Eigen::Vector2d place;
    Index beyond;
};

/// The cell of the origin in the Voronoi diagram, in a box; clipped by one neighbor after another.
class Cell {
public:
    void open(double half_side) {
        corners_.clear();
        for (const auto& [x, y] : {std::pair{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}})
            corners_.push_back({half_side * Eigen::Vector2d(x, y), kOpen});
    }

    /// Leaves what is nearer to the origin than to `site`.
    void clip(const Eigen::Vector2d& site, Index row) {
        const double limit = site.squaredNorm() / 2.0;
        const auto outside = [&](const Corner& corner) { return corner.place.dot(site) - limit; };
        if (std::ranges::none_of(corners_, [&](const Corner& c) { return outside(c) > 0.0; }))
            return;
        clipped_.clear();
        for (std::size_t i = 0; i < corners_.size(); ++i) {
            const Corner& from = corners_[i];
            const Corner& to = corners_[(i + 1) % corners_.size()];
            const double a = outside(from), b = outside(to);
            const Eigen::Vector2d cut =
                a == b ? from.place
                       : Eigen::Vector2d(from.place + a / (a - b) * (to.place - from.place));
            if (a <= 0.0) clipped_.push_back(from);
            if (a <= 0.0 && b > 0.0) clipped_.push_back({cut, row});
            if (a > 0.0 && b <= 0.0) clipped_.push_back({cut, from.beyond});
        }
        corners_.swap(clipped_);
    }

    /// Calls `take(a, b)` for neighbors whose edges meet.
    template <class Take>
    void each_corner(Take&& take) const {
        for (std::size_t i = 0; i < corners_.size(); ++i) {
            const Index before = corners_[i].beyond;
            const Index after = corners_[(i + 1) % corners_.size()].beyond;
            if (before != kOpen && after != kOpen && before != after) take(before, after);
        }
    }

private:
    std::vector<Corner> corners_, clipped_;
};

}  // namespace

std::vector<Triangle> sorted_once(std::span<const Triangle> triangles, Index rows,
                                  Progress& progress) {
    std::vector<std::ptrdiff_t> ends(to_size(rows) + 1, 0);
    for (const Triangle& corners : triangles) ++ends[to_size(corners[0]) + 1];
    std::partial_sum(ends.begin(), ends.end(), ends.begin());
    std::vector<Triangle> sorted(triangles.size());
    for (const Triangle& corners : triangles)
        sorted[to_size(ends[to_size(corners[0])]++)] = corners;
    const auto begin_of = [&](Index row) {
        return sorted.begin() + (row > 0 ? ends[to_size(row - 1)] : 0);
    };
    parallel_for(rows, progress, [&](Index begin, Index end) {
        for (Index row = begin; row < end; ++row) std::sort(begin_of(row), begin_of(row + 1));
    });
    const auto unique = std::ranges::unique(sorted);
    sorted.erase(unique.begin(), unique.end());
    return sorted;
}

std::vector<Triangle> local_triangles(const Positions& positions, const Normals& normals,
                                      const Neighborhoods& nearest, const Values& spacing,
                                      double reach, Progress& progress) {
    constexpr Index kChunk = 512;
    constexpr double kFound = 0.8;  // share of the time
    const Index count = nearest.size();
    std::vector<std::vector<Triangle>> found(to_size((count + kChunk - 1) / kChunk));
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            auto& triangles = found[to_size(begin / kChunk)];
            Cell cell;
            for (Index i = begin; i < end; ++i) {
                if (!(spacing[i] > 0.0)) continue;
                const Vector3 normal = normals.row(i).transpose();
                const Vector3 u = normal.unitOrthogonal(), v = normal.cross(u);
                // In spacings. A corner of the cell is the center of the circle through a triangle.
                cell.open(reach);
                for (const Index j : nearest[i]) {
                    const Vector3 d =
                        (positions.row(j) - positions.row(i)).transpose() / spacing[i];
                    const double length = d.norm();
                    if (!(length > 0.0) || normals.row(j).dot(normal) < kSameSheet ||
                        std::abs(d.dot(normal)) > kSteepest * length)
                        continue;
                    cell.clip({d.dot(u), d.dot(v)}, j);
                }
                cell.each_corner([&](Index a, Index b) {
                    Triangle triangle{i, a, b};
                    std::ranges::sort(triangle);
                    triangles.push_back(triangle);
                });
            }
        },
        0.0, kFound, kChunk);

    std::vector<Triangle> all;
    for (auto& triangles : found) {
        all.insert(all.end(), triangles.begin(), triangles.end());
        triangles = {};
    }
    const Progress::Part part(progress, kFound, 1.0);
    return sorted_once(all, count, progress);
}

}  // namespace pointmorph

#include "pointmorph/surface/local_triangles.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>

#include "base/unset.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr double kSameSheet = 0.3;  // cosine between normals
constexpr double kSteepest = 0.7;   // sine of the angle between a neighbor and the tangent plane
constexpr Index kOpen = -1;         // the neighbor beyond an edge of the box

/// The cell of the origin in the Voronoi diagram, in a box; clipped by one neighbor after another.
class Cell {
public:
    /// So many neighbors can clip it.
    static constexpr std::size_t kMost = 60;

    Cell() = default;
    Cell(Cell&&) = delete;  // it refers to its own corners

    void open(double half_side) {
        count_ = 0;
        for (const auto& [x, y] : {std::pair{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}})
            now_->put(count_++, half_side * x, half_side * y, kOpen);
    }

    /// Leaves what is nearer to the origin than to the place of `row`.
    void clip(double x, double y, Index row) {
        const double limit = (x * x + y * y) / 2.0;
        std::uint64_t outside = 0;
        for (std::size_t i = 0; i < count_; ++i) {
            outside_[i] = now_->x[i] * x + now_->y[i] * y - limit;
            outside |= std::uint64_t{outside_[i] > 0.0} << i;
        }
        if (outside == 0) return;
        // Corners outside are next to each other, unless rounding has it otherwise.
        const std::uint64_t after = (outside << 1 | outside >> (count_ - 1)) & all();
        const std::uint64_t firsts = outside & ~after;
        if (count_ + to_size(std::popcount(firsts)) > kMostCorners) return;
        if (std::has_single_bit(firsts))
            cut_off(to_size(std::countr_zero(firsts)), to_size(std::popcount(outside)), row);
        else
            cut_all(row);
    }

    /// Calls `take(a, b)` for neighbors whose edges meet.
    template <class Take>
    void each_corner(Take&& take) const {
        for (std::size_t i = 0; i < count_; ++i) {
            const Index before = now_->beyond[i];
            const Index after = now_->beyond[next(i)];
            if (before != kOpen && after != kOpen && before != after) take(before, after);
        }
    }

private:
    static constexpr std::size_t kMostCorners = kMost + 4, kFewKept = 6,
                                 kRoom = kMostCorners + 2 + kFewKept;

    /// And the neighbors beyond the edges from them to the next corners.
    struct Corners {
        std::array<double, kRoom> x{}, y{};
        std::array<Index, kRoom> beyond{};

        void put(std::size_t at, double to_x, double to_y, Index row) {
            x[at] = to_x;
            y[at] = to_y;
            beyond[at] = row;
        }
    };

    std::uint64_t all() const { return ~std::uint64_t{0} >> (64 - count_); }
    std::size_t next(std::size_t i) const { return i + 1 < count_ ? i + 1 : 0; }

    void put_cut(std::size_t at, std::size_t from, std::size_t to, Index row) {
        const double a = outside_[from], b = outside_[to];
        const double share = a / (a - b);
        then_->put(at, now_->x[from] + share * (now_->x[to] - now_->x[from]),
                   now_->y[from] + share * (now_->y[to] - now_->y[from]), row);
    }

    /// Replaces some corners by two, which then come first.
    void cut_off(std::size_t first, std::size_t some, Index row) {
        const auto wrapped = [&](std::size_t i) { return i < count_ ? i : i - count_; };
        const std::size_t last = wrapped(first + some - 1), kept = next(last);
        put_cut(0, first > 0 ? first - 1 : count_ - 1, first, row);
        put_cut(1, last, kept, now_->beyond[last]);
        const std::size_t rest = count_ - some;
        const auto keep = [&](std::size_t k) {
            const std::size_t i = wrapped(kept + k);
            then_->put(2 + k, now_->x[i], now_->y[i], now_->beyond[i]);
        };
        for (std::size_t k = 0; k < kFewKept; ++k) keep(k);  // nobody can foresee how many
        for (std::size_t k = kFewKept; k < rest; ++k) keep(k);
        count_ = rest + 2;
        std::swap(now_, then_);
    }

    void cut_all(Index row) {
        std::size_t count = 0;
        for (std::size_t i = 0; i < count_; ++i) {
            const std::size_t to = next(i);
            if (outside_[i] <= 0.0) then_->put(count++, now_->x[i], now_->y[i], now_->beyond[i]);
            if (outside_[i] <= 0.0 && outside_[to] > 0.0) put_cut(count++, i, to, row);
            if (outside_[i] > 0.0 && outside_[to] <= 0.0) put_cut(count++, i, to, now_->beyond[i]);
        }
        count_ = count;
        std::swap(now_, then_);
    }

    Corners one_, other_;
    Corners *now_ = &one_, *then_ = &other_;  ///< what it is, and what it becomes
    std::array<double, kRoom> outside_{};
    std::size_t count_ = 0;
};

/// Three rows in ascending order, without a branch that nobody can foresee.
Triangle ascending(Index a, Index b, Index c) {
    const Index low = std::min(a, b), high = std::max(a, b);
    return {std::min(low, c), std::max(low, std::min(high, c)), std::max(high, c)};
}

}  // namespace

std::vector<Triangle> sorted_once(std::span<const Triangle> triangles, Index rows,
                                  Progress& progress) {
    constexpr double kSorted = 0.7;  // share of the time
    // Where the triangles of each row begin; both other corners become one number.
    std::vector<std::size_t> begins(to_size(rows) + 2, 0);
    for (const auto& [first, second, third] : triangles)
        if (first >= 0) ++begins[to_size(first) + 2];
    std::partial_sum(begins.begin(), begins.end(), begins.begin());
    UnsetVector<std::uint64_t> others(begins.back());
    for (const auto& [first, second, third] : triangles)
        if (first >= 0)
            others[begins[to_size(first) + 1]++] =
                std::uint64_t{to_size(second)} << 32 | to_size(third);
    std::vector<std::size_t> kept(to_size(rows) + 1, 0);
    const auto begin_of = [&](Index row) {
        return others.begin() + static_cast<std::ptrdiff_t>(begins[to_size(row)]);
    };
    const auto sort = [&](Index begin, Index end) {
        for (Index row = begin; row < end; ++row) {
            std::sort(begin_of(row), begin_of(row + 1));
            kept[to_size(row) + 1] =
                to_size(std::unique(begin_of(row), begin_of(row + 1)) - begin_of(row));
        }
    };
    parallel_for(rows, progress, sort, 0.0, kSorted);
    std::partial_sum(kept.begin(), kept.end(), kept.begin());
    std::vector<Triangle> sorted(kept.back());
    const auto put = [&](Index begin, Index end) {
        for (Index row = begin; row < end; ++row) {
            auto other = begin_of(row);
            for (std::size_t at = kept[to_size(row)]; at < kept[to_size(row) + 1]; ++at, ++other)
                sorted[at] = {row, static_cast<Index>(*other >> 32),
                              static_cast<Index>(*other & 0xffffffffU)};
        }
    };
    parallel_for(rows, progress, put, kSorted, 1.0);
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
                for (const Index j : nearest[i].first(std::min(nearest[i].size(), Cell::kMost))) {
                    const Vector3 d =
                        (positions.row(j) - positions.row(i)).transpose() / spacing[i];
                    const double length = d.norm();
                    if (!(length > 0.0) || normals.row(j).dot(normal) < kSameSheet ||
                        std::abs(d.dot(normal)) > kSteepest * length)
                        continue;
                    cell.clip(d.dot(u), d.dot(v), j);
                }
                cell.each_corner(
                    [&](Index a, Index b) { triangles.push_back(ascending(i, a, b)); });
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

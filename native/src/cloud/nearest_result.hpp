// The nearest of the points that a search looks at. Not a part of the library.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/compiler.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Keeps the nearest points, ties by row, so that the result doesn't depend on the tree's shape.
/// nanoflann's own takes whichever of several equally far points it meets first.
class NearestResult {
public:
    using DistanceType = double;
    using IndexType = Index;

    NearestResult(double squared_radius, std::span<Index> rows, std::span<double> squared_distances)
        : rows_(rows.data()),
          squared_(squared_distances.data()),
          most_(rows.size()),
          squared_radius_(squared_radius),
          worst_(squared_radius) {}

    bool addPoint(double squared_distance, Index row) {
        if (!(squared_distance < squared_radius_)) return true;
        std::size_t i = size_;
        if (full()) {
            --i;
            if (squared_distance > squared_[i] ||
                (squared_distance == squared_[i] && row > rows_[i]))
                return true;
        } else {
            ++size_;
        }
        for (; i > 0 && squared_[i - 1] > squared_distance; --i) {
            squared_[i] = squared_[i - 1];
            rows_[i] = rows_[i - 1];
        }
        for (; i > 0 && squared_[i - 1] == squared_distance && rows_[i - 1] > row; --i) {
            squared_[i] = squared_[i - 1];
            rows_[i] = rows_[i - 1];
        }
        squared_[i] = squared_distance;
        rows_[i] = row;
        if (full()) {
            const double farthest = squared_[size_ - 1];
            worst_ = farthest > 0.0 ? farthest * (1.0 + 1e-14) : -1.0;
        }
        return true;
    }

    /// Points closer than this are looked at. A little more than the farthest that is kept, for
    /// ties and for the rounding of boxes' distances; nothing where all that are kept coincide
    /// with the query, as a crowd of such points would all be looked at else.
    double worstDist() const { return worst_; }
    bool full() const { return size_ == most_; }
    std::size_t size() const { return size_; }
    bool empty() const { return size_ == 0; }

private:
    Index* rows_;
    double* squared_;  // distances
    std::size_t most_, size_ = 0;
    double squared_radius_, worst_;
};

/// The same for one point.
class NearestOne {
public:
    using DistanceType = double;
    using IndexType = Index;

    explicit NearestOne(double squared_radius) : squared_(squared_radius), worst_(squared_radius) {}

    bool addPoint(double squared_distance, Index row) {
        if (squared_distance < squared_ || (squared_distance == squared_ && row < row_)) {
            squared_ = squared_distance;
            row_ = row;
            worst_ = squared_distance > 0.0 ? squared_distance * (1.0 + 1e-14) : -1.0;
        }
        return true;
    }
    double worstDist() const { return worst_; }
    bool full() const { return !empty(); }
    std::size_t size() const { return empty() ? 0 : 1; }
    bool empty() const { return row_ < 0; }

    Index row() const { return row_; }
    double squared() const { return squared_; }

private:
    double squared_, worst_;
    Index row_ = -1;
};

/// The same for 2 * Halves points at the most, of a tree that hands over the points of a leaf at
/// once. Distances alone are kept sorted, in registers and without a branch that nobody can
/// foresee; rows are sought out in the end, among those of all that were near enough at their time.
template <std::size_t Halves>
class FewNearest {
public:
    FewNearest(double squared_radius, std::size_t most) : most_(most), worst_(squared_radius) {
        kept_.fill(Two{kFar, kFar});
    }

    /// False ends the search.
    bool add_all(const double* squared, const Index* rows, std::size_t count) {
        if (seen_ + count > kRoom && !make_room(count)) return false;
        const std::size_t first = seen_;
        for (std::size_t k = 0; k < count; ++k) {
            squared_[seen_] = squared[k];
            rows_[seen_] = rows[k];
            seen_ += squared[k] < worst_ ? 1 : 0;
        }
        if (seen_ == first) return true;
        std::array<Two, Halves> kept = kept_;
        for (std::size_t k = first; k < seen_; ++k) {
            // Each of the kept, or the new one if that comes before it, or the one before.
            const Two here = {squared_[k], squared_[k]};
            const Two before = {-kFar, kept[Halves - 1][0]};
            for (std::size_t h = Halves; h-- > 1;)
                kept[h] = larger(kept[h - 1], smaller(kept[h], here));
            kept[0] = larger(before, smaller(kept[0], here));
        }
        kept_ = kept;
        const double farthest = distance(most_ - 1);
        if (farthest < kFar) worst_ = farthest > 0.0 ? farthest * (1.0 + 1e-14) : -1.0;
        return true;
    }

    double worstDist() const { return worst_; }

    /// How many there are, written in order; nothing where they can't be told: where too many are
    /// as far, or coincide with the query.
    std::optional<std::size_t> write(Index* rows, double* squared) {
        if (crowded_ || worst_ < 0.0) return std::nullopt;
        keep_near();
        const std::size_t count = std::min(seen_, most_);
        std::size_t ranks = 0;
        if (seen_ <= most_)
            for (std::size_t k = 0; k < count; ++k) {
                const std::size_t place = rank(squared_[k]);
                rows[place] = rows_[k];
                squared[place] = squared_[k];
                ranks += place;
            }
        if (seen_ <= most_ && 2 * ranks == count * (count - 1)) return count;
        // Some are as far as each other.
        NearestResult sorted(kFar, {rows, count}, {squared, count});
        for (std::size_t k = 0; k < seen_; ++k) sorted.addPoint(squared_[k], rows_[k]);
        return count;
    }

private:
    static constexpr double kFar = std::numeric_limits<double>::infinity();
    static constexpr std::size_t kRoom = 128;

    /// The first half of the kept ones is the registers' first numbers.
    double distance(std::size_t place) const { return kept_[place % Halves][place / Halves]; }

    /// How many of the kept ones are nearer.
    std::size_t rank(double squared) const {
        CountBelow nearer(squared);
        for (const Two& two : kept_) nearer.look_at(two);
        return nearer.count();
    }

    void keep_near() {
        const double farthest = distance(most_ - 1);
        std::size_t near = 0;
        for (std::size_t k = 0; k < seen_; ++k) {
            squared_[near] = squared_[k];
            rows_[near] = rows_[k];
            near += squared_[k] <= farthest ? 1 : 0;
        }
        seen_ = near;
    }

    bool make_room(std::size_t count) {
        keep_near();
        crowded_ = seen_ + count > kRoom;
        return !crowded_;
    }

    std::array<Two, Halves> kept_;
    std::array<double, kRoom> squared_;
    std::array<Index, kRoom> rows_;
    std::size_t seen_ = 0, most_;
    bool crowded_ = false;
    double worst_;
};

/// Collects everything closer than a radius (nanoflann's own has no strict bound).
class BallResult {
public:
    using DistanceType = double;
    using IndexType = Index;

    BallResult(double squared_radius, std::vector<std::pair<Index, double>>& result)
        : squared_radius_(squared_radius), result_(result) {}

    bool addPoint(double squared_distance, Index row) {
        if (squared_distance < squared_radius_) result_.emplace_back(row, squared_distance);
        return true;
    }
    /// The same for a leaf, without a branch that nobody can foresee.
    bool add_all(const double* squared, const Index* rows, std::size_t count) {
        std::size_t found = result_.size();
        result_.resize(found + count);
        for (std::size_t k = 0; k < count; ++k) {
            result_[found] = {rows[k], squared[k]};
            found += squared[k] < squared_radius_ ? 1 : 0;
        }
        result_.resize(found);
        return true;
    }
    double worstDist() const { return squared_radius_; }
    bool full() const { return true; }
    std::size_t size() const { return result_.size(); }
    bool empty() const { return result_.empty(); }

private:
    double squared_radius_;
    std::vector<std::pair<Index, double>>& result_;
};

}  // namespace pointmorph

// The nearest of the points that a search looks at. Not a part of the library.
#pragma once

#include <cstddef>
#include <span>

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

}  // namespace pointmorph

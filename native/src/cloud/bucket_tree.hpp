// A kd-tree for many dimensions, where distances cost more than the way to them: its leaves lie in
// memory coordinate by coordinate, so that the distances to all of a leaf's points come at once.
#pragma once

#include <algorithm>
#include <array>
#include <numeric>
#include <utility>
#include <vector>

#include "base/compiler.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

/// Queries take the result classes that nanoflann's do: see kd_tree.cpp.
template <int Dim>
class BucketTree {
public:
    using Points = typename KdTree<Dim>::Points;

    /// One point or more. Keeps no reference.
    explicit BucketTree(const Points& points) {
        std::vector<Index> rows(to_size(points.rows()));
        std::iota(rows.begin(), rows.end(), 0);
        lower_ = points.colwise().minCoeff();
        upper_ = points.colwise().maxCoeff();
        buckets_.reserve((rows.size() + kSize - 1) / kSize);
        nodes_.reserve(2 * buckets_.capacity());
        split(points, rows.data(), rows.data() + rows.size());
        keys_ = {};
    }

    template <class Result>
    void find(Result& result, const double* query) const {
        std::array<double, Dim> outside;  // squared, along each axis
        double squared = 0.0;
        for (std::size_t d = 0; d < Dim; ++d) {
            const auto axis = static_cast<Eigen::Index>(d);
            const double off = std::max({lower_[axis] - query[d], query[d] - upper_[axis], 0.0});
            outside[d] = off * off;
            squared += outside[d];
        }
        search(0, query, squared, outside, result);
    }

private:
    using Row = Eigen::Matrix<double, 1, Dim>;

    static constexpr std::size_t kSize = 16;  // points of a leaf
    static constexpr std::size_t kTwos = kSize / 2;
    static constexpr std::size_t kHalf = Dim / 2;

    struct Bucket {
        std::array<std::array<Two, kTwos>, Dim> coordinates;
        std::array<Index, kSize> rows;
        std::size_t size;
    };
    struct Node {
        Index axis;  ///< −1 for a leaf
        Index next;  ///< the second child, the first being the node after this one; or the bucket
        double below, above;  ///< where the first child ends and the second one begins
    };

    void split(const Points& points, Index* begin, Index* end) {
        const auto here = nodes_.size();
        const auto size = to_size(end - begin);
        if (size <= kSize) {
            nodes_.push_back({-1, to_index(buckets_.size()), 0.0, 0.0});
            fill(points, begin, size);
            return;
        }
        Row lower = points.row(*begin), upper = lower;
        for (const Index* i = begin + 1; i < end; ++i) {
            lower = lower.cwiseMin(points.row(*i));
            upper = upper.cwiseMax(points.row(*i));
        }
        Eigen::Index axis;
        (upper - lower).maxCoeff(&axis);
        // Full leaves but for the last one.
        const std::size_t buckets = (size + kSize - 1) / kSize;
        Index* const middle = begin + static_cast<std::ptrdiff_t>(buckets / 2 * kSize);
        // Next to their rows, so that the selection reads memory in order.
        keys_.clear();
        for (const Index* i = begin; i < end; ++i) keys_.emplace_back(points(*i, axis), *i);
        const auto middle_key = keys_.begin() + (middle - begin);
        std::nth_element(keys_.begin(), middle_key, keys_.end());
        double below = keys_.front().first;
        for (auto key = keys_.begin(); key != middle_key; ++key)
            below = std::max(below, key->first);
        nodes_.push_back({to_index(axis), 0, below, middle_key->first});
        std::ranges::transform(keys_, begin, &std::pair<double, Index>::second);
        split(points, begin, middle);
        nodes_[here].next = to_index(nodes_.size());
        split(points, middle, end);
    }

    void fill(const Points& points, const Index* rows, std::size_t size) {
        Bucket& bucket = buckets_.emplace_back();
        bucket.size = size;
        for (std::size_t k = 0; k < kSize; ++k) {
            const Index row = rows[std::min(k, size - 1)];  // the last fills what is left
            bucket.rows[k] = row;
            for (std::size_t d = 0; d < Dim; ++d)
                bucket.coordinates[d][k / 2][k % 2] = points(row, static_cast<Eigen::Index>(d));
        }
    }

    /// `squared` and `outside`: how far the node's box is from the query, at least. False ends it.
    template <class Result>
    bool search(std::size_t at, const double* query, double squared,
                std::array<double, Dim>& outside, Result& result) const {
        const Node& node = nodes_[at];
        if (node.axis < 0) return look_at(buckets_[to_size(node.next)], query, result);
        const auto axis = to_size(node.axis);
        const double to_below = query[axis] - node.below, to_above = query[axis] - node.above;
        const bool first = to_below + to_above < 0.0;
        const auto second = to_size(node.next);
        if (!search(first ? at + 1 : second, query, squared, outside, result)) return false;
        const double off = first ? to_above : to_below;
        const double there = squared + off * off - outside[axis];
        if (there > result.worstDist()) return true;
        const double before = std::exchange(outside[axis], off * off);
        const bool on = search(first ? second : at + 1, query, there, outside, result);
        outside[axis] = before;
        return on;
    }

    template <class Result>
    static bool look_at(const Bucket& bucket, const double* query, Result& result) {
        alignas(16) std::array<double, 8> squared;
        for (std::size_t first = 0; first < kTwos; first += 4) {  // four stay in registers
            const std::size_t points =
                std::min<std::size_t>(8, bucket.size - std::min(bucket.size, 2 * first));
            if (points == 0) break;
            Two a{}, b{}, c{}, d{};
            const auto add = [&](std::size_t begin, std::size_t end) {
                for (std::size_t axis = begin; axis < end; ++axis) {
                    const Two q = {query[axis], query[axis]};
                    const Two* const p = bucket.coordinates[axis].data() + first;
                    const Two to_a = q - p[0], to_b = q - p[1], to_c = q - p[2], to_d = q - p[3];
                    a += to_a * to_a;
                    b += to_b * to_b;
                    c += to_c * to_c;
                    d += to_d * to_d;
                }
                std::size_t k = 0;
                for (const Two& two : {a, b, c, d}) {
                    squared[k++] = two[0];
                    squared[k++] = two[1];
                }
            };
            const double worst = result.worstDist();
            // Most are too far off after half of the axes.
            add(0, kHalf);
            if (*std::ranges::min_element(squared) >= worst) continue;
            add(kHalf, Dim);
            for (std::size_t k = 0; k < points; ++k)
                if (squared[k] < worst && !result.addPoint(squared[k], bucket.rows[2 * first + k]))
                    return false;
        }
        return true;
    }

    Row lower_, upper_;
    std::vector<Node> nodes_;
    std::vector<Bucket> buckets_;
    std::vector<std::pair<double, Index>> keys_;  ///< while it is built
};

}  // namespace pointmorph

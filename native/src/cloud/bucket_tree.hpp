// A kd-tree whose leaves lie in memory coordinate by coordinate, so that the distances to all of a
// leaf's points come at once.
#pragma once

#include <algorithm>
#include <array>
#include <numeric>
#include <utility>
#include <vector>

#include "base/compiler.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

/// Queries take the result classes that nanoflann's do: see kd_tree.cpp.
template <int Dim>
class BucketTree {
public:
    using Points = typename KdTree<Dim>::Points;

    /// One point or more. Keeps no reference. With many axes, large ones are built on all threads.
    explicit BucketTree(const Points& points) {
        const auto count = to_size(points.rows());
        lower_ = upper_ = points.row(0);
        for (Eigen::Index i = 1; i < points.rows(); ++i) {
            lower_ = lower_.cwiseMin(points.row(i));
            upper_ = upper_.cwiseMax(points.row(i));
        }
        if constexpr (kFew) {
            buckets_.reserve((2 * count + kSize - 1) / kSize);
            nodes_.reserve(2 * buckets_.capacity());
            std::vector<Placed> placed(count);
            for (std::size_t i = 0; i < count; ++i)
                placed[i] = {points.row(static_cast<Eigen::Index>(i)), to_index(i)};
            halve(placed.data(), placed.data() + count, {lower_, upper_});
        } else {
            buckets_.resize((count + kSize - 1) / kSize);
            nodes_.resize(2 * buckets_.size() - 1);
            std::vector<Index> rows(count);
            std::iota(rows.begin(), rows.end(), 0);
            split_on_all_threads(points, {rows.data(), rows.data() + count, 0, 0});
        }
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
    using Row = Eigen::Matrix<double, 1, Dim, Eigen::RowMajor | Eigen::DontAlign>;

    static constexpr std::size_t kSize = 16;  // points of a leaf
    static constexpr std::size_t kTwos = kSize / 2;
    /// Few coordinates are moved as fast as their numbers are, and boxes that are halved are
    /// rounder; with many, full leaves count for more, and most points are too far off after half
    /// of the axes.
    static constexpr bool kFew = Dim <= 3;
    /// A half with less than that share of the points isn't worth a level of the tree.
    static constexpr std::ptrdiff_t kLeastShare = 16;

    struct Placed {
        Row at;
        Index row;
    };
    struct Box {
        Row lower, upper;
    };
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

    static Box box_of(const Placed* begin, const Placed* end) {
        Box box{begin->at, begin->at};
        for (const Placed* point = begin + 1; point < end; ++point)
            for (Eigen::Index d = 0; d < Dim; ++d) {
                box.lower[d] = std::min(box.lower[d], point->at[d]);
                box.upper[d] = std::max(box.upper[d], point->at[d]);
            }
        return box;
    }

    /// Puts those below first, without a branch that nobody can foresee.
    static Placed* put_below_first(Placed* begin, Placed* end, Eigen::Index axis, double middle) {
        Placed* cut = begin;
        for (Placed* point = begin; point < end; ++point) {
            const Placed here = *point;
            *point = *cut;
            *cut = here;
            cut += here.at[axis] < middle;
        }
        return cut;
    }

    /// `box` is that of the points.
    void halve(Placed* begin, Placed* end, const Box& box) {
        const auto size = end - begin;
        if (to_size(size) <= kSize) {
            nodes_.push_back({-1, to_index(buckets_.size()), 0.0, 0.0});
            fill(
                buckets_.emplace_back(), to_size(size), [&](std::size_t k) { return begin[k].row; },
                [&](std::size_t k, Eigen::Index axis) { return begin[k].at[axis]; });
            return;
        }
        Eigen::Index axis;
        (box.upper - box.lower).maxCoeff(&axis);
        const double middle = 0.5 * box.lower[axis] + 0.5 * box.upper[axis];
        Placed* cut = put_below_first(begin, end, axis, middle);
        if (std::min(cut - begin, end - cut) * kLeastShare < size) {
            cut = begin + size / 2;
            std::nth_element(begin, cut, end, [axis](const Placed& a, const Placed& b) {
                return a.at[axis] != b.at[axis] ? a.at[axis] < b.at[axis] : a.row < b.row;
            });
        }
        const Box first = box_of(begin, cut), second = box_of(cut, end);
        const auto here = nodes_.size();
        nodes_.push_back({to_index(axis), 0, first.upper[axis], second.lower[axis]});
        halve(begin, cut, first);
        nodes_[here].next = to_index(nodes_.size());
        halve(cut, end, second);
    }

    /// Points that become a part of the tree. All leaves are full but for the last one, so that it
    /// is known where each part lies.
    struct Part {
        Index *begin, *end;  ///< rows
        std::size_t node, bucket;

        std::size_t size() const { return to_size(end - begin); }
        std::size_t buckets() const { return (size() + kSize - 1) / kSize; }
    };
    using Keys = std::vector<std::pair<double, Index>>;

    void split_on_all_threads(const Points& points, const Part& whole) {
        constexpr std::size_t kWorthATeam = 8192, kParts = 8;
        std::vector<Part> parts{whole};
        while (whole.size() >= kWorthATeam && parts.size() < kParts) {
            std::vector<Part> halves(2 * parts.size());
            parallel_invoke(static_cast<int>(parts.size()), [&](int k, bool) {
                Keys keys;
                const auto [first, second] = cut_in_two(points, parts[to_size(k)], keys);
                halves[2 * to_size(k)] = first;
                halves[2 * to_size(k) + 1] = second;
            });
            parts = std::move(halves);
        }
        parallel_invoke(static_cast<int>(parts.size()), [&](int k, bool) {
            Keys keys;
            split(points, parts[to_size(k)], keys);
        });
    }

    void split(const Points& points, const Part& part, Keys& keys) {
        if (part.size() <= kSize) {
            nodes_[part.node] = {-1, to_index(part.bucket), 0.0, 0.0};
            fill(
                buckets_[part.bucket], part.size(), [&](std::size_t k) { return part.begin[k]; },
                [&](std::size_t k, Eigen::Index axis) { return points(part.begin[k], axis); });
            return;
        }
        const auto [first, second] = cut_in_two(points, part, keys);
        split(points, first, keys);
        split(points, second, keys);
    }

    /// Of a part with more points than a leaf has; `keys` is scratch memory.
    std::pair<Part, Part> cut_in_two(const Points& points, const Part& part, Keys& keys) {
        const auto [begin, end, node, bucket] = part;
        Row lower = points.row(*begin), upper = lower;
        for (const Index* i = begin + 1; i < end; ++i) {
            lower = lower.cwiseMin(points.row(*i));
            upper = upper.cwiseMax(points.row(*i));
        }
        Eigen::Index axis;
        (upper - lower).maxCoeff(&axis);
        const std::size_t buckets = part.buckets() / 2;
        Index* const middle = begin + static_cast<std::ptrdiff_t>(buckets * kSize);
        // Next to their rows, so that the selection reads memory in order.
        keys.clear();
        for (const Index* i = begin; i < end; ++i) keys.emplace_back(points(*i, axis), *i);
        const auto middle_key = keys.begin() + (middle - begin);
        std::nth_element(keys.begin(), middle_key, keys.end());
        double below = keys.front().first;
        for (auto key = keys.begin(); key != middle_key; ++key) below = std::max(below, key->first);
        std::ranges::transform(keys, begin, &std::pair<double, Index>::second);
        const Part second{middle, end, node + 2 * buckets, bucket + buckets};
        nodes_[node] = {to_index(axis), to_index(second.node), below, middle_key->first};
        return {{begin, middle, node + 1, bucket}, second};
    }

    template <class RowOf, class CoordinateOf>
    static void fill(Bucket& bucket, std::size_t size, const RowOf& row_of,
                     const CoordinateOf& coordinate_of) {
        bucket.size = size;
        for (std::size_t k = 0; k < kSize; ++k) {
            const std::size_t from = std::min(k, size - 1);  // the last fills what is left
            bucket.rows[k] = row_of(from);
            for (std::size_t d = 0; d < Dim; ++d)
                bucket.coordinates[d][k / 2][k % 2] =
                    coordinate_of(from, static_cast<Eigen::Index>(d));
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
        if constexpr (kFew)
            return look_at_all(bucket, query, result);
        else
            return look_by_eights(bucket, query, result);
    }

    /// Adds what is near enough. False ends the search.
    template <class Result>
    static bool add_near(const double* squared, const Index* rows, std::size_t count,
                         Result& result) {
        double worst = result.worstDist();
        for (std::size_t k = 0; k < count; ++k)
            if (squared[k] < worst) {
                if (!result.addPoint(squared[k], rows[k])) return false;
                worst = result.worstDist();
            }
        return true;
    }

    template <class Result>
    static bool look_at_all(const Bucket& bucket, const double* query, Result& result) {
        alignas(16) std::array<double, kSize> squared;
        for (std::size_t k = 0; 2 * k < bucket.size; ++k) {
            Two sum{};
            for (std::size_t axis = 0; axis < Dim; ++axis) {
                const Two q = {query[axis], query[axis]};
                const Two to = q - bucket.coordinates[axis][k];
                sum += to * to;
            }
            squared[2 * k] = sum[0];
            squared[2 * k + 1] = sum[1];
        }
        return add_near(squared.data(), bucket.rows.data(), bucket.size, result);
    }

    template <class Result>
    static bool look_by_eights(const Bucket& bucket, const double* query, Result& result) {
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
            add(0, Dim / 2);
            if (*std::ranges::min_element(squared) >= result.worstDist()) continue;
            add(Dim / 2, Dim);
            if (!add_near(squared.data(), bucket.rows.data() + 2 * first, points, result))
                return false;
        }
        return true;
    }

    Row lower_, upper_;
    std::vector<Node> nodes_;
    std::vector<Bucket> buckets_;
};

}  // namespace pointmorph

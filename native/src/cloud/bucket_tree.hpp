// A kd-tree whose leaves lie in memory coordinate by coordinate, so that the distances to all of a
// leaf's points come at once.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <functional>
#include <tuple>
#include <utility>
#include <vector>

#include "base/compiler.hpp"
#include "base/unset.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

/// A node of a BucketTree.
struct TreeNode {
    Index axis;  ///< of a leaf: less than 0 by the number of its points
    Index next;  ///< the second child, the first being the node after this one; of a leaf: how
                 ///< many twos lie before its own
    double below, above;  ///< where the first child ends and the second one begins
};

/// Points that become a part of a tree with many axes. All leaves are full but for the last one, so
/// that it is known where each part lies.
struct TreePart {
    static constexpr std::size_t kSize = 16;  ///< points of a leaf

    Index *begin, *end;  ///< rows
    std::size_t node, leaf;

    std::size_t size() const { return to_size(end - begin); }
    std::size_t leaves() const { return (size() + kSize - 1) / kSize; }
};

/// A coordinate next to its row, so that the selection reads memory in order.
struct TreeKey {
    double at;
    Index row;

    bool operator<(const TreeKey& other) const {
        return at != other.at ? at < other.at : row < other.row;
    }
};
using TreeKeys = UnsetVector<TreeKey>;

/// Puts those below first, without a branch that nobody can foresee. Returns where they end.
template <class Item, class IsBelow>
Item* put_below_first(Item* begin, Item* end, IsBelow&& is_below) {
    Item* cut = begin;
    for (Item* item = begin; item < end; ++item) {
        const Item here = *item;
        *item = *cut;
        *cut = here;
        cut += is_below(here) ? 1 : 0;
    }
    return cut;
}

/// As std::nth_element(), in half of the time.
inline void select_nth(TreeKey* begin, TreeKey* nth, TreeKey* end) {
    constexpr std::ptrdiff_t kFew = 24, kMany = 800;
    constexpr int kMostRounds = 60;  // many times as many as there ever are
    std::array<TreeKey, 16> samples;
    for (int round = 0; round < kMostRounds && end - begin > kFew; ++round) {
        const std::ptrdiff_t size = end - begin, count = size < kMany ? 5 : 16;
        for (std::ptrdiff_t k = 0; k < count; ++k)
            samples[to_size(k)] = begin[(2 * k + 1) * size / (2 * count)];
        std::sort(samples.begin(), samples.begin() + count);
        const TreeKey pivot = samples[to_size((nth - begin) * count / size)];
        TreeKey* const cut = put_below_first(begin, end, [&](const TreeKey& key) {
            return (key.at < pivot.at) | ((key.at == pivot.at) & (key.row < pivot.row));
        });
        if (nth < cut)
            end = cut;
        else if (begin < cut)
            begin = cut;
        else  // the pivot is the least
            break;
    }
    std::nth_element(begin, nth, end);
}

/// Of a part with more points than a leaf has. `keys`: its own, along that axis.
inline std::pair<TreePart, TreePart> cut_in_two(const TreePart& part, Index axis, TreeKeys& keys,
                                                std::vector<TreeNode>& nodes) {
    const auto [begin, end, node, leaf] = part;
    const std::size_t leaves = part.leaves() / 2;
    Index* const middle = begin + static_cast<std::ptrdiff_t>(leaves * TreePart::kSize);
    TreeKey* const middle_key = keys.data() + (middle - begin);
    select_nth(keys.data(), middle_key, keys.data() + keys.size());
    double below = keys.front().at;
    for (const TreeKey* key = keys.data(); key != middle_key; ++key)
        below = std::max(below, key->at);
    std::ranges::transform(keys, begin, &TreeKey::row);
    const TreePart second{middle, end, node + 2 * leaves, leaf + leaves};
    nodes[node] = {axis, to_index(second.node), below, middle_key->at};
    return {{begin, middle, node + 1, leaf}, second};
}

/// How a large tree with many axes is shared among threads.
struct TreeParts {
    static constexpr std::size_t kWorthATeam = 8192;  // points
    static constexpr std::size_t kCount = 8;

    using Cut = std::function<std::pair<TreePart, TreePart>(const TreePart&)>;

    /// Calls `work(number, begin, end)` for pieces of [0, count); returns how many they are.
    static std::size_t in_pieces(
        std::size_t count, const std::function<void(std::size_t, std::size_t, std::size_t)>& work) {
        const std::size_t pieces = count < kWorthATeam ? 1 : kCount;
        parallel_invoke(static_cast<int>(pieces), [&](int k, bool) {
            const std::size_t piece = to_size(k);
            work(piece, piece * count / pieces, (piece + 1) * count / pieces);
        });
        return pieces;
    }

    /// Calls `finish` for the parts that `cut` makes of a whole whose halves are given.
    static void split(std::vector<TreePart> parts, const Cut& cut,
                      const std::function<void(const TreePart&)>& finish) {
        const std::size_t size = parts.front().size() + parts.back().size();
        while (size >= kWorthATeam && parts.size() < kCount) {
            std::vector<TreePart> halves(2 * parts.size());
            parallel_invoke(static_cast<int>(parts.size()), [&](int k, bool) {
                std::tie(halves[2 * to_size(k)], halves[2 * to_size(k) + 1]) =
                    cut(parts[to_size(k)]);
            });
            parts = std::move(halves);
        }
        parallel_invoke(static_cast<int>(parts.size()),
                        [&](int k, bool) { finish(parts[to_size(k)]); });
    }
};

/// Queries take the result classes that nanoflann's do: see kd_tree.cpp.
template <int Dim>
class BucketTree {
public:
    using Points = typename KdTree<Dim>::Points;

    /// One point or more. Keeps no reference. With many axes, large ones are built on all threads.
    explicit BucketTree(const Points& points) {
        const auto count = to_size(points.rows());
        if constexpr (kFew) {
            lower_ = upper_ = points.row(0);
            for (Eigen::Index i = 1; i < points.rows(); ++i) {
                lower_ = lower_.cwiseMin(points.row(i));
                upper_ = upper_.cwiseMax(points.row(i));
            }
            coordinates_.reserve(2 * Dim * count);  // at most; what isn't touched takes no memory
            rows_.reserve(2 * count);
            nodes_.reserve(4 * count / kSize + 1);
            std::vector<Placed> placed(count);
            for (std::size_t i = 0; i < count; ++i)
                placed[i] = {points.row(static_cast<Eigen::Index>(i)), to_index(i)};
            halve(placed.data(), placed.data() + count, {lower_, upper_});
        } else {
            const std::size_t leaves = (count + kSize - 1) / kSize;
            coordinates_.resize(Dim * kSize * leaves);
            rows_.resize(kSize * leaves);
            nodes_.resize(2 * leaves - 1);
            split_all(points);
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

protected:
    using Row = Eigen::Matrix<double, 1, Dim, Eigen::RowMajor | Eigen::DontAlign>;

    static constexpr std::size_t kSize = TreePart::kSize;
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
    using Node = TreeNode;
    /// Its twos along one axis come first, then those along the next. With few axes, half a two
    /// may be left; with many, there is always room for kSize.
    struct Leaf {
        const double* coordinates;
        const Index* rows;
        std::size_t size;

        Two two(std::size_t axis, std::size_t k) const {
            Two both;
            std::memcpy(&both, coordinates + 2 * (axis * twos_of(size) + k), sizeof both);
            return both;
        }
    };
    static std::size_t twos_of(std::size_t size) { return kFew ? (size + 1) / 2 : kTwos; }

    Leaf leaf(const Node& node) const {
        const auto before = 2 * to_size(node.next);
        return {coordinates_.data() + Dim * before, rows_.data() + before, to_size(-node.axis)};
    }

    static Box box_of(const Placed* begin, const Placed* end) {
        Box box{begin->at, begin->at};
        for (const Placed* point = begin + 1; point < end; ++point)
            for (Eigen::Index d = 0; d < Dim; ++d) {
                box.lower[d] = std::min(box.lower[d], point->at[d]);
                box.upper[d] = std::max(box.upper[d], point->at[d]);
            }
        return box;
    }

    /// `box` is that of the points.
    void halve(Placed* begin, Placed* end, const Box& box) {
        const auto size = end - begin;
        if (to_size(size) <= kSize) {
            const std::size_t before = rows_.size(), room = 2 * twos_of(to_size(size));
            rows_.resize(before + room);
            coordinates_.resize(Dim * rows_.size());
            nodes_.push_back({to_index(-size), to_index(before / 2), 0.0, 0.0});
            fill(
                nodes_.back(), [&](std::size_t k) { return begin[k].row; },
                [&](std::size_t k, Eigen::Index axis) { return begin[k].at[axis]; });
            return;
        }
        Eigen::Index axis;
        (box.upper - box.lower).maxCoeff(&axis);
        const double middle = 0.5 * box.lower[axis] + 0.5 * box.upper[axis];
        Placed* cut = put_below_first(begin, end,
                                      [&](const Placed& point) { return point.at[axis] < middle; });
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

    static Box box_of(const Points& points, const Index* begin, const Index* end) {
        Box box{points.row(*begin), points.row(*begin)};
        for (const Index* i = begin + 1; i < end; ++i) {
            box.lower = box.lower.cwiseMin(points.row(*i));
            box.upper = box.upper.cwiseMax(points.row(*i));
        }
        return box;
    }

    static Eigen::Index widest_axis(const Box& box) {
        Eigen::Index axis;
        (box.upper - box.lower).maxCoeff(&axis);
        return axis;
    }

    /// All rows, on all threads where there are many: theirs is the box of all points.
    void split_all(const Points& points) {
        std::vector<Index> rows(to_size(points.rows()));
        std::array<Box, TreeParts::kCount> boxes;
        const std::size_t pieces = TreeParts::in_pieces(
            rows.size(), [&](std::size_t piece, std::size_t begin, std::size_t end) {
                for (std::size_t i = begin; i < end; ++i) rows[i] = to_index(i);
                boxes[piece] = box_of(points, rows.data() + begin, rows.data() + end);
            });
        Box& all = boxes.front();
        for (std::size_t k = 1; k < pieces; ++k) {
            all.lower = all.lower.cwiseMin(boxes[k].lower);
            all.upper = all.upper.cwiseMax(boxes[k].upper);
        }
        lower_ = all.lower, upper_ = all.upper;
        const TreePart whole{rows.data(), rows.data() + rows.size(), 0, 0};
        if (rows.size() <= kSize) {
            fill_leaf(points, whole);
            return;
        }
        const Eigen::Index axis = widest_axis(all);
        TreeKeys keys(rows.size());
        TreeParts::in_pieces(rows.size(), [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) keys[i] = {points(rows[i], axis), rows[i]};
        });
        const auto [first, second] = pointmorph::cut_in_two(whole, to_index(axis), keys, nodes_);
        keys = TreeKeys();
        TreeParts::split(
            {first, second},
            [&](const TreePart& part) {
                TreeKeys own;
                return cut_in_two(points, part, own);
            },
            [&](const TreePart& part) {
                TreeKeys own;
                split(points, part, own);
            });
    }

    void split(const Points& points, const TreePart& part, TreeKeys& keys) {
        if (part.size() <= kSize) {
            fill_leaf(points, part);
            return;
        }
        const auto [first, second] = cut_in_two(points, part, keys);
        split(points, first, keys);
        split(points, second, keys);
    }

    /// Of a part with more points than a leaf has; `keys` is scratch memory.
    std::pair<TreePart, TreePart> cut_in_two(const Points& points, const TreePart& part,
                                             TreeKeys& keys) {
        const Eigen::Index axis = widest_axis(box_of(points, part.begin, part.end));
        keys.clear();
        for (const Index* i = part.begin; i < part.end; ++i) keys.push_back({points(*i, axis), *i});
        return pointmorph::cut_in_two(part, to_index(axis), keys, nodes_);
    }

    void fill_leaf(const Points& points, const TreePart& part) {
        nodes_[part.node] = {-to_index(part.size()), to_index(part.leaf * kTwos), 0.0, 0.0};
        fill(
            nodes_[part.node], [&](std::size_t k) { return part.begin[k]; },
            [&](std::size_t k, Eigen::Index axis) { return points(part.begin[k], axis); });
    }

    /// Writes the leaf's points; the last one fills what room is left.
    template <class RowOf, class CoordinateOf>
    void fill(const Node& node, const RowOf& row_of, const CoordinateOf& coordinate_of) {
        const auto size = to_size(-node.axis), before = 2 * to_size(node.next);
        const std::size_t room = 2 * twos_of(size);
        for (std::size_t k = 0; k < room; ++k) {
            const std::size_t from = std::min(k, size - 1);
            rows_[before + k] = row_of(from);
            for (std::size_t d = 0; d < Dim; ++d)
                coordinates_[Dim * before + d * room + k] =
                    coordinate_of(from, static_cast<Eigen::Index>(d));
        }
    }

    /// `squared` and `outside`: how far the node's box is from the query, at least. False ends it.
    template <class Result>
    bool search(std::size_t at, const double* query, double squared,
                std::array<double, Dim>& outside, Result& result) const {
        const Node& node = nodes_[at];
        if (node.axis < 0) return look_at(leaf(node), query, result);
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
    static bool look_at(const Leaf& leaf, const double* query, Result& result) {
        if constexpr (kFew)
            return look_at_all(leaf, query, result);
        else if (has_wide_registers())
            return look_at_sixteen(leaf, query, result);
        else
            return look_by_eights(leaf, query, result);
    }

    /// Adds what is near enough. False ends the search.
    template <class Result>
    static bool add_near(const double* squared, const Index* rows, std::size_t count,
                         Result& result) {
        if constexpr (requires { result.add_all(squared, rows, count); }) {
            return result.add_all(squared, rows, count);
        } else {
            double worst = result.worstDist();
            for (std::size_t k = 0; k < count; ++k)
                if (squared[k] < worst) {
                    if (!result.addPoint(squared[k], rows[k])) return false;
                    worst = result.worstDist();
                }
            return true;
        }
    }

    template <class Result>
    static bool look_at_all(const Leaf& leaf, const double* query, Result& result) {
        alignas(16) std::array<double, kSize> squared;
        for (std::size_t k = 0; 2 * k < leaf.size; ++k) {
            Two sum{};
            for (std::size_t axis = 0; axis < Dim; ++axis) {
                const Two q = {query[axis], query[axis]};
                const Two to = q - leaf.two(axis, k);
                sum += to * to;
            }
            squared[2 * k] = sum[0];
            squared[2 * k + 1] = sum[1];
        }
        return add_near(squared.data(), leaf.rows, leaf.size, result);
    }

    template <class Result>
    static bool look_at_sixteen(const Leaf& leaf, const double* query, Result& result) {
        static_assert(kSize == 16);
        std::array<double, kSize> squared;
        const SixteenPoints points{leaf.coordinates, query, result.worstDist()};
        std::uint32_t bits = has_widest_registers()
                                 ? squares_of_sixteen_widest<Dim>(points, squared.data())
                                 : squares_of_sixteen_wide<Dim>(points, squared.data());
        if constexpr (requires { result.add_all(squared.data(), leaf.rows, leaf.size); }) {
            return bits == 0 || result.add_all(squared.data(), leaf.rows, leaf.size);
        } else {
            bits &= (std::uint32_t{1} << leaf.size) - 1;
            for (; bits != 0; bits &= bits - 1) {
                const auto k = static_cast<std::size_t>(std::countr_zero(bits));
                if (squared[k] < result.worstDist() && !result.addPoint(squared[k], leaf.rows[k]))
                    return false;
            }
            return true;
        }
    }

    template <class Result>
    static bool look_by_eights(const Leaf& leaf, const double* query, Result& result) {
        alignas(16) std::array<double, 8> squared;
        for (std::size_t first = 0; first < kTwos; first += 4) {  // four stay in registers
            const std::size_t points =
                std::min<std::size_t>(8, leaf.size - std::min(leaf.size, 2 * first));
            if (points == 0) break;
            Two a{}, b{}, c{}, d{};
            const auto add = [&](std::size_t begin, std::size_t end) {
                for (std::size_t axis = begin; axis < end; ++axis) {
                    const Two q = {query[axis], query[axis]};
                    const Two to_a = q - leaf.two(axis, first),
                              to_b = q - leaf.two(axis, first + 1),
                              to_c = q - leaf.two(axis, first + 2),
                              to_d = q - leaf.two(axis, first + 3);
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
            if (!add_near(squared.data(), leaf.rows + 2 * first, points, result)) return false;
        }
        return true;
    }

    Row lower_, upper_;
    std::vector<Node> nodes_;
    UnsetVector<double> coordinates_;  ///< of all leaves
    std::vector<Index> rows_;
};

}  // namespace pointmorph

// A kd-tree of points that move. Not a part of the library. Defined in kd_tree.cpp.
#pragma once

#include <array>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "cloud/bucket_tree.hpp"
#include "cloud/nearest_result.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Finds the nearest of points that have moved since it was built. What was near mostly still is,
/// so that only the boxes around them are measured anew, and the tree is built again once these
/// have become large. Answers are those of a KdTree.
class MovingTree {
public:
    /// The first `lasting` rows, one or more, are the same points at all times; what follows is new
    /// each time.
    explicit MovingTree(Index lasting) : lasting_(lasting) {}

    /// Before any question is asked. Keeps no reference. Throws Cancelled.
    void move(const Positions& positions, Progress& progress);

    Index size() const { return size_; }

    static constexpr std::size_t kMost = 10;
    /// As KdTree::nearest(), kMost at the most.
    Index nearest(const double* query, std::span<Index> rows,
                  std::span<double> squared_distances) const;

    /// The nearest row closer than `radius` for which `counts(row)` is true, of several the lowest;
    /// −1 where there is none. `ball` is scratch memory.
    template <class Counts>
    Index nearest_of(const double* query, double radius, Counts&& counts,
                     std::vector<std::pair<Index, double>>& ball) const {
        find_within(query, radius, ball);
        Index nearest = -1;
        double least = std::numeric_limits<double>::infinity();
        for (const auto& [row, squared] : ball)
            if ((squared < least || (squared == least && row < nearest)) && counts(row)) {
                nearest = row;
                least = squared;
            }
        return nearest;
    }

private:
    /// Nodes as they were when it was built, with the boxes around what is below them now.
    class Boxes : public BucketTree<3> {
    public:
        explicit Boxes(const Positions& positions)
            : BucketTree(positions), children_(nodes_.size()) {}

        void move(const Positions& positions, Progress& progress);
        /// Of the leaves' boxes, the squared diagonals' sum.
        double width() const { return width_; }

        template <class Result>
        void find(Result& result, const double* query) const {
            search(0, query, result);
        }

    private:
        /// Of two boxes side by side.
        struct TwoBoxes {
            std::array<Two, 3> lower, upper;  ///< by axis

            Two squared_distances(const double* query) const {
                Two sum{};
                for (std::size_t d = 0; d < 3; ++d) {
                    const Two q = {query[d], query[d]};
                    const Two off = larger(larger(lower[d] - q, q - upper[d]), Two{});
                    sum += off * off;
                }
                return sum;
            }
        };

        /// False ends it.
        template <class Result>
        bool search(std::size_t at, const double* query, Result& result) const {
            const TreeNode& node = nodes_[at];
            if (node.axis < 0) return look_at(leaf(node), query, result);
            const Two squared = children_[at].squared_distances(query);
            const bool turns = squared[1] < squared[0];
            const std::size_t first = at + 1, second = to_size(node.next);
            if (squared[turns ? 1 : 0] > result.worstDist()) return true;
            if (!search(turns ? second : first, query, result)) return false;
            return squared[turns ? 0 : 1] > result.worstDist() ||
                   search(turns ? first : second, query, result);
        }

        std::vector<TwoBoxes> children_;  ///< boxes of a node's, by node
        double width_ = 0.0;
    };

    /// Points whose rows begin there.
    template <class Result>
    struct Later {
        Result& result;
        Index first;

        bool add_all(const double* squared, const Index* rows, std::size_t count) {
            std::array<Index, TreePart::kSize> shifted;
            for (std::size_t k = 0; k < count; ++k) shifted[k] = first + rows[k];
            return result.add_all(squared, shifted.data(), count);
        }
        double worstDist() const { return result.worstDist(); }
    };

    void find_within(const double* query, double radius,
                     std::vector<std::pair<Index, double>>& ball) const;

    template <class Result>
    void find(Result& result, const double* query) const {
        tree_->find(result, query);
        if (!others_) return;
        Later<Result> later{result, lasting_};
        others_->find(later, query);
    }

    /// What a NearestResult keeps of the points of leaves.
    struct AnyNearest {
        NearestResult nearest;

        bool add_all(const double* squared, const Index* rows, std::size_t count) {
            for (std::size_t k = 0; k < count; ++k) nearest.addPoint(squared[k], rows[k]);
            return true;
        }
        double worstDist() const { return nearest.worstDist(); }
    };

    Index lasting_, size_ = 0;
    std::optional<Boxes> tree_;
    std::optional<BucketTree<3>> others_;
    double width_ = 0.0;  ///< when the tree was built
};

}  // namespace pointmorph

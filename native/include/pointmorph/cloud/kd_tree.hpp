// Nearest neighbors in 2 (disk), 3 (space) and more (product space) dimensions.
#pragma once

#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// A kd-tree over the rows of an array. Keeps a reference to the array, which must outlive it; with
/// more than two dimensions, the array may go as long as points() isn't asked for.
/// Queries are const and may run in parallel. Distances are *squared* wherever the name says so.
/// Among points at the same distance the one with the lower row comes first; but where more points
/// coincide with the query than are asked for, they may be any of these.
template <int Dim>
class KdTree {
public:
    using Points = Eigen::Matrix<double, Eigen::Dynamic, Dim, Eigen::RowMajor>;

    explicit KdTree(const Points& points);
    explicit KdTree(Points&&) = delete;
    /// The tree of the same points at another place in memory, which needn't be built again.
    KdTree(const KdTree& other, const Points& same_points) requires(Dim != 2);
    ~KdTree();
    KdTree(KdTree&&) noexcept;
    KdTree& operator=(KdTree&&) noexcept;

    const Points& points() const noexcept { return *points_; }
    Index size() const noexcept { return size_; }

    /// The min(`indices.size()`, size()) points nearest to `query` (Dim numbers), ascending by
    /// distance. Returns how many were written. Both spans have the same length.
    Index nearest(const double* query, std::span<Index> indices,
                  std::span<double> squared_distances) const;

    /// The same among the points with distance < `radius` (plain, not squared).
    Index nearest_within(const double* query, double radius, std::span<Index> indices,
                         std::span<double> squared_distances) const;

    /// All points with distance < `radius` (plain, not squared) from `query`, ascending by
    /// distance, as (row, squared distance). `result` is cleared first.
    void within(const double* query, double radius,
                std::vector<std::pair<Index, double>>& result) const;

    /// The same in no particular order, which takes less time.
    void within_unsorted(const double* query, double radius,
                         std::vector<std::pair<Index, double>>& result) const;

    /// Whether any point has distance < `radius` (plain, not squared) from `query`.
    bool any_within(const double* query, double radius) const;

private:
    struct Impl;
    const Points* points_;
    Index size_;
    std::shared_ptr<const Impl> impl_;
};

/// The row of the tree's point nearest to each of the places; the tree isn't empty.
std::vector<Index> nearest_rows(const KdTree<3>& tree, const Positions& places);

/// The nearest point whose normal agrees with `normal`, so that both sides of a thin part are told
/// apart; the nearest of all where none of the nearest `most` (12 or fewer) does. `normals` has one
/// row a point of the tree.
Index nearest_on_sheet(const KdTree<3>& tree, const Positions& normals,
                       const Eigen::RowVector3d& place, const Eigen::RowVector3d& normal,
                       std::size_t most = 12);

extern template class KdTree<2>;
extern template class KdTree<3>;
extern template class KdTree<6>;
extern template class KdTree<12>;
extern template class KdTree<32>;

}  // namespace pointmorph

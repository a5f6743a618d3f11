// Stage `neighborhoods`: which points are near which, as flat offsets and indices.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

/// The neighbors of point i are `indices[offsets[i]] … indices[offsets[i + 1] − 1]`; a point is
/// not its own neighbor.
struct Neighborhoods {
    std::vector<std::int64_t> offsets{0};  ///< #points + 1
    std::vector<Index> indices;            ///< 0-based rows

    Index size() const { return to_index(offsets.size()) - 1; }

    std::span<const Index> operator[](Index i) const {
        const auto row = to_size(i);
        return {indices.data() + offsets[row], indices.data() + offsets[row + 1]};
    }
};

/// The k nearest other points of every point, ascending by distance; all others where the cloud
/// has no more than k + 1. A coincident point counts as a neighbor.
Neighborhoods nearest_neighbors(const KdTree<3>& tree, Index k, Progress& progress);

/// A cloud's spatial_order(), and in this order the nearest points of every point.
struct OrderedNeighbors {
    std::vector<Index> order;  ///< rows of the cloud
    Neighborhoods nearest;     ///< numbers in the order; ascending by distance
};
OrderedNeighbors ordered_neighbors(const Positions& positions, Index k, Progress& progress);

/// The paper's N_i = {j : 0 < ‖x_j − x_i‖ < r} for every point, ascending by distance: points at
/// the very same place are no neighbors. `radius` > 0 is a plain distance.
Neighborhoods radius_neighbors(const KdTree<3>& tree, double radius, Progress& progress);

/// j is a neighbor of i where either was one of the other; ascending by row.
Neighborhoods symmetrized(const Neighborhoods& neighborhoods);

/// The neighborhoods without the pairs (i, j) for which `keep(i, j)` is false; the order stays.
template <class Keep>
Neighborhoods filtered(const Neighborhoods& neighborhoods, Keep&& keep) {
    Neighborhoods result;
    result.offsets.reserve(neighborhoods.offsets.size());
    result.indices.reserve(neighborhoods.indices.size());
    for (Index i = 0; i < neighborhoods.size(); ++i) {
        for (const Index j : neighborhoods[i])
            if (keep(i, j)) result.indices.push_back(j);
        result.offsets.push_back(static_cast<std::int64_t>(result.indices.size()));
    }
    return result;
}

/// Components of the graph in which i and j are joined where either is a neighbor of the other.
struct ConnectedComponents {
    std::vector<Index> label;  ///< #points; components are numbered by their lowest row
    std::vector<Index> sizes;  ///< points in each

    Index count() const { return to_index(sizes.size()); }
};
ConnectedComponents connected_components(const Neighborhoods& neighborhoods);

/// The same for edges that are found one by one: there is no need to look at one whose ends are
/// joined already.
class GrowingComponents {
public:
    explicit GrowingComponents(Index count);

    bool are_joined(Index i, Index j) { return parent_[to_size(i)] == j || root(i) == root(j); }
    void join(Index i, Index j) {
        const Index a = root(i), b = root(j);
        parent_[to_size(a < b ? b : a)] = a < b ? a : b;
    }
    /// The lowest row of the component that a row is in so far.
    Index root(Index i) {
        while (parent_[to_size(i)] != i)
            i = parent_[to_size(i)] = parent_[to_size(parent_[to_size(i)])];
        return i;
    }
    ConnectedComponents components();

private:
    std::vector<Index> parent_;  ///< no row above the point's own
};

/// Spacing of the samples around every point, 1/√density, from the distance r to its k-th nearest
/// other point: r·√(π/k). `nearest` is ascending by distance; fewer than k neighbors are used as
/// they are; 0 where there are none.
Values local_spacing(const Positions& positions, const Neighborhoods& nearest, Index k = 6);

}  // namespace pointmorph

// Stage `product_space`: the common domain of two clouds that are deformed onto each other. A
// source point lies at (where I go, where I am), a target point at (where I am, where I go), each
// with the normals there: close are only points whose maps agree both ways, on the same side of
// the surface (after reversible harmonic maps, Ezuz et al. 2019).
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/surface/pairing.hpp"

namespace pointmorph {

/// #points by 12: place on the target, place on the source, weight · normal on the target,
/// weight · normal on the source.
using ProductPoints = KdTree<12>::Points;

/// Rows of further coordinates.
using DynamicRows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Of points that lie at `on_target` and `on_source`.
ProductPoints product_points(const OrientedView& on_target, const OrientedView& on_source,
                             double normal_weight);

/// #points by 32: product points, then what else must be alike: labels, areas; 0 where there is
/// less.
using LabeledPoints = KdTree<32>::Points;

/// `labels` and `areas` have a row a point, or none; 20 columns at most in all.
LabeledPoints labeled_points(const ProductPoints& points,
                             const Eigen::Ref<const DynamicRows>& labels,
                             const Eigen::Ref<const DynamicRows>& areas = DynamicRows());

/// The nearest row of another array to each row, and the plain distance. `guess`, matches of as
/// many points, makes the search shorter where it is good; the result is the same. For Dim 12 and
/// 32.
struct Matches {
    std::vector<Index> to;
    std::vector<double> distances;
};
template <int Dim>
Matches nearest_matches(const typename KdTree<Dim>::Points& points, const KdTree<Dim>& others,
                        Progress& progress, const Matches* guess = nullptr);

/// The nearest point both ways: every row of both is in a pair. Features are paired apart, so that
/// their rows are in no other pair. Sorted, none twice. Where all points of a side are features,
/// the other side's rest goes to the nearest of them. For Dim 12 and 32.
template <int Dim>
Pairing mutual_pairs(const typename KdTree<Dim>::Points& source,
                     const typename KdTree<Dim>::Points& target,
                     std::span<const IndexPair> features, Progress& progress);

}  // namespace pointmorph

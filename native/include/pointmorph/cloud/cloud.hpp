// Stage `cloud`: what the user hands in, checked once, and the form in which the other stages
// compute on it.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// The faces of a mesh: polygons, whose corners are rows of a cloud, in order around each.
struct Polygons {
    std::vector<std::int64_t> offsets{0};  ///< #polygons + 1, into `corners`
    std::vector<Index> corners;

    Index size() const { return to_index(offsets.size()) - 1; }
    std::span<const Index> operator[](Index f) const {
        const auto i = to_size(f);
        return {corners.data() + offsets[i], corners.data() + offsets[i + 1]};
    }
};

/// A sampled shape: points that lie on some surface (paper, Introduction). An attribute that
/// isn't given has 0 rows, any other number of rows than that of `positions` is an error.
struct Cloud {
    std::string name = "cloud";  ///< as the user knows it; errors quote it
    Positions positions;         ///< #points by 3, any length unit
    Normals normals;             ///< #points by 3, outward, any length but zero
    Colors colors;               ///< #points by 4, red green blue alpha
    Values radii;                ///< #points, in the unit of the positions, not negative
    /// Where there are some, the shape is their surface, and the points are its vertices: no
    /// samples, which may lie as they like.
    Polygons faces{};

    Index size() const { return to_index(positions.rows()); }
};

/// Throws CloudError unless the cloud has at least `minimum_points` points (3, if that is more),
/// all numbers are finite, the attributes have one row a point, normals aren't zero, radii aren't
/// negative, faces follow one another, their corners are points of the cloud, and the points
/// neither coincide nor lie on one line. Extents from 1e-290 to 1e290 and normals of any length
/// from 1e-150 to 1e150 are fine, at any distance from the origin at which the points still differ.
void validate(const Cloud& cloud, Index minimum_points);

/// p ↦ (p − center) / scale takes a shape into the unit ball around the origin.
struct Normalization {
    Vector3 center;
    double scale;  ///< > 0

    Positions apply(const Positions& positions) const;
    Positions restore(const Positions& positions) const;
};

/// From the bounding box, so that the order of the points makes no difference at all.
Normalization normalization(const Positions& positions);

/// Rows in the order of a Morton curve through the bounding box; points of one cell by x, y, z.
/// Neighbors in space become neighbors in memory, and all that is computed in this order
/// doesn't depend on the order in which the points were given.
std::vector<Index> spatial_order(const Positions& positions);

/// Rows `order[0], order[1], …` of an array.
template <class Array>
Array gather(const Array& rows, std::span<const Index> order) {
    Array result(static_cast<Eigen::Index>(order.size()), rows.cols());
    for (std::size_t i = 0; i < order.size(); ++i)
        result.row(static_cast<Eigen::Index>(i)) = rows.row(order[i]);
    return result;
}
template <class T>
std::vector<T> gather(const std::vector<T>& rows, std::span<const Index> order) {
    std::vector<T> result;
    result.reserve(order.size());
    for (const Index i : order) result.push_back(rows[to_size(i)]);
    return result;
}

/// The permutation `rank` with `rank[order[i]] == i`.
std::vector<Index> inverse_order(std::span<const Index> order);

}  // namespace pointmorph

// A component as a whole: where it is, how large, and how it lies. Not for callers of the library.
#pragma once

#include <span>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

struct Whole {
    Eigen::RowVector3d middle = Eigen::RowVector3d::Zero();
    Matrix3 covariance = Matrix3::Zero();
    double size = 0.0;  ///< root mean square distance to the middle
};

/// Of one or more rows.
Whole whole_of(const Positions& positions, std::span<const Index> rows);

/// The points of several as one; `points` says how many each has.
Whole whole_of(std::span<const Whole> wholes, std::span<const Index> points);

/// How far two are apart in place, size and extents at once: between normal distributions (Dowson
/// and Landau 1982).
double distance_between(const Whole& a, const Whole& b);

/// A turn, then the stretch that takes `from`, turned, to the covariance of `to` by the shortest
/// ways: the optimal transport of one normal distribution to the other (Dowson and Landau 1982).
/// The turn alone where `from` is a point.
Matrix3 stretch_between(const Whole& from, const Whole& to, const Matrix3& turn);

/// The direction that has no like: the length of a rod, the normal of a plate.
Vector3 axis_of(const Whole& whole);

/// The same, with what lies aslant to a direction laid straight.
Whole straightened(Whole whole, const Vector3& axis);

}  // namespace pointmorph

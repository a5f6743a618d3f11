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

/// How far others are from one in place, size and extents at once: between normal distributions
/// (Dowson and Landau 1982).
class DistanceFrom {
public:
    explicit DistanceFrom(const Whole& one);

    /// `place` says how much of the distance between the middles counts.
    double operator()(const Whole& other, double place = 1.0) const;

    /// No larger than that, and told at once.
    double at_least(const Whole& other, double place = 1.0) const;

private:
    Whole one_;
    Matrix3 root_;
};

/// Several as one, as some of them come and go.
class JoinedWhole {
public:
    /// Numbers stay small where all are near `origin`.
    explicit JoinedWhole(const Eigen::RowVector3d& origin) : origin_(origin) {}

    void add(const Whole& whole, Index points) { change(whole, static_cast<double>(points)); }
    void take_out(const Whole& whole, Index points) { change(whole, -static_cast<double>(points)); }
    Whole all() const;

private:
    void change(const Whole& whole, double points);

    Eigen::RowVector3d origin_;
    double points_ = 0.0;
    Vector3 sum_ = Vector3::Zero();
    Matrix3 squares_ = Matrix3::Zero();
};

/// A turn, then the stretch that takes `from`, turned, to the covariance of `to` by the shortest
/// ways: the optimal transport of one normal distribution to the other (Dowson and Landau 1982).
/// The turn alone where `from` is a point.
Matrix3 stretch_between(const Whole& from, const Whole& to, const Matrix3& turn);

/// The direction that has no like: the length of a rod, the normal of a plate.
Vector3 axis_of(const Whole& whole);

/// The same, with what lies aslant to a direction laid straight.
Whole straightened(Whole whole, const Vector3& axis);

}  // namespace pointmorph

// Angles whose bits don't depend on the system's library, as those of std::atan2 do.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// The arctangents of 0, 1/8, … 1.
inline constexpr std::array<double, 9> kArctangents = {0.0,
                                                       0.12435499454676144,
                                                       0.24497866312686415,
                                                       0.35877067027057225,
                                                       0.46364760900080611,
                                                       0.55859931534356244,
                                                       0.64350110879328439,
                                                       0.71882999962162453,
                                                       std::numbers::pi / 4.0};

/// The factors of the series of the arctangent, but for their signs and the first; last one first.
inline constexpr std::array<double, 7> kSeries = {1.0 / 15.0, 1.0 / 13.0, 1.0 / 11.0, 1.0 / 9.0,
                                                  1.0 / 7.0,  1.0 / 5.0,  1.0 / 3.0};

/// Of a number between 0 and 1: that of the nearest eighth, and the series for what is left, which
/// is at most 1/16.
inline double arctangent(double tangent) {
    const double eighths = std::round(8.0 * tangent), nearest = eighths / 8.0;
    const double rest = (tangent - nearest) / (1.0 + tangent * nearest), square = rest * rest;
    double sum = 0.0;
    for (const double factor : kSeries) sum = square * (factor - sum);
    return kArctangents[static_cast<std::size_t>(eighths)] + (rest - rest * sum);
}

/// The angle, in radians from −π to π, from the x axis to a point; at the origin that of its signs,
/// as std::atan2 has it. Off by at most two units in the last place. NaN where a coordinate is
/// infinite or NaN, or both are too large to be added.
inline double angle_of(double y, double x) {
    const double along = std::abs(x), across = std::abs(y), larger = std::max(along, across);
    if (!std::isfinite(along + across)) return std::numeric_limits<double>::quiet_NaN();
    double angle = larger > 0.0 ? arctangent(std::min(along, across) / larger) : 0.0;
    if (across > along) angle = std::numbers::pi / 2.0 - angle;
    if (std::signbit(x)) angle = std::numbers::pi - angle;
    return std::copysign(angle, y);
}

/// The axis of a rotation, and its angle from 0 to π.
inline Eigen::AngleAxisd angle_axis(const Matrix3& rotation) {
    const Eigen::Quaterniond turn(rotation);
    const double sine = turn.vec().norm();
    if (!(sine > 0.0)) return Eigen::AngleAxisd(0.0, Vector3::UnitX());
    return Eigen::AngleAxisd(2.0 * angle_of(sine, std::abs(turn.w())),
                             turn.vec() / (turn.w() < 0.0 ? -sine : sine));
}

}  // namespace pointmorph

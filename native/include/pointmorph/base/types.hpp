// Array types that every stage shares.
#pragma once

#include <Eigen/Core>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <span>
#include <type_traits>
#include <vector>

namespace pointmorph {

/// A whole turn, in radians.
inline constexpr double kTurn = 2.0 * std::numbers::pi;

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Row of a cloud, 0-based. Clouds hold fewer than 2^31 points.
using Index = std::int32_t;

/// An index, or an enumerator that counts as one, as the standard library's containers take it.
template <class T>
requires std::integral<T> || std::is_enum_v<T>
constexpr std::size_t to_size(T i) {
    return static_cast<std::size_t>(i);
}

/// A number of rows or elements as an index: the caller knows that it fits.
template <class T>
requires std::integral<T> || std::is_enum_v<T>
constexpr Index to_index(T i) {
    return static_cast<Index>(i);
}

/// #points by 3, one point a row (x y z contiguous).
using Positions = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

/// #points by 3, unit length.
using Normals = Positions;

/// #points by 2, one point of the parameter domain a row.
using DiskPoints = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;

/// #points by 4, red green blue alpha, 0 to 1.
using Colors = Eigen::Matrix<float, Eigen::Dynamic, 4, Eigen::RowMajor>;

/// One value a point.
using Values = Eigen::VectorXd;

using Vector3 = Eigen::Vector3d;
using Matrix3 = Eigen::Matrix3d;

/// A row of the source together with a row of the target.
struct IndexPair {
    Index source;
    Index target;

    friend bool operator==(const IndexPair&, const IndexPair&) = default;
    friend auto operator<=>(const IndexPair&, const IndexPair&) = default;
};

}  // namespace pointmorph

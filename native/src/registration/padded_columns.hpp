// Matrices of three rows whose columns lie in a register each. Not for callers of the library.
#pragma once

#include <array>
#include <cstring>

#include "base/compiler.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Three numbers, and one that is 0.
using PaddedColumn = std::array<double, 4>;
using PaddedColumns = std::array<PaddedColumn, 3>;

inline PaddedColumn padded(const Vector3& v) {
    return {v[0], v[1], v[2], 0.0};
}

inline PaddedColumns padded(const Matrix3& matrix) {
    return {padded(Vector3(matrix.col(0))), padded(Vector3(matrix.col(1))),
            padded(Vector3(matrix.col(2)))};
}

inline PaddedColumns scaled(const Matrix3& matrix, double scale) {
    const double* const m = matrix.data();
    return {{{scale * m[0], scale * m[1], scale * m[2], 0.0},
             {scale * m[3], scale * m[4], scale * m[5], 0.0},
             {scale * m[6], scale * m[7], scale * m[8], 0.0}}};
}

/// As multiply().
inline PaddedColumn product(const PaddedColumns& matrix, const double* vector) {
    const auto& [x, y, z] = matrix;
    return {vector[0] * x[0] + vector[1] * y[0] + vector[2] * z[0],
            vector[0] * x[1] + vector[1] * y[1] + vector[2] * z[1],
            vector[0] * x[2] + (vector[1] * y[2] + vector[2] * z[2]), 0.0};
}

/// `Numbers` are four doubles.
template <class Numbers>
POINTMORPH_INLINE void load(const double* from, Numbers& numbers) {
    std::memcpy(&numbers, from, sizeof numbers);
}
template <class Numbers>
POINTMORPH_INLINE void load(const PaddedColumn& column, Numbers& numbers) {
    load(column.data(), numbers);
}

template <class Numbers>
POINTMORPH_INLINE void store(const Numbers& numbers, double* to) {
    std::memcpy(to, &numbers, sizeof numbers);
}
template <class Numbers>
POINTMORPH_INLINE void store(const Numbers& numbers, PaddedColumn& column) {
    store(numbers, column.data());
}

template <class Numbers>
POINTMORPH_INLINE void store_three(const Numbers& numbers, double* to) {
    for (int d = 0; d < 3; ++d) to[d] = numbers[d];
}

/// A matrix of columns x, y and z times a vector, added up as Eigen does it where it rounds each
/// product: the third row in another order.
template <class Numbers>
POINTMORPH_INLINE void multiply(const Numbers& x, const Numbers& y, const Numbers& z,
                                const double* vector, Numbers& product) {
    const Numbers second = vector[1] * y, third = vector[2] * z;
    product = vector[0] * x;
    Numbers of_others = second, of_third_row = product;
    of_others += third;
    of_third_row += of_others;
    product += second;
    product += third;
    take_upper_half(product, of_third_row);
}

}  // namespace pointmorph

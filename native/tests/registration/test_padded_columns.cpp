#include "registration/padded_columns.hpp"

#include <gtest/gtest.h>

#include "shapes.hpp"

namespace pointmorph {
namespace {

template <class Numbers>
POINTMORPH_INLINE Vector3 product_of(const Matrix3& matrix, const Vector3& vector) {
    const PaddedColumns columns = padded(matrix);
    Numbers x, y, z, product;
    load(columns[0], x);
    load(columns[1], y);
    load(columns[2], z);
    multiply(x, y, z, vector.data(), product);
    Vector3 result;
    store_three(product, result.data());
    return result;
}

POINTMORPH_WIDE Vector3 wide_product_of(const Matrix3& matrix, const Vector3& vector) {
    return product_of<Four>(matrix, vector);
}

Vector3 plain_product_of(const Matrix3& m, const Vector3& v) {
    return {m(0, 0) * v[0] + m(0, 1) * v[1] + m(0, 2) * v[2],
            m(1, 0) * v[0] + m(1, 1) * v[1] + m(1, 2) * v[2],
            m(2, 0) * v[0] + (m(2, 1) * v[1] + m(2, 2) * v[2])};
}

TEST(PaddedColumns, ProductsAreThoseOfEigenToTheBit) {
    const Positions numbers = shapes::cube_noise(4000, 1);
    for (Eigen::Index k = 0; k + 4 <= numbers.rows(); k += 4) {
        const Matrix3 matrix = numbers.middleRows<3>(k).array() - 0.5;
        const Vector3 vector = numbers.row(k + 3).transpose();
        const Vector3 expected = plain_product_of(matrix, vector), of_eigen = matrix * vector;
#ifdef __ARM_FEATURE_FMA  // Eigen doesn't round products there before it adds them
        EXPECT_LT((expected - of_eigen).cwiseAbs().maxCoeff(), 1e-15);
#else
        EXPECT_EQ(expected, of_eigen);
#endif
        EXPECT_EQ(product_of<TwoTwos>(matrix, vector), expected);
        EXPECT_EQ(product_of<PlainFour>(matrix, vector), expected);
        const PaddedColumn product = pointmorph::product(padded(matrix), vector.data());
        EXPECT_EQ(product, padded(expected));
        EXPECT_EQ(scaled(matrix, vector[0]), padded(Matrix3(vector[0] * matrix)));
        if (!has_wide_registers()) continue;
        EXPECT_EQ(wide_product_of(matrix, vector), expected);
    }
}

}  // namespace
}  // namespace pointmorph

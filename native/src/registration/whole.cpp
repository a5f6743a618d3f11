#include "registration/whole.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

namespace pointmorph {

namespace {

/// A power of a symmetric matrix whose eigenvalues are at least a tiny share of the largest.
Matrix3 power(const Matrix3& symmetric, double exponent) {
    constexpr double kFlattest = 1e-6;
    const Eigen::SelfAdjointEigenSolver<Matrix3> solver(symmetric);
    const double least =
        std::max(kFlattest * solver.eigenvalues()[2], std::numeric_limits<double>::min());
    const Vector3 powers = solver.eigenvalues().cwiseMax(least).array().pow(exponent);
    return solver.eigenvectors() * powers.asDiagonal() * solver.eigenvectors().transpose();
}

}  // namespace

Whole whole_of(const Positions& positions, std::span<const Index> rows) {
    Whole whole;
    for (const Index i : rows) whole.middle += positions.row(i);
    const auto count = static_cast<double>(rows.size());
    whole.middle /= count;
    for (const Index i : rows) {
        const Vector3 arm = (positions.row(i) - whole.middle).transpose();
        whole.covariance += arm * arm.transpose() / count;
    }
    whole.size = std::sqrt(whole.covariance.trace());
    return whole;
}

Matrix3 stretch_between(const Whole& from, const Whole& to, const Matrix3& turn) {
    if (!(from.size > 0.0)) return turn;
    const Matrix3 turned = turn * from.covariance * turn.transpose();
    const Matrix3 root = power(turned, 0.5), inverse = power(turned, -0.5);
    return inverse * power(root * to.covariance * root, 0.5) * inverse * turn;
}

}  // namespace pointmorph

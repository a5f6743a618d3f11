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

DistanceFrom::DistanceFrom(const Whole& one) : one_(one), root_(power(one.covariance, 0.5)) {}

double DistanceFrom::operator()(const Whole& other, double place) const {
    const Eigen::SelfAdjointEigenSolver<Matrix3> common(root_ * other.covariance * root_,
                                                        Eigen::EigenvaluesOnly);
    const double shared = common.eigenvalues().cwiseMax(0.0).cwiseSqrt().sum();
    const double squared = place * place * (one_.middle - other.middle).squaredNorm() +
                           one_.covariance.trace() + other.covariance.trace() - 2.0 * shared;
    return std::sqrt(std::max(0.0, squared));
}

double DistanceFrom::at_least(const Whole& other, double place) const {
    const double larger = one_.size - other.size;
    return std::sqrt(place * place * (one_.middle - other.middle).squaredNorm() + larger * larger);
}

void JoinedWhole::change(const Whole& whole, double points) {
    const Vector3 arm = (whole.middle - origin_).transpose();
    points_ += points;
    sum_ += points * arm;
    squares_ += points * (whole.covariance + arm * arm.transpose());
}

Whole JoinedWhole::all() const {
    const Vector3 arm = sum_ / points_;
    Whole all{origin_ + arm.transpose(), squares_ / points_ - arm * arm.transpose()};
    all.size = std::sqrt(std::max(0.0, all.covariance.trace()));
    return all;
}

Matrix3 stretch_between(const Whole& from, const Whole& to, const Matrix3& turn) {
    if (!(from.size > 0.0)) return turn;
    const Matrix3 turned = turn * from.covariance * turn.transpose();
    const Matrix3 root = power(turned, 0.5), inverse = power(turned, -0.5);
    return inverse * power(root * to.covariance * root, 0.5) * inverse * turn;
}

Vector3 axis_of(const Whole& whole) {
    const Eigen::SelfAdjointEigenSolver<Matrix3> solver(whole.covariance);
    const Vector3& squared = solver.eigenvalues();
    const bool is_rod = squared[2] * squared[0] > squared[1] * squared[1];
    return solver.eigenvectors().col(is_rod ? 2 : 0);
}

Whole straightened(Whole whole, const Vector3& axis) {
    const Matrix3 along = axis * axis.transpose(), across = Matrix3::Identity() - along;
    whole.covariance = along * whole.covariance * along + across * whole.covariance * across;
    return whole;
}

}  // namespace pointmorph

#include "pointmorph/cloud/similarity.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <optional>

namespace pointmorph {

namespace {

/// The unit eigenvector of the largest eigenvalue of `k`, which belongs to the covariance `c`, by
/// Newton's method on the characteristic polynomial (Horn 1987, section 4.C) and a column of the
/// adjugate. Nothing where the two largest eigenvalues lie too close for that.
std::optional<Eigen::Vector4d> clear_eigenvector(const Eigen::Matrix4d& k, const Matrix3& c,
                                                 double& eigenvalue) {
    const double square = c.squaredNorm(), size = std::sqrt(square);
    if (!(square > 1e-280 && square < 1e280)) return std::nullopt;
    // λ⁴ − 2 |C|² λ² − 8 det(C) λ + det(K), in units of |C|; from above, where it is convex.
    const Eigen::Matrix4d unit = k / size;
    const double linear = -8.0 * (c / size).determinant(), constant = unit.determinant();
    double x = std::sqrt(3.0);
    constexpr int kMostSteps = 12;
    for (int step = 0; step < kMostSteps; ++step) {
        const double slope = (4.0 * x * x - 4.0) * x + linear;
        if (!(slope > 1e-3)) return std::nullopt;  // a double root is near
        const double down = (((x * x - 2.0) * x + linear) * x + constant) / slope;
        x -= down;
        if (std::abs(down) < 1e-13) break;
    }
    const Eigen::Matrix4d m = unit - x * Eigen::Matrix4d::Identity();
    // Rows of the adjugate from the 2 × 2 minors of the upper and of the lower two rows.
    const auto minor2 = [&m](int row, int i, int j) {
        return m(row, i) * m(row + 1, j) - m(row, j) * m(row + 1, i);
    };
    const double s0 = minor2(0, 0, 1), s1 = minor2(0, 0, 2), s2 = minor2(0, 0, 3),
                 s3 = minor2(0, 1, 2), s4 = minor2(0, 1, 3), s5 = minor2(0, 2, 3);
    const double c0 = minor2(2, 0, 1), c1 = minor2(2, 0, 2), c2 = minor2(2, 0, 3),
                 c3 = minor2(2, 1, 2), c4 = minor2(2, 1, 3), c5 = minor2(2, 2, 3);
    Eigen::Matrix4d adjugate;
    adjugate << m(1, 1) * c5 - m(1, 2) * c4 + m(1, 3) * c3,
        -m(0, 1) * c5 + m(0, 2) * c4 - m(0, 3) * c3, m(3, 1) * s5 - m(3, 2) * s4 + m(3, 3) * s3,
        -m(2, 1) * s5 + m(2, 2) * s4 - m(2, 3) * s3,  //
        -m(1, 0) * c5 + m(1, 2) * c2 - m(1, 3) * c1, m(0, 0) * c5 - m(0, 2) * c2 + m(0, 3) * c1,
        -m(3, 0) * s5 + m(3, 2) * s2 - m(3, 3) * s1, m(2, 0) * s5 - m(2, 2) * s2 + m(2, 3) * s1,  //
        m(1, 0) * c4 - m(1, 1) * c2 + m(1, 3) * c0, -m(0, 0) * c4 + m(0, 1) * c2 - m(0, 3) * c0,
        m(3, 0) * s4 - m(3, 1) * s2 + m(3, 3) * s0, -m(2, 0) * s4 + m(2, 1) * s2 - m(2, 3) * s0,  //
        -m(1, 0) * c3 + m(1, 1) * c1 - m(1, 2) * c0, m(0, 0) * c3 - m(0, 1) * c1 + m(0, 2) * c0,
        -m(3, 0) * s3 + m(3, 1) * s1 - m(3, 2) * s0, m(2, 0) * s3 - m(2, 1) * s1 + m(2, 2) * s0;
    int column;
    adjugate.diagonal().cwiseAbs().maxCoeff(&column);
    Eigen::Vector4d q = adjugate.col(column);
    q.normalize();
    constexpr double kResidual = 1e-12;
    if (!((m * q).squaredNorm() < kResidual * kResidual)) return std::nullopt;
    eigenvalue = x * size;
    return q;
}

}  // namespace

BestRotation best_rotation(const Matrix3& covariance) {
    // tr(R(q)ᵀ C) = qᵀ K q for a unit quaternion q = (w, x, y, z).
    const Matrix3& c = covariance;
    Eigen::Matrix4d k;
    k << c(0, 0) + c(1, 1) + c(2, 2), c(2, 1) - c(1, 2), c(0, 2) - c(2, 0), c(1, 0) - c(0, 1),  //
        0, c(0, 0) - c(1, 1) - c(2, 2), c(0, 1) + c(1, 0), c(0, 2) + c(2, 0),                   //
        0, 0, c(1, 1) - c(0, 0) - c(2, 2), c(1, 2) + c(2, 1),                                   //
        0, 0, 0, c(2, 2) - c(0, 0) - c(1, 1);
    k.triangularView<Eigen::StrictlyLower>() = k.transpose();
    const auto rotation = [](const Eigen::Vector4d& q) {
        return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
    };
    double trace;
    if (const auto q = clear_eigenvector(k, c, trace)) return {rotation(*q), trace};
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> solver(k);
    return {rotation(solver.eigenvectors().col(3)), solver.eigenvalues()[3]};
}

Positions Similarity::apply(const Positions& positions) const {
    return (positions * (scale * rotation).transpose()).rowwise() + translation.transpose();
}

Normals Similarity::rotated(const Normals& normals) const {
    return normals * rotation.transpose();
}

Similarity Similarity::inverse() const {
    return {1.0 / scale, rotation.transpose(), -(rotation.transpose() * translation) / scale};
}

Similarity fit_similarity(const Positions& from, const Positions& to) {
    Similarity result;
    if (from.rows() == 0) return result;
    const Eigen::RowVector3d from_mean = from.colwise().mean(), to_mean = to.colwise().mean();
    const Positions x = from.rowwise() - from_mean, y = to.rowwise() - to_mean;
    const double from_size = x.squaredNorm(), to_size = y.squaredNorm();
    if (from_size > 0.0 && to_size > 0.0) {
        // A trace of the identity: among rotations that do equally well, the least.
        const double size = std::sqrt(from_size * to_size);
        const Matrix3 covariance = y.transpose() * x;
        const auto best = best_rotation(covariance + 1e-12 * size * Matrix3::Identity());
        const double trace = (best.rotation.transpose() * covariance).trace();
        result.rotation = best.rotation;
        if (trace > 0.0) result.scale = trace / from_size;
    }
    result.translation =
        to_mean.transpose() - result.scale * result.rotation * from_mean.transpose();
    return result;
}

Similarity composed(const Similarity& after, const Similarity& before) {
    return {after.scale * before.scale, after.rotation * before.rotation,
            after.scale * (after.rotation * before.translation) + after.translation};
}

bool fits_better_mirrored(const Positions& from, const Positions& to) {
    const auto misfit = [&](const Positions& p) {
        return (fit_similarity(p, to).apply(p) - to).squaredNorm();
    };
    Positions mirrored = from;
    mirrored.col(0) *= -1.0;
    constexpr double kMuchBetter = 0.25;  // squared
    return misfit(mirrored) < kMuchBetter * misfit(from);
}

}  // namespace pointmorph

#include "pointmorph/similarity.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>

namespace pointmorph {

BestRotation best_rotation(const Matrix3& covariance) {
    // tr(R(q)ᵀ C) = qᵀ K q for a unit quaternion q = (w, x, y, z).
    const Matrix3& c = covariance;
    Eigen::Matrix4d k;
    k << c(0, 0) + c(1, 1) + c(2, 2), c(2, 1) - c(1, 2), c(0, 2) - c(2, 0), c(1, 0) - c(0, 1),  //
        0, c(0, 0) - c(1, 1) - c(2, 2), c(0, 1) + c(1, 0), c(0, 2) + c(2, 0),                   //
        0, 0, c(1, 1) - c(0, 0) - c(2, 2), c(1, 2) + c(2, 1),                                   //
        0, 0, 0, c(2, 2) - c(0, 0) - c(1, 1);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> solver(k.transpose());
    const Eigen::Vector4d q = solver.eigenvectors().col(3);
    return {Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix(),
            solver.eigenvalues()[3]};
}

Positions Similarity::apply(const Positions& positions) const {
    return (positions * (scale * rotation).transpose()).rowwise() + shift.transpose();
}

Normals Similarity::turn(const Normals& normals) const {
    return normals * rotation.transpose();
}

Similarity Similarity::inverse() const {
    return {1.0 / scale, rotation.transpose(), -(rotation.transpose() * shift) / scale};
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
    result.shift = to_mean.transpose() - result.scale * result.rotation * from_mean.transpose();
    return result;
}

}  // namespace pointmorph

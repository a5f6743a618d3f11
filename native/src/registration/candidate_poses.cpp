#include "pointmorph/registration/candidate_poses.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "pointmorph/registration/thin_plate.hpp"

namespace pointmorph {

namespace {

struct PrincipalFrame {
    Vector3 center;
    Vector3 spreads;  ///< root mean square along the axes, ascending
    Matrix3 axes;     ///< columns
};

PrincipalFrame principal_frame(const CoarseShape& shape) {
    const Values weights = shape.areas / shape.areas.sum();
    PrincipalFrame frame;
    frame.center = shape.positions.transpose() * weights;
    const Positions centered = shape.positions.rowwise() - frame.center.transpose();
    const Matrix3 covariance = centered.transpose() * weights.asDiagonal() * centered;
    const Eigen::SelfAdjointEigenSolver<Matrix3> solver(covariance);
    frame.axes = solver.eigenvectors();
    frame.spreads = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt();
    return frame;
}

Similarity rotation_about(const Matrix3& rotation, const Vector3& from, const Vector3& to) {
    return {1.0, rotation, to - rotation * from};
}

/// Root mean square distance of the features under a pose.
double feature_distance(const MarkedPlaces& places, const Similarity& pose) {
    double sum = 0.0;
    for (Eigen::Index k = 0; k < places.source.rows(); ++k)
        sum += (places.source.row(k).transpose() -
                pose.rotation * places.target.row(k).transpose() - pose.translation)
                   .squaredNorm();
    return places.source.rows() == 0 ? 0.0
                                     : std::sqrt(sum / static_cast<double>(places.source.rows()));
}

}  // namespace

std::vector<Similarity> candidate_poses(const CoarsePair& shapes, const PoseOptions& options) {
    const PrincipalFrame s = principal_frame(shapes.source), t = principal_frame(shapes.target);
    std::vector<Similarity> poses;
    std::array<int, 3> order{0, 1, 2};
    do {
        bool alike = true;
        for (int k = 0; k < 3; ++k) {
            const double a = s.spreads[k] + 1e-9, b = t.spreads[order[to_size(k)]] + 1e-9;
            alike = alike && std::max(a / b, b / a) <= options.spread_ratio;
        }
        if (!alike && !std::ranges::is_sorted(order)) continue;  // like to like is always tried
        for (int signs = 0; signs < 8; ++signs) {
            Matrix3 axes;
            for (int k = 0; k < 3; ++k)
                axes.col(k) = (signs >> k & 1 ? -1.0 : 1.0) * t.axes.col(order[to_size(k)]);
            const Matrix3 rotation = s.axes * axes.transpose();
            if (rotation.determinant() > 0.0)
                poses.push_back(rotation_about(rotation, t.center, s.center));
        }
    } while (std::ranges::next_permutation(order).found);

    const MarkedPlaces places = marked_places(shapes);
    const Positions &to = places.source, &from = places.target;
    if (to.rows() >= 2) {
        const auto by_features = [&](const Similarity& before) {
            const Matrix3 rotation = fit_similarity(before.apply(from), to).rotation;
            const Vector3 mean = before.apply(from).colwise().mean().transpose();
            return composed(rotation_about(rotation, mean, to.colwise().mean().transpose()),
                            before);
        };
        // Two features leave the roll open: each pose gets the least rotation that brings them
        // together. Three or more leave nothing open.
        if (to.rows() == 2) {
            const std::size_t count = poses.size();
            for (std::size_t k = 0; k < count; ++k) poses.push_back(by_features(poses[k]));
        } else {
            poses.push_back(by_features({}));
        }
    }
    poses.push_back(rotation_about(Matrix3::Identity(), t.center, s.center));
    double least = std::numeric_limits<double>::infinity();
    for (const Similarity& pose : poses) least = std::min(least, feature_distance(places, pose));
    std::erase_if(poses, [&](const Similarity& pose) {
        return feature_distance(places, pose) > least + options.feature_distance;
    });
    return poses;
}

std::vector<Similarity> tilts(const CoarseShape& shape, double angle) {
    const PrincipalFrame frame = principal_frame(shape);
    std::vector<Similarity> result;
    for (int axis = 0; axis < 3; ++axis)
        for (const double signed_angle : {-angle, angle})
            result.push_back(rotation_about(
                Eigen::AngleAxisd(signed_angle, frame.axes.col(axis)).toRotationMatrix(),
                frame.center, frame.center));
    return result;
}

}  // namespace pointmorph

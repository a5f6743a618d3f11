#include "pointmorph/registration/candidate_poses.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
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

Similarity turn_about(const PrincipalFrame& frame, int axis, double angle) {
    return rotation_about(Eigen::AngleAxisd(angle, frame.axes.col(axis)).toRotationMatrix(),
                          frame.center, frame.center);
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

bool are_alike(const Similarity& a, const Similarity& b) {
    constexpr double kTurned = 0.1, kShifted = 0.02;
    return (a.rotation - b.rotation).norm() < kTurned &&
           (a.translation - b.translation).norm() < kShifted;
}

/// Lays a shape onto another one rigidly, by what lies near: trimmed iterative closest points
/// (Chetverikov et al., "The trimmed iterative closest point algorithm", 2002), in places and
/// normals. What the other shape has besides counts for nothing.
class TrimmedFit {
public:
    TrimmedFit(const CoarseShape& shape, const CoarseShape& onto)
        : onto_(onto.positions), keys_(keys(onto.positions, onto.normals)), tree_(keys_) {
        const std::vector<Index>& rows = shape.levels.front().node_rows;
        places_ = gather(shape.positions, rows);
        normals_ = gather(shape.normals, rows);
    }

    /// A pose of the shape, brought closer.
    Similarity settled(Similarity pose) const {
        constexpr int kRounds = 10;
        constexpr double kFar = 2.0;  // medians
        for (int round = 0; round < kRounds; ++round) {
            const Keys seekers = keys(pose.apply(places_), pose.rotated(normals_));
            const auto count = to_size(places_.rows());
            std::vector<Index> to(count);
            std::vector<double> squared(count);
            for (std::size_t i = 0; i < count; ++i)
                tree_.nearest(seekers.row(static_cast<Eigen::Index>(i)).data(), {&to[i], 1},
                              {&squared[i], 1});
            std::vector<double> sorted = squared;
            const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(count / 2);
            std::ranges::nth_element(sorted, middle);
            const double far = kFar * kFar * *middle;
            std::vector<Index> near;
            for (std::size_t i = 0; i < count; ++i)
                if (squared[i] <= far) near.push_back(to_index(i));
            std::vector<Index> partners;
            for (const Index i : near) partners.push_back(to[to_size(i)]);
            const Positions from = gather(places_, near), there = gather(onto_, partners);
            pose = fit_rigid_motion(from, there);
        }
        return pose;
    }

private:
    using Keys = KdTree<6>::Points;
    static Keys keys(const Positions& positions, const Normals& normals) {
        constexpr double kNormalWeight = 0.2;
        Keys result(positions.rows(), 6);
        result << positions, kNormalWeight * normals;
        return result;
    }
    Positions onto_, places_;
    Normals normals_;
    Keys keys_;
    KdTree<6> tree_;
};

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
            return composed(fit_rigid_motion(before.apply(from), to), before);
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
    const bool of_source = !shapes.source.ends.empty();
    if (of_source != !shapes.target.ends.empty()) {
        const TrimmedFit part(of_source ? shapes.source : shapes.target,
                              of_source ? shapes.target : shapes.source);
        std::vector<Similarity> settled;
        for (const Similarity& pose : poses) {
            const Similarity its =
                of_source ? part.settled(pose.inverse()).inverse() : part.settled(pose);
            if (std::ranges::none_of(
                    settled, [&](const Similarity& other) { return are_alike(its, other); }))
                settled.push_back(its);
        }
        poses.insert(poses.end(), settled.begin(), settled.end());
    }
    return agreeing_with_features(shapes, std::move(poses), options);
}

std::vector<Similarity> tilts(const CoarseShape& shape, double angle) {
    const PrincipalFrame frame = principal_frame(shape);
    std::vector<Similarity> result;
    for (int axis = 0; axis < 3; ++axis)
        for (const double signed_angle : {-angle, angle})
            result.push_back(turn_about(frame, axis, signed_angle));
    return result;
}

std::vector<Similarity> half_turns(const CoarseShape& shape) {
    const PrincipalFrame frame = principal_frame(shape);
    const TrimmedFit onto_itself(shape, shape);
    std::vector<Similarity> result;
    for (int axis = 0; axis < 3; ++axis)
        result.push_back(onto_itself.settled(turn_about(frame, axis, std::numbers::pi)));
    return result;
}

std::vector<Similarity> agreeing_with_features(const CoarsePair& shapes,
                                               std::vector<Similarity> poses,
                                               const PoseOptions& options) {
    const MarkedPlaces places = marked_places(shapes);
    double least = std::numeric_limits<double>::infinity();
    for (const Similarity& pose : poses) least = std::min(least, feature_distance(places, pose));
    std::erase_if(poses, [&](const Similarity& pose) {
        return feature_distance(places, pose) > least + options.feature_distance;
    });
    return poses;
}

}  // namespace pointmorph

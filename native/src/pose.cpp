#include "pointmorph/pose.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace pointmorph {

namespace {

std::size_t at(Index i) {
    return static_cast<std::size_t>(i);
}

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

Similarity turn_about(const Matrix3& rotation, const Vector3& from, const Vector3& to) {
    return {1.0, rotation, to - rotation * from};
}

/// Root mean square distance of the features under a pose.
double feature_distance(const CoarseShape& source, const CoarseShape& target,
                        std::span<const IndexPair> features, const Similarity& pose) {
    double sum = 0.0;
    for (const IndexPair& f : features)
        sum += (source.positions.row(f.source).transpose() -
                pose.rotation * target.positions.row(f.target).transpose() - pose.shift)
                   .squaredNorm();
    return features.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(features.size()));
}

Similarity composed(const Similarity& after, const Similarity& before) {
    return {after.scale * before.scale, after.rotation * before.rotation,
            after.scale * (after.rotation * before.shift) + after.shift};
}

/// Mean distance between the images of the source's points under two registrations, seen from the
/// target at rest.
double difference(const Pose& a, const Pose& b) {
    const Positions x = a.alignment.inverse().apply(a.registration.source_points.positions);
    const Positions y = b.alignment.inverse().apply(b.registration.source_points.positions);
    return (x - y).rowwise().norm().mean();
}

Pose try_pose(const CoarseShape& source, const CoarseShape& target,
              std::span<const IndexPair> features, const Similarity& alignment,
              const RegistrationLevel& level, const RegistrationOptions& options,
              Progress& progress) {
    const CoarseShape there = moved(target, alignment);
    Pose pose{alignment,
              register_level(source, there, 0, features, {source.positions, there.positions}, level,
                             options, progress),
              0.0};
    pose.energy = registration_energy(source, there, 0, pose.registration, options, progress);
    return pose;
}

/// Sorted by energy; of maps that aren't distinct only the first.
void keep_distinct(std::vector<Pose>& poses, const PoseOptions& options) {
    std::ranges::stable_sort(poses, {}, &Pose::energy);
    std::vector<Pose> kept;
    for (Pose& pose : poses)
        if (std::ranges::none_of(kept, [&](const Pose& other) {
                return difference(pose, other) < options.distinct;
            }))
            kept.push_back(std::move(pose));
    poses = std::move(kept);
}

}  // namespace

CoarseShape moved(const CoarseShape& shape, const Similarity& move) {
    CoarseShape result = shape;
    result.positions = move.apply(shape.positions);
    result.normals = move.turn(shape.normals);
    return result;
}

std::vector<Similarity> candidate_poses(const CoarseShape& source, const CoarseShape& target,
                                        std::span<const IndexPair> features,
                                        const PoseOptions& options) {
    const PrincipalFrame s = principal_frame(source), t = principal_frame(target);
    std::vector<Similarity> poses;
    std::array<int, 3> order{0, 1, 2};
    do {
        bool alike = true;
        for (int k = 0; k < 3; ++k) {
            const double a = s.spreads[k] + 1e-9,
                         b = t.spreads[order[static_cast<std::size_t>(k)]] + 1e-9;
            alike = alike && std::max(a / b, b / a) <= options.spread_ratio;
        }
        if (!alike && !std::ranges::is_sorted(order)) continue;  // like to like is always tried
        for (int signs = 0; signs < 8; ++signs) {
            Matrix3 axes;
            for (int k = 0; k < 3; ++k)
                axes.col(k) =
                    (signs >> k & 1 ? -1.0 : 1.0) * t.axes.col(order[static_cast<std::size_t>(k)]);
            const Matrix3 rotation = s.axes * axes.transpose();
            if (rotation.determinant() > 0.0)
                poses.push_back(turn_about(rotation, t.center, s.center));
        }
    } while (std::ranges::next_permutation(order).found);

    if (features.size() >= 2) {
        Positions from(static_cast<Eigen::Index>(features.size()), 3), to = from;
        for (std::size_t k = 0; k < features.size(); ++k) {
            from.row(static_cast<Eigen::Index>(k)) = target.positions.row(features[k].target);
            to.row(static_cast<Eigen::Index>(k)) = source.positions.row(features[k].source);
        }
        const auto by_features = [&](const Similarity& before) {
            const Matrix3 turn = fit_similarity(before.apply(from), to).rotation;
            const Vector3 mean = before.apply(from).colwise().mean().transpose();
            return composed(turn_about(turn, mean, to.colwise().mean().transpose()), before);
        };
        // Two features leave the roll open: each pose gets the least turn that brings them
        // together. Three or more leave nothing open.
        if (features.size() == 2) {
            const std::size_t count = poses.size();
            for (std::size_t k = 0; k < count; ++k) poses.push_back(by_features(poses[k]));
        } else {
            poses.push_back(by_features({}));
        }
    }
    double least = std::numeric_limits<double>::infinity();
    for (const Similarity& pose : poses)
        least = std::min(least, feature_distance(source, target, features, pose));
    std::erase_if(poses, [&](const Similarity& pose) {
        return feature_distance(source, target, features, pose) > least + options.feature_distance;
    });
    return poses;
}

Pose find_pose(const CoarseShape& source, const CoarseShape& target,
               std::span<const IndexPair> features, const PoseOptions& options,
               const RegistrationOptions& registration, Progress& progress) {
    Progress silent;
    std::vector<Pose> trials;
    const auto candidates = candidate_poses(source, target, features, options);
    for (const Similarity& pose : candidates) {
        trials.push_back(
            try_pose(source, target, features, pose, options.trial, registration, silent));
        progress.report(0.6 * static_cast<double>(trials.size()) /
                        static_cast<double>(candidates.size()));
    }
    keep_distinct(trials, options);
    const auto finalists = std::min(trials.size(), at(std::max<Index>(options.finalists, 1)));
    std::vector<Pose> finals;
    for (std::size_t k = 0; k < finalists; ++k) {
        // From the turn that the trial's map implies.
        const Similarity implied =
            fit_similarity(source.positions, trials[k].registration.source_points.positions);
        const Similarity back =
            turn_about(implied.rotation.transpose(),
                       trials[k].registration.source_points.positions.colwise().mean().transpose(),
                       source.positions.colwise().mean().transpose());
        finals.push_back(try_pose(source, target, features, composed(back, trials[k].alignment),
                                  registration.levels.front(), registration, silent));
        progress.report(0.6 + 0.4 * static_cast<double>(k + 1) / static_cast<double>(finalists));
    }
    keep_distinct(finals, options);
    Pose best = std::move(finals.front());
    if (finals.size() > 1) best.margin = finals[1].energy / std::max(best.energy, 1e-300);
    return best;
}

}  // namespace pointmorph

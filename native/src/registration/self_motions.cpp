#include "registration/self_motions.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "base/angle.hpp"
#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

namespace {

/// Images that are moved afterward.
DeformedCloud moved(const DeformedCloud& images, const Similarity& motion) {
    DeformedCloud result{motion.apply(images.positions), motion.rotated(images.normals), {}};
    result.linear.reserve(images.linear.size());
    for (const Matrix3& linear : images.linear) result.linear.push_back(motion.rotation * linear);
    return result;
}

Deformation moved(const Deformation& deformation, const Similarity& motion) {
    Deformation result = deformation;
    result.positions = motion.apply(deformation.positions);
    for (Matrix3& rotation : result.rotations) rotation = motion.rotation * rotation;
    return result;
}

DeformedCloud preceded(const DeformedCloud& images, const CoarseShape& shape,
                       const Similarity& motion) {
    return preceded(images, shape, motion.apply(shape.positions),
                    std::vector<Matrix3>(to_size(shape.size()), motion.rotation));
}

}  // namespace

DeformedCloud preceded(const DeformedCloud& images, const CoarseShape& shape,
                       const Positions& there, std::span<const Matrix3> rotations) {
    const std::vector<Index> rows = nearest_rows(KdTree<3>(shape.positions), there);
    DeformedCloud result = images;
    for (Index i = 0; i < shape.size(); ++i) {
        const Index nearest = rows[to_size(i)];
        const Matrix3& linear = images.linear[to_size(nearest)];
        result.positions.row(i) =
            images.positions.row(nearest) +
            (there.row(i) - shape.positions.row(nearest)) * linear.transpose();
        result.normals.row(i) = images.normals.row(nearest);
        result.linear[to_size(i)] = linear * rotations[to_size(i)];
    }
    return result;
}

Deformation at_nodes(const DeformedCloud& images, const DeformationGraph& graph) {
    Deformation result{gather(images.positions, graph.node_rows), {}, Values(graph.size())};
    for (Index k = 0; k < graph.size(); ++k) {
        const BestRotation best =
            best_rotation(images.linear[to_size(graph.node_rows[to_size(k)])]);
        result.rotations.push_back(best.rotation);
        result.scales[k] = std::max(best.trace / 3.0, 1e-9);
    }
    return result;
}

SelfMotions::SelfMotions(const CoarseShape& shape, const std::vector<Index>& probes)
    : shape_(shape),
      probes_(probes),
      tree_(shape.positions),
      spacing_(std::sqrt(shape.areas.sum() / std::max<double>(1.0, shape.size()))) {}

bool SelfMotions::keep(const Similarity& motion) const {
    constexpr double kOff = 2.0, kOut = 0.15;  // spacings
    // What speaks against it is met sooner in an order that jumps about: a prime step does.
    constexpr std::size_t kStep = 7919;
    const std::size_t count = probes_.size();
    const std::size_t step = count % kStep == 0 ? 1 : kStep;
    double out = 0.0;
    for (std::size_t k = 0, at = 0; k < count; ++k, at = (at + step) % count) {
        const Index row = probes_[at];
        const Eigen::RowVector3d place =
            (motion.scale * motion.rotation * shape_.positions.row(row).transpose() +
             motion.translation)
                .transpose();
        const Eigen::RowVector3d normal =
            (motion.rotation * shape_.normals.row(row).transpose()).transpose();
        const Index there = nearest_on_sheet(tree_, shape_.normals, place, normal);
        const Eigen::RowVector3d off = place - shape_.positions.row(there);
        if (off.norm() > kOff * spacing_ || shape_.normals.row(there).dot(normal) < 0.0)
            return false;
        out += std::abs(off.dot(shape_.normals.row(there)));
    }
    return out <= kOut * spacing_ * static_cast<double>(count);
}

double SelfMotions::distance(const Similarity& motion) const {
    double sum = 0.0;
    for (const Index row : probes_) {
        const Vector3 place = shape_.positions.row(row).transpose();
        sum += (motion.scale * motion.rotation * place + motion.translation - place).norm();
    }
    return sum / std::max<double>(1.0, static_cast<double>(probes_.size()));
}

DistinctPoses distinct_poses(const std::vector<Similarity>& poses, const SelfMotions& source,
                             const SelfMotions& target) {
    constexpr double kSame = 0.05;  // mean distance between motions that are the same, in √area
    std::vector<std::size_t> order(poses.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::ranges::stable_sort(order, {},
                             [&](std::size_t k) { return angle_axis(poses[k].rotation).angle(); });

    DistinctPoses result;
    std::vector<std::size_t> kept;
    const auto add = [&](const SelfMotion& met, const SelfMotions& shape) {
        if (shape.distance(met.motion) < kSame) return;
        const Similarity back = met.motion.inverse();
        if (std::ranges::none_of(result.motions, [&](const SelfMotion& other) {
                return other.of_source == met.of_source &&
                       shape.distance(composed(back, other.motion)) < kSame;
            }))
            result.motions.push_back(met);
    };
    for (const std::size_t k : order) {
        const bool is_known = std::ranges::any_of(kept, [&](std::size_t other) {
            const Similarity &pose = poses[k], &before = poses[other];
            // Source places of the target: those of `before` after a motion of either.
            const Similarity of_target = composed(pose.inverse(), before);
            if (target.keep(of_target)) return add({of_target, false}, target), true;
            const Similarity of_source = composed(before, pose.inverse());
            if (source.keep(of_source)) return add({of_source, true}, source), true;
            return false;
        });
        if (!is_known) kept.push_back(k);
    }
    std::ranges::sort(kept);
    for (const std::size_t k : kept) result.poses.push_back(poses[k]);
    return result;
}

Candidate followed_by_motion(const Candidate& map, const CoarseShape& source,
                             const CoarseShape& target, const SelfMotion& self) {
    Candidate result = map;
    const Registration& from = map.registration;
    Registration& to = result.registration;
    if (self.of_source) {
        // First the motion, then the map.
        to.source_points = preceded(from.source_points, source, self.motion);
        to.source = at_nodes(to.source_points, source.levels.back());
        const Similarity back = self.motion.inverse();
        to.target_points = moved(from.target_points, back);
        to.target = moved(from.target, back);
        return result;
    }
    // First the map, then the motion, seen from where the target was moved.
    const Similarity motion =
        composed(composed(map.alignment, self.motion), map.alignment.inverse());
    to.source_points = moved(from.source_points, motion);
    to.source = moved(from.source, motion);
    to.target_points = preceded(from.target_points, moved(target, map.alignment), motion.inverse());
    to.target = at_nodes(to.target_points, target.levels.back());
    return result;
}

}  // namespace pointmorph

#include "pointmorph/alignment.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "pointmorph/error.hpp"
#include "pointmorph/kd_tree.hpp"
#include "pointmorph/parallel.hpp"

namespace pointmorph {

namespace {

using Point = Eigen::RowVector2d;

/// Closer to the circle than this, a point belongs to the boundary, which stays.
constexpr double kRim = 1e-9;

/// A step is at most this share of the radius of influence where the radius can't be chosen freely.
/// The warp moves its centre by half a step and its slope is half of this, far below 1, where it
/// would fold.
constexpr double kLongestStep = 0.25;

/// The residual must fall by this factor within kPatience sweeps; else features are in each
/// other's way, and the radii are kept to what lies between them, in these steps.
constexpr double kProgress = 0.7;
constexpr Index kPatience = 4;
constexpr std::array kReaches{std::numeric_limits<double>::infinity(), 2.0, 1.0, 0.5};

/// Eq. (4) about one feature: a point at distance r < radius moves by shift (1 − r / radius).
struct Warp {
    Point center;
    Point shift;
    double radius;

    bool apply(Point& u) const {
        const double squared = (u - center).squaredNorm();
        if (!(squared < radius * radius)) return false;
        u += shift * (1.0 - std::sqrt(squared) / radius);
        return true;
    }
};

/// One disk's features and the warps that they have gone through.
struct Disk {
    std::vector<Point> features;
    std::vector<Warp> warps;

    double to_nearest_other(std::size_t i) const {
        double nearest = std::numeric_limits<double>::infinity();
        for (std::size_t j = 0; j < features.size(); ++j)
            if (j != i) nearest = std::min(nearest, (features[i] - features[j]).norm());
        return nearest;
    }

    /// Moves feature i half the way to `goal`, or as far as its surroundings let it.
    void pull(std::size_t i, const Point& goal, double reach, const AlignmentOptions& options) {
        const Point center = features[i];
        const double to_circle = (1.0 - center.norm()) * (1.0 - kRim);
        Point p = goal - center;
        const double distance = p.norm();
        if (!(distance > 0.0) || to_circle <= kRim) return;

        const double wanted =
            options.influence_radius ? *options.influence_radius : options.influence * distance;
        const double others = reach * to_nearest_other(i);
        const double radius = std::min({wanted, to_circle, others});
        const bool free = !options.influence_radius && radius == wanted;
        const double longest =
            free ? distance : radius * std::max(kLongestStep, 1.0 / options.influence);
        if (distance > longest) p *= longest / distance;
        const Warp warp{center, p / 2.0, radius};
        for (Point& feature : features) warp.apply(feature);
        warps.push_back(warp);
    }
};

/// Takes all points through the warps in order. Chunks of points that lie together skip the warps
/// that are elsewhere.
void apply_all(DiskPoints& points, std::span<const Warp> warps, Progress& progress) {
    parallel_for(
        static_cast<Index>(points.rows()), progress,
        [&](Index begin, Index end) {
            Eigen::AlignedBox2d box;
            const auto measure = [&] {
                box.setEmpty();
                for (Index i = begin; i < end; ++i) box.extend(points.row(i).transpose());
            };
            measure();
            for (const Warp& warp : warps) {
                if (!(box.squaredExteriorDistance(warp.center.transpose()) <
                      warp.radius * warp.radius))
                    continue;
                bool moved = false;
                for (Index i = begin; i < end; ++i) {
                    Point u = points.row(i);
                    if (!warp.apply(u)) continue;
                    points.row(i) = u;
                    moved = true;
                }
                if (moved) measure();
            }
        },
        0.0, 1.0, 128);
}

/// Spacing of the disk's points around some of them.
Values spacing_at(const DiskPoints& points, std::span<const IndexPair> features,
                  Index IndexPair::*row) {
    constexpr std::size_t kNeighbors = 6;
    const KdTree<2> tree(points);
    std::array<Index, kNeighbors + 1> rows;
    std::array<double, kNeighbors + 1> squared;
    Values spacing(static_cast<Eigen::Index>(features.size()));
    for (std::size_t i = 0; i < features.size(); ++i) {
        const Index found = tree.nearest(points.row(features[i].*row).data(), rows, squared);
        spacing[static_cast<Eigen::Index>(i)] =
            found > 1 ? std::sqrt(squared[static_cast<std::size_t>(found) - 1] * std::numbers::pi /
                                  static_cast<double>(found - 1))
                      : 1.0;
    }
    return spacing;
}

/// Features that no warp can bring together.
void check(const Disk& source, const Disk& target) {
    const auto on_rim = [](const Point& u) { return u.norm() >= 1.0 - kRim; };
    for (std::size_t i = 0; i < source.features.size(); ++i) {
        const double apart = (source.features[i] - target.features[i]).norm();
        if (on_rim(source.features[i]) && on_rim(target.features[i]) && apart > 1e-6)
            throw FeatureError("feature " + std::to_string(i),
                               "boundary features at one angle of the circle",
                               "a distance of " + std::to_string(apart),
                               "Pin the feature when the boundaries are laid onto the circle.");
        for (std::size_t j = 0; j < i; ++j)
            for (const Disk* disk : {&source, &target})
                if (disk->features[i] == disk->features[j])
                    throw FeatureError(
                        "features " + std::to_string(j) + " and " + std::to_string(i),
                        "two places in the disk", "one and the same",
                        "Move them apart, or remove one of the two.");
    }
}

}  // namespace

double best_rotation(const DiskPoints& source, const DiskPoints& target,
                     std::span<const IndexPair> features) {
    double dot = 0.0, cross = 0.0;
    for (const auto& [s, t] : features) {
        dot += source.row(s).dot(target.row(t));
        cross += source(s, 0) * target(t, 1) - source(s, 1) * target(t, 0);
    }
    return dot == 0.0 && cross == 0.0 ? 0.0 : std::atan2(cross, dot);
}

Alignment align_features(DiskPoints& source, DiskPoints& target,
                         std::span<const IndexPair> features, bool keep_rotation,
                         const AlignmentOptions& options, Progress& progress) {
    if (!(options.influence > 0.5))
        throw OptionError("influence", "more than 0.5, so that the warp is one-to-one",
                          std::to_string(options.influence), "Choose a larger multiple.");
    if (options.influence_radius && !(*options.influence_radius > 0.0))
        throw OptionError("influence_radius", "more than 0",
                          std::to_string(*options.influence_radius), "Choose a larger radius.");

    Alignment result;
    if (features.empty()) return result;
    if (!keep_rotation) {
        result.rotation = best_rotation(source, target, features);
        source = source * Eigen::Rotation2Dd(result.rotation).toRotationMatrix().transpose();
    }

    Disk moving_source, moving_target;
    for (const auto& [s, t] : features) {
        moving_source.features.push_back(source.row(s));
        moving_target.features.push_back(target.row(t));
    }
    check(moving_source, moving_target);
    const Values spacing = spacing_at(source, features, &IndexPair::source)
                               .cwiseMin(spacing_at(target, features, &IndexPair::target))
                               .cwiseMax(1e-12);
    const auto residual = [&] {
        double largest = 0.0;
        for (std::size_t i = 0; i < features.size(); ++i)
            largest =
                std::max(largest, (moving_source.features[i] - moving_target.features[i]).norm() /
                                      spacing[static_cast<Eigen::Index>(i)]);
        return largest;
    };

    std::size_t reach = 0;
    result.residual = residual();
    double before = result.residual;
    Index since = 0;
    while (result.residual > options.error) {
        if (result.sweeps == options.max_sweeps)
            throw ConvergenceError("alignment",
                                   "features within " + std::to_string(options.error) + " spacings",
                                   std::to_string(result.residual) + " after " +
                                       std::to_string(result.sweeps) + " sweeps",
                                   "Check for features that cross each other, lower influence, or "
                                   "raise alignment_error or alignment_max_sweeps.");
        for (std::size_t i = 0; i < features.size(); ++i)
            moving_source.pull(i, moving_target.features[i], kReaches[reach], options);
        for (std::size_t i = 0; i < features.size(); ++i)
            moving_target.pull(i, moving_source.features[i], kReaches[reach], options);
        ++result.sweeps;
        result.residual = residual();
        if (++since == kPatience) {
            if (result.residual > kProgress * before && reach + 1 < kReaches.size()) ++reach;
            before = result.residual;
            since = 0;
        }
        progress.report(0.5 * result.sweeps / options.max_sweeps);
    }
    apply_all(source, moving_source.warps, progress);
    apply_all(target, moving_target.warps, progress);
    return result;
}

}  // namespace pointmorph

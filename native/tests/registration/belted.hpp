// Ellipsoids with marked belts and caps, for tests of features in maps.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

#include "marked_shapes.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "registration/watched_options.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {

/// Two ellipsoids. Directions are the sphere's. Rows of the belt come first: points along the
/// equator, the target's turned by `twist`.
struct Belted {
    static constexpr Index kSource = 1250, kTarget = 1000, kBelt = 50, kOtherBelt = 37;
    Positions directions[2];
    Positions positions[2];
    Normals normals[2];
    Feature belt = curve("belt", rows_from(0, kBelt), rows_from(0, kOtherBelt), true);

    explicit Belted(double twist) {
        const Vector3 axes[2] = {{1.0, 0.9, 0.8}, {1.0, 0.7, 0.9}};
        for (int side = 0; side < 2; ++side) {
            const Index count = side == 0 ? kBelt : kOtherBelt;
            const Positions ball = shapes::sphere(side == 0 ? kSource : kTarget) *
                                   shapes::rotation(static_cast<unsigned>(side) + 1).transpose();
            directions[side].resize(count + ball.rows(), 3);
            for (Index k = 0; k < count; ++k) {
                const double angle = 2.0 * std::numbers::pi * k / count + (side == 0 ? 0.0 : twist);
                directions[side].row(k) << std::cos(angle), std::sin(angle), 0.0;
            }
            directions[side].bottomRows(ball.rows()) = ball;
            positions[side] = directions[side] * axes[side].asDiagonal();
            normals[side] = directions[side] * axes[side].cwiseInverse().asDiagonal();
            normals[side].rowwise().normalize();
        }
    }

    Refinement refined(std::span<const Feature> features) const {
        RefinementOptions options = lighter_where_watched();
        if (is_watched()) options.coarse = {600, {60, 250}, {}};
        Progress progress;
        return refine({positions[0], normals[0]}, {positions[1], normals[1]}, features, options,
                      progress);
    }

    double spacing() const {
        return std::sqrt(estimated_area(KdTree<3>(positions[1])) /
                         static_cast<double>(positions[1].rows()));
    }

    /// Root mean square distance of the source's belt from the same share of the target's, in
    /// spacings: the polyline is all that this needs.
    template <class Maps>
    double error(const Maps& r) const {
        const auto lengths = [&](int side, Index count) {
            std::vector<double> sums{0.0};
            for (Index k = 0; k < count; ++k)
                sums.push_back(
                    sums.back() +
                    (positions[side].row((k + 1) % count) - positions[side].row(k)).norm());
            return sums;
        };
        const auto own = lengths(0, kBelt), other = lengths(1, kOtherBelt);
        double sum = 0.0;
        for (Index k = 0; k < kBelt; ++k) {
            const double along = own[to_size(k)] / own.back() * other.back();
            Index j = 0;
            while (j + 1 < kOtherBelt && other[to_size(j + 1)] <= along) ++j;
            const double part =
                (along - other[to_size(j)]) / (other[to_size(j + 1)] - other[to_size(j)]);
            const Eigen::RowVector3d place =
                (1.0 - part) * positions[1].row(j) + part * positions[1].row((j + 1) % kOtherBelt);
            sum += (r.source_images.row(k) - place).squaredNorm();
        }
        return std::sqrt(sum / kBelt) / spacing();
    }
};

inline constexpr double kTwist = 40.0 / 180.0 * std::numbers::pi;

/// How much of a region's weight is carried into the partner: by the nearest sample to each image.
inline double carried(const Marked& from, const Marked& to, const Positions& images,
                      const Positions& other) {
    Values weight = Values::Zero(other.rows());
    for (std::size_t i = 0; i < to.rows.size(); ++i) weight[to.rows[i]] = to.weight(i);
    const KdTree<3> tree(other);
    double sum = 0.0, all = 0.0;
    for (std::size_t i = 0; i < from.rows.size(); ++i) {
        Index nearest;
        double squared;
        tree.nearest(images.row(from.rows[i]).data(), {&nearest, 1}, {&squared, 1});
        sum += std::min(from.weight(i), weight[nearest]);
        all += from.weight(i);
    }
    return sum / all;
}

/// Points of a Belted side whose direction is closer than `radius` to `center`, weighted by
/// `weight` of the angle's share of the radius.
inline Marked cap(const Positions& directions, const Vector3& center, double radius,
                  const std::function<double(double)>& weight) {
    Marked marked;
    for (Index i = 0; i < directions.rows(); ++i) {
        const double angle = std::acos(std::clamp(directions.row(i).dot(center), -1.0, 1.0));
        if (angle >= radius) continue;
        marked.rows.push_back(i);
        marked.weights.push_back(weight(angle / radius));
    }
    return marked;
}

/// The ends of the axes, but for +z, as features; then the region.
struct Capped : Belted {
    std::vector<Feature> features;

    Capped(
        const Vector3& there, double radius, double other_radius,
        const std::function<double(double)>& weight = [](double) { return 1.0; })
        : Belted(0.0) {
        for (const Vector3& end : {Vector3(1, 0, 0), Vector3(-1, 0, 0), Vector3(0, 1, 0),
                                   Vector3(0, -1, 0), Vector3(0, 0, -1)}) {
            Index rows[2];
            for (int side = 0; side < 2; ++side) (directions[side] * end).maxCoeff(&rows[side]);
            features.push_back(point_feature(std::to_string(features.size()), rows[0], rows[1]));
        }
        features.push_back(region("cap", cap(directions[0], Vector3::UnitZ(), radius, weight),
                                  cap(directions[1], there.normalized(), other_radius, weight)));
    }

    template <class Maps>
    double share(const Maps& r) const {
        const Feature& f = features.back();
        return std::min(carried(f.source, f.target, r.source_images, positions[1]),
                        carried(f.target, f.source, r.target_images, positions[0]));
    }
    std::span<const Feature> points() const { return std::span(features).first(5); }
};

}  // namespace pointmorph

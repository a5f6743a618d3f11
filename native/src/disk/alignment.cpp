#include "pointmorph/disk/alignment.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "base/angle.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

using Point = Eigen::Vector2d;

/// Distances in the unit disk below this are rounding.
constexpr double kRounding = 1e-14;
/// A feature this near to the circle is a boundary point.
constexpr double kOnCircle = 1e-12;
/// Length of a step at the most, as a share of d. Below 1 a warp is one-to-one, the paper's
/// condition; at a quarter it stretches and shrinks by no more than that.
constexpr double kLongestStep = 0.25;
/// d at the most, as a share of the distance to the circle, and when it is reduced, at the least,
/// of the distance to the nearest other feature: rounding makes no point of influence of either.
constexpr double kMargin = 0.999;
/// Every so many sweeps a feature that has come closer to its partner by less than this share of
/// its own steps gets half its d: the others drag it back.
constexpr Index kPatience = 4;
constexpr double kEfficiency = 0.5;
/// Neighbors from which the local spacing is estimated.
constexpr std::size_t kNeighbors = 6;
/// Points that are warped together.
constexpr Index kBlock = 64;

/// One application of eq. (4) to a whole disk.
struct Warp {
    Point center;
    double radius;  ///< d
    Point step;     ///< p/2, or shorter: what the center moves by

    double inverse_radius() const { return 1.0 / radius; }
};

/// The warp of one point. The same operations in the same order as in `warp_block`, so that
/// features move here as they will there, to the bit.
Point warped(const Point& u, const Warp& warp) {
    const double x = u[0] - warp.center[0], y = u[1] - warp.center[1];
    const double distance = std::sqrt(x * x + y * y);
    const double weight = std::max(0.0, 1.0 - distance * warp.inverse_radius());
    return {u[0] + warp.step[0] * weight, u[1] + warp.step[1] * weight};
}

struct Rotation {
    explicit Rotation(double angle) : cosine(std::cos(angle)), sine(std::sin(angle)) {}

    Point operator()(const Point& u) const {
        return {cosine * u[0] - sine * u[1], sine * u[0] + cosine * u[1]};
    }
    double cosine, sine;
};

/// A feature's image in one disk with the neighbors that tell the spacing around it.
struct Image {
    Point at;
    std::array<Point, kNeighbors> neighbors;
    std::size_t count = 0;  ///< of neighbors, fewer than kNeighbors in a tiny disk
    double first_spacing = 0.0;

    /// 1/√density around the feature: k neighbors within r make a mean square of r²/2.
    double present_spacing() const {
        if (count == 0) return std::sqrt(std::numbers::pi);  // one point in the disk
        double sum = 0.0;
        for (std::size_t i = 0; i < count; ++i) sum += (neighbors[i] - at).squaredNorm();
        return std::sqrt(2.0 * std::numbers::pi * sum) / static_cast<double>(count);
    }
    /// The warps may crowd points together here; that they may also spread them, or draw them
    /// out to a line, must not loosen what is asked for.
    double spacing() const { return std::min(first_spacing, present_spacing()); }

    void apply(const Warp& warp) {
        at = warped(at, warp);
        for (std::size_t i = 0; i < count; ++i) neighbors[i] = warped(neighbors[i], warp);
    }
};

/// The nearest neighbors of a row, but for points at the very same place, by a scan: a tree is
/// worth its while only for many more features than people mark.
Image image_of(const DiskPoints& disk, Index row) {
    Image image;
    image.at = disk.row(row);
    std::array<double, kNeighbors> squared_distances;
    squared_distances.fill(std::numeric_limits<double>::infinity());
    for (Index i = 0; i < disk.rows(); ++i) {
        const double x = disk(i, 0) - image.at[0], y = disk(i, 1) - image.at[1];
        const double squared_distance = x * x + y * y;
        if (!(squared_distance < squared_distances.back()) || squared_distance == 0.0) continue;
        std::size_t place = std::min(image.count, kNeighbors - 1);
        for (; place > 0 && squared_distances[place - 1] > squared_distance; --place) {
            squared_distances[place] = squared_distances[place - 1];
            image.neighbors[place] = image.neighbors[place - 1];
        }
        squared_distances[place] = squared_distance;
        image.neighbors[place] = disk.row(i);
        image.count = std::min(image.count + 1, kNeighbors);
    }
    image.first_spacing = image.present_spacing();
    return image;
}

/// A feature on its way.
struct Feature {
    IndexPair rows;
    std::array<Image, 2> images;  ///< in the source and the target disk
    double farthest = 0.0;        ///< largest distance ‖p‖ so far
    double reduction = 1.0;       ///< of d
    double steps = 0.0;           ///< lengths of its own steps since the last check
    double distance_then = 0.0;   ///< ‖p‖ at the last check

    double distance() const { return (images[0].at - images[1].at).norm(); }
    /// Distance beyond rounding in local spacings of the denser disk.
    double residual() const {
        const double spacing = std::min(images[0].spacing(), images[1].spacing());
        return std::max(0.0, distance() - kRounding) / std::max(spacing, kRounding);
    }
    double to_circle(int disk) const { return 1.0 - images[to_size(disk)].at.norm(); }
};

std::string name_of(const IndexPair& rows) {
    return "the feature at source row " + std::to_string(rows.source) + " and target row " +
           std::to_string(rows.target);
}

void check(const AlignmentOptions& options) {
    const auto require = [](bool holds, const char* option, const char* range, double value) {
        if (!holds)
            throw OptionError(option, range, in_short(value), "See the option's description.");
    };
    require(options.error >= 1e-6 && options.error <= 1.0, "error", "a number from 1e-6 to 1",
            options.error);
    require(options.influence > 0.5 && options.influence <= 1000.0, "influence",
            "a number above 0.5, to 1000", options.influence);
    if (options.influence_radius)
        require(*options.influence_radius > 0.0 && *options.influence_radius <= 2.0,
                "influence_radius", "a number above 0, to 2", *options.influence_radius);
    require(options.max_sweeps >= 1, "max_sweeps", "a whole number of 1 or more",
            options.max_sweeps);
}

/// The features' images, the source's rotated; each once, also where two are the same.
std::vector<Feature> features_of(const DiskPoints& source, const DiskPoints& target,
                                 std::span<const IndexPair> rows, const Rotation& rotation,
                                 Progress& progress) {
    std::vector<Feature> all(rows.size());
    parallel_for(
        to_index(rows.size()), progress,
        [&](Index begin, Index end) {
            for (auto i = to_size(begin); i < to_size(end); ++i) {
                assert(rows[i].source >= 0 && rows[i].source < source.rows());
                assert(rows[i].target >= 0 && rows[i].target < target.rows());
                Feature& feature = all[i];
                feature.rows = rows[i];
                feature.images = {image_of(source, rows[i].source),
                                  image_of(target, rows[i].target)};
                Image& turned = feature.images[0];
                turned.at = rotation(turned.at);
                for (std::size_t k = 0; k < turned.count; ++k)
                    turned.neighbors[k] = rotation(turned.neighbors[k]);
            }
        },
        0.0, 0.3, 1);

    std::vector<Feature> features;
    for (const Feature& feature : all) {
        bool repeats = false;
        for (const Feature& other : features) {
            std::array<bool, 2> same;
            for (std::size_t disk = 0; disk < 2; ++disk)
                same[disk] = (feature.images[disk].at - other.images[disk].at).norm() <= kRounding;
            if (same[0] != same[1])
                throw FeatureError("features", "features on different points of both shapes",
                                   name_of(other.rows) + " and " + name_of(feature.rows) +
                                       " on one point of the " + (same[0] ? "source" : "target"),
                                   "Move or remove one of the two.");
            repeats = repeats || same[0];
        }
        if (!repeats) features.push_back(feature);
    }
    return features;
}

/// Moves the features until they meet, and records how.
class Meeting {
public:
    Meeting(std::vector<Feature> features, const AlignmentOptions& options)
        : features_(std::move(features)), options_(options) {
        for (Feature& feature : features_) {
            feature.farthest = feature.distance_then = feature.distance();
            if (feature.residual() > options.error &&
                (feature.to_circle(0) < kOnCircle || feature.to_circle(1) < kOnCircle))
                throw FeatureError(
                    "features", "boundary features at the same place on both boundaries",
                    name_of(feature.rows) + " on the boundary of one shape, " +
                        in_short(feature.distance()) + " away from its place in the other",
                    "Mark boundary features on both boundaries, so that they are pinned, or move "
                    "this one off the boundary.");
        }
    }

    double residual() const {
        double largest = 0.0;
        for (const Feature& feature : features_) largest = std::max(largest, feature.residual());
        return largest;
    }

    /// Steps 2 and 3 of the paper: warps the first disk for all features, then the second.
    void sweep() {
        if (++sweeps_ % kPatience == 0) reduce_radii();
        for (int disk = 0; disk < 2; ++disk)
            for (std::size_t i = 0; i < features_.size(); ++i) {
                Feature& feature = features_[i];
                feature.farthest = std::max(feature.farthest, feature.distance());
                // A feature that is there needs no steps, unless the others drag it off again.
                if (feature.residual() <= options_.error / 2) continue;
                const Warp warp = next_warp(feature, disk);
                if (!(warp.radius > 0.0)) continue;
                feature.steps += warp.step.norm();
                for (Feature& each : features_) each.images[to_size(disk)].apply(warp);
                warps_[to_size(disk)].push_back(warp);
            }
    }

    Index sweeps() const { return sweeps_; }
    std::span<const Warp> warps(std::size_t disk) const { return warps_[disk]; }

    const Feature& worst() const {
        return *std::ranges::max_element(features_, {}, &Feature::residual);
    }

private:
    /// What the options ask for.
    double radius(const Feature& feature) const {
        return feature.reduction *
               options_.influence_radius.value_or(options_.influence * feature.farthest);
    }

    Warp next_warp(const Feature& feature, int disk) const {
        const auto here = to_size(disk);
        const Point way = feature.images[1 - here].at - feature.images[here].at;
        const double d = std::min(radius(feature), kMargin * feature.to_circle(disk));
        const double length = std::min(way.norm() / 2.0, kLongestStep * d);
        return {feature.images[here].at, d, way * (length / way.norm())};
    }

    void reduce_radii() {
        for (Feature& feature : features_) {
            const double distance = feature.distance();
            const double gained = feature.distance_then - distance;
            if (feature.residual() > options_.error && gained < kEfficiency * feature.steps) {
                const double now =
                    std::min(radius(feature),
                             kMargin * std::max(feature.to_circle(0), feature.to_circle(1)));
                const double less = std::max(now / 2.0, kMargin * to_nearest(feature));
                feature.reduction *= std::min(now, less) / radius(feature);
            }
            feature.distance_then = distance;
            feature.steps = 0.0;
        }
    }

    /// Distance to the nearest other feature in either disk.
    double to_nearest(const Feature& feature) const {
        double nearest = 2.0;
        for (const Feature& other : features_)
            if (&other != &feature)
                for (std::size_t disk = 0; disk < 2; ++disk)
                    nearest =
                        std::min(nearest, (other.images[disk].at - feature.images[disk].at).norm());
        return nearest;
    }

    std::vector<Feature> features_;
    const AlignmentOptions& options_;
    std::array<std::vector<Warp>, 2> warps_;
    Index sweeps_ = 0;
};

/// Coordinates of some points, apart, so that loops over them are vectorized.
using Row = Eigen::Array<double, Eigen::Dynamic, 1, Eigen::ColMajor, kBlock, 1>;

/// Applies all warps to up to kBlock points, leaving out those that reach none of them: neighbors
/// in space are mostly neighbors in memory.
void warp_block(Row& x, Row& y, std::span<const Warp> warps) {
    Row weight(x.size());
    Point low(x.minCoeff(), y.minCoeff()), high(x.maxCoeff(), y.maxCoeff());
    for (const Warp& warp : warps) {
        const Point nearest = warp.center.cwiseMax(low).cwiseMin(high);
        if ((nearest - warp.center).norm() >= warp.radius) continue;
        weight = ((x - warp.center[0]).square() + (y - warp.center[1]).square()).sqrt();
        weight = (1.0 - weight * warp.inverse_radius()).max(0.0);
        x += warp.step[0] * weight;
        y += warp.step[1] * weight;
        low = {x.minCoeff(), y.minCoeff()};
        high = {x.maxCoeff(), y.maxCoeff()};
    }
}

void apply(DiskPoints& disk, const Rotation* rotation, std::span<const Warp> warps,
           Progress& progress, double first, double last) {
    if (!rotation && warps.empty()) return;
    parallel_for(
        to_index(disk.rows()), progress,
        [&](Index begin, Index end) {
            auto rows = disk.middleRows(begin, end - begin);
            if (rotation)
                for (Index i = 0; i < rows.rows(); ++i) rows.row(i) = (*rotation)(rows.row(i));
            Row x = rows.col(0).array(), y = rows.col(1).array();
            warp_block(x, y, warps);
            rows.col(0) = x;
            rows.col(1) = y;
        },
        first, last, kBlock);
}

}  // namespace

double best_rotation(const DiskPoints& source, const DiskPoints& target,
                     std::span<const IndexPair> features) {
    // Σ ‖R u¹ − u²‖² is least where Σ u² · R u¹ = cos φ Σ u¹ · u² + sin φ Σ u¹ × u² is greatest.
    double cosine = 0.0, sine = 0.0, size = 0.0;
    for (const auto& [s, t] : features) {
        const Point u = source.row(s), v = target.row(t);
        cosine += u.dot(v);
        sine += u[0] * v[1] - u[1] * v[0];
        size += u.norm() * v.norm();
    }
    return Eigen::Vector2d(cosine, sine).norm() > kRounding * size ? angle_of(sine, cosine) : 0.0;
}

Alignment align_features(DiskPoints& source, DiskPoints& target,
                         std::span<const IndexPair> features, bool keep_rotation,
                         const AlignmentOptions& options, Progress& progress) {
    check(options);
    Alignment result;
    if (!keep_rotation) result.rotation = best_rotation(source, target, features);
    const Rotation rotation(result.rotation);

    Meeting meeting(features_of(source, target, features, rotation, progress), options);
    while ((result.residual = meeting.residual()) > options.error) {
        if (meeting.sweeps() == options.max_sweeps)
            throw ConvergenceError(
                "features", "features closer than " + in_short(options.error) + " point spacings",
                name_of(meeting.worst().rows) + " still " + in_short(result.residual) +
                    " apart after " + std::to_string(options.max_sweeps) + " sweeps",
                "Check that it marks the same place on both shapes and isn't swapped with a "
                "neighbor, or allow more sweeps.");
        meeting.sweep();
        progress.report(0.3 + 0.2 * meeting.sweeps() / options.max_sweeps);
    }
    result.sweeps = meeting.sweeps();

    apply(source, result.rotation != 0.0 ? &rotation : nullptr, meeting.warps(0), progress, 0.5,
          0.75);
    apply(target, nullptr, meeting.warps(1), progress, 0.75, 1.0);
    return result;
}

}  // namespace pointmorph

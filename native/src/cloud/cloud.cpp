#include "pointmorph/cloud/cloud.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>

#include "cloud/moments.hpp"
#include "pointmorph/base/error.hpp"

namespace pointmorph {

namespace {

/// A cloud whose second extent is below this share of the first is a line. Single precision leaves
/// up to 2e-7 of a line that is turned, and two lengths away from the origin.
constexpr double kFlatness = 1e-6;

/// Extents in between leave all digits to positions, and have reciprocals.
constexpr double kLeastExtent = 1e-290;
constexpr double kLargestExtent = 1e290;

/// Lengths in between can be squared.
constexpr double kLeastNormal = 1e-150;
constexpr double kLargestNormal = 1e150;
constexpr double kLeastSquare = 1e-298, kLargestSquare = 1e298;  // well in between

std::string count_of(Eigen::Index count, const std::string& noun) {
    return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

template <class Array>
Eigen::Index first_row_not_finite(const Array& rows) {
    for (Eigen::Index i = 0; i < rows.rows(); ++i)
        if (!rows.row(i).allFinite()) return i;
    return -1;
}

template <class Array>
void check_attribute(const Cloud& cloud, const Array& rows, const char* what) {
    if (rows.rows() == 0) return;
    if (rows.rows() != cloud.positions.rows())
        throw CloudError(
            cloud.name, std::string("one row of ") + what + " per point",
            std::to_string(rows.rows()) + " rows for " + count_of(cloud.positions.rows(), "point"),
            "Give " + std::string(what) + " for every point or for none.");
    if (const auto row = first_row_not_finite(rows); row >= 0)
        throw CloudError(cloud.name, std::string("finite ") + what,
                         "NaN or infinity at point " + std::to_string(row),
                         "Remove or repair that point.");
}

void check_faces(const Cloud& cloud) {
    const auto& [offsets, corners] = cloud.faces;
    if (offsets.empty() || offsets.front() != 0 || offsets.back() != std::ssize(corners) ||
        !std::ranges::is_sorted(offsets))
        throw CloudError(cloud.name, "faces one after the other", "other ends of faces",
                         "Count all corners before each face, from 0.");
    const auto beyond = std::ranges::find_if(
        cloud.faces.corners, [&](Index corner) { return corner < 0 || corner >= cloud.size(); });
    if (beyond == cloud.faces.corners.end()) return;
    throw CloudError(cloud.name, "faces of its " + count_of(cloud.positions.rows(), "vertex"),
                     "a corner at vertex " + std::to_string(*beyond), "Count vertices from 0.");
}

/// Second extent along the principal axes as a share of the first; 0 for a line.
double relative_width(const Positions& positions) {
    const Normalization unit = normalization(positions);
    Moments moments(Vector3::Zero());
    for (Index i = 0; i < positions.rows(); ++i)
        moments.add((positions.row(i).transpose() - unit.center) / unit.scale);
    const Eigen::SelfAdjointEigenSolver<Matrix3> eigen(moments.covariance(),
                                                       Eigen::EigenvaluesOnly);
    return std::sqrt(std::max(0.0, eigen.eigenvalues()[1]) / eigen.eigenvalues()[2]);
}

}  // namespace

void validate(const Cloud& cloud, Index minimum_points) {
    const auto& p = cloud.positions;
    if (p.rows() > std::numeric_limits<Index>::max())
        throw CloudError(cloud.name, "fewer than 2^31 points", count_of(p.rows(), "point"),
                         "Sample fewer points.");
    const Index minimum = std::max<Index>(minimum_points, 3);
    if (p.rows() < minimum)
        throw CloudError(cloud.name, "at least " + count_of(minimum, "point"),
                         p.rows() == 0 ? "none" : count_of(p.rows(), "point"),
                         "Subdivide the mesh or sample the surface more densely.");
    if (const auto row = first_row_not_finite(p); row >= 0)
        throw CloudError(cloud.name, "finite coordinates",
                         "NaN or infinity at point " + std::to_string(row),
                         "Remove or repair that point.");
    check_attribute(cloud, cloud.normals, "normals");
    check_attribute(cloud, cloud.colors, "colors");
    check_attribute(cloud, cloud.radii, "radii");
    for (Eigen::Index i = 0; i < cloud.normals.rows(); ++i) {
        // Nearly always; else the square may be no number.
        const double squared = cloud.normals.row(i).squaredNorm();
        if (squared > kLeastSquare && squared < kLargestSquare) continue;
        const double length = cloud.normals.row(i).stableNorm();
        if (length == 0.0)
            throw CloudError(cloud.name, "normals that aren't zero",
                             "a zero normal at point " + std::to_string(i),
                             "Recalculate the normals, or give none to have them estimated.");
        if (length < kLeastNormal || length > kLargestNormal)
            throw CloudError(cloud.name,
                             "normals with lengths from " + in_short(kLeastNormal) + " to " +
                                 in_short(kLargestNormal),
                             "a length of " + in_short(length) + " at point " + std::to_string(i),
                             "Normalize the normals.");
    }
    for (Eigen::Index i = 0; i < cloud.radii.rows(); ++i)
        if (cloud.radii[i] < 0.0)
            throw CloudError(cloud.name, "radii of 0 or more",
                             "a negative radius at point " + std::to_string(i),
                             "Repair that radius, or give none.");

    check_faces(cloud);

    const double extent = (p.colwise().maxCoeff() - p.colwise().minCoeff()).maxCoeff();
    if (extent == 0.0)
        throw CloudError(cloud.name, "points on a surface", "points that all coincide",
                         "Check the object's scale and its vertices.");
    if (extent < kLeastExtent || extent > kLargestExtent)
        throw CloudError(
            cloud.name,
            "an extent from " + in_short(kLeastExtent) + " to " + in_short(kLargestExtent),
            in_short(extent), "Scale the object.");
    if (relative_width(p) < kFlatness)
        throw CloudError(cloud.name, "points on a surface", "points that all lie on one line",
                         "Check the object's scale and its vertices.");
}

Positions Normalization::apply(const Positions& positions) const {
    return (positions.rowwise() - center.transpose()) / scale;
}

Positions Normalization::restore(const Positions& positions) const {
    return (positions * scale).rowwise() + center.transpose();
}

Normalization normalization(const Positions& positions) {
    // In one pass: Eigen makes one of each column, for either end.
    Vector3 low = positions.row(0), high = low;
    for (Index i = 1; i < positions.rows(); ++i) {
        low = low.cwiseMin(positions.row(i).transpose());
        high = high.cwiseMax(positions.row(i).transpose());
    }
    const Vector3 center = low + (high - low) / 2.0;
    return {center, (high - low).stableNorm() / 2.0};
}

std::vector<Index> spatial_order(const Positions& positions) {
    if (positions.rows() == 0) return {};
    constexpr int kBits = 21;  // three of them fill 63 bits
    const Vector3 low = positions.colwise().minCoeff();
    const Vector3 extent = positions.colwise().maxCoeff().transpose() - low;
    const double cells = std::ldexp(1.0, kBits) - 1.0;
    const double side = extent.maxCoeff();

    const auto spread = [](std::uint64_t x) {  // abc → a00b00c
        x = (x | x << 32) & 0x001f00000000ffffULL;
        x = (x | x << 16) & 0x001f0000ff0000ffULL;
        x = (x | x << 8) & 0x100f00f00f00f00fULL;
        x = (x | x << 4) & 0x10c30c30c30c30c3ULL;
        x = (x | x << 2) & 0x1249249249249249ULL;
        return x;
    };
    std::vector<std::pair<std::uint64_t, Index>> keys(to_size(positions.rows()));
    for (Index i = 0; i < positions.rows(); ++i) {
        std::uint64_t code = 0;
        for (int d = 0; d < 3; ++d) {
            const double cell = side > 0.0 ? (positions(i, d) - low[d]) / side * cells : 0.0;
            code |= spread(static_cast<std::uint64_t>(cell)) << d;
        }
        keys[to_size(i)] = {code, i};
    }
    std::ranges::sort(keys, [&](const auto& a, const auto& b) {
        if (a.first != b.first) return a.first < b.first;
        const auto key = [&](Index i) {
            return std::tuple(positions(i, 0), positions(i, 1), positions(i, 2), i);
        };
        return key(a.second) < key(b.second);
    });
    std::vector<Index> order(keys.size());
    std::ranges::transform(keys, order.begin(), [](const auto& key) { return key.second; });
    return order;
}

std::vector<Index> inverse_order(std::span<const Index> order) {
    std::vector<Index> rank(order.size());
    for (std::size_t i = 0; i < order.size(); ++i) rank[to_size(order[i])] = to_index(i);
    return rank;
}

}  // namespace pointmorph

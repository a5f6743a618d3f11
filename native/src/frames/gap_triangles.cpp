#include "frames/gap_triangles.hpp"

#include <Eigen/Geometry>
#include <utility>

#include "base/compiler.hpp"
#include "base/unset.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/subset.hpp"

namespace pointmorph {

namespace {

/// Largest circle through a triangle's corners, in spacings: wider gaps are holes of the model.
constexpr double kReach = 2.0;
/// Spacings below this share of the cloud's mean are rounding or doubled points.
constexpr double kFinest = 0.05;

/// Twice a triangle's area, along the normal of the side from which its corners run anticlockwise.
Vector3 facing(const Positions& positions, const GapTriangle& corners) {
    const Vector3 origin = positions.row(corners[0]).transpose();
    return (positions.row(corners[1]).transpose() - origin)
        .cross(positions.row(corners[2]).transpose() - origin);
}

/// The nearest of each row, where they are known of rows in another order, and maybe more.
Neighborhoods by_row(const OrderedNeighbors& found) {
    const auto& [order, nearest] = found;
    const std::size_t width = std::min(nearest[0].size(), to_size(Resampling::kNeighbors));
    Neighborhoods result;
    for (std::size_t i = 0; i < order.size(); ++i)
        result.offsets.push_back(static_cast<std::int64_t>((i + 1) * width));
    result.indices.resize(order.size() * width);
    for (std::size_t k = 0; k < order.size(); ++k)
        std::ranges::transform(nearest[to_index(k)].first(width),
                               result.indices.begin() + result.offsets[to_size(order[k])],
                               [&](Index other) { return order[to_size(other)]; });
    return result;
}

}  // namespace

EndSamples::EndSamples(const Cloud& cloud, std::vector<Index> its_pairs,
                       const OrderedNeighbors* known, Progress& progress)
    : unit(normalization(cloud.positions)),
      positions(unit.apply(cloud.positions)),
      normals(cloud.normals.rowwise().normalized()),
      tree(positions),
      pairs(std::move(its_pairs)) {
    {
        const Progress::Part part(progress, 0.0, 0.5);
        nearest =
            known ? by_row(*known) : nearest_neighbors(tree, Resampling::kNeighbors, progress);
    }
    const double area = estimated_area(tree);
    const double finest = kFinest * std::sqrt(area / static_cast<double>(positions.rows()));
    spacing = local_spacing(positions, nearest).cwiseMax(finest);
    {
        const Progress::Part part(progress, 0.5, 1.0);
        triangles = local_triangles(positions, normals, nearest, spacing, kReach, progress);
    }
    density.resize(positions.rows());
    parallel_for(
        to_index(positions.rows()), progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                const auto near = nearest[i];
                const auto k = std::min(near.size(), to_size(Resampling::kDensityNeighbors));
                const double radius =
                    std::max((positions.row(near[k - 1]) - positions.row(i)).norm(), finest);
                density[i] = static_cast<double>(k) / (radius * radius) * area;
            }
        },
        1.0);
    size = std::sqrt(area) * unit.scale;
}

std::vector<Index> standing_for(std::span<const IndexPair> pairs, Index IndexPair::*side,
                                Index IndexPair::*other_side, const Cloud& cloud,
                                const Cloud& other) {
    Positions mean = Positions::Zero(cloud.size(), 3);
    Values count = Values::Zero(cloud.size());
    for (const IndexPair& pair : pairs) {
        mean.row(pair.*side) += other.positions.row(pair.*other_side);
        count[pair.*side] += 1.0;
    }
    std::vector<Index> result(to_size(cloud.size()), -1);
    Values best(cloud.size());
    for (std::size_t i = 0; i < pairs.size(); ++i) {
        const Index row = pairs[i].*side;
        const double off =
            (other.positions.row(pairs[i].*other_side) - mean.row(row) / count[row]).stableNorm();
        if (result[to_size(row)] >= 0 && !(off < best[row])) continue;
        result[to_size(row)] = to_index(i);
        best[row] = off;
    }
    return result;
}

std::vector<GapTriangle> gap_triangles(const EndSamples& source, const EndSamples& target,
                                       std::span<const IndexPair> pairs, Progress& progress) {
    const std::size_t of_source = source.triangles.size(),
                      of_both = of_source + target.triangles.size();
    UnsetVector<GapTriangle> found(of_both + 2 * pairs.size());
    const auto put = [&](std::size_t at, GapTriangle corners) {
        const auto [lowest, highest] = std::ranges::minmax(corners);
        const auto& [a, b, c] = corners;
        if (lowest == highest)
            corners = kNoTriangle;
        else if (a == b || b == c || c == a)
            corners = {lowest, lowest, highest};
        else
            std::ranges::rotate(corners, std::ranges::min_element(corners));
        found[at] = corners;
    };
    const auto put_pairs = [&](Index begin, Index end) {
        for (Index pair = begin; pair < end; ++pair) {
            const Index a = source.pairs[to_size(pairs[to_size(pair)].source)];
            const Index b = target.pairs[to_size(pairs[to_size(pair)].target)];
            put(of_both + 2 * to_size(pair), {pair, a, b});
            put(of_both + 2 * to_size(pair) + 1, {pair, b, a});
        }
    };
    const auto put_triangles = [&](Index begin, Index end) {
        for (auto i = to_size(begin); i < to_size(end); ++i) {
            const EndSamples& its = i < of_source ? source : target;
            GapTriangle corners = its.triangles[i < of_source ? i : i - of_source];
            if (!shows_front(its.positions, its.normals, corners))
                std::swap(corners[1], corners[2]);
            for (Index& corner : corners) corner = its.pairs[to_size(corner)];
            put(i, corners);
        }
    };
    constexpr double kPairs = 0.2, kBoth = 0.5;  // share of the time
    parallel_for(to_index(pairs.size()), progress, put_pairs, 0.0, kPairs);
    parallel_for(to_index(of_both), progress, put_triangles, kPairs, kBoth);
    const Progress::Part part(progress, kBoth, 1.0);
    return sorted_once(found, to_index(pairs.size()), progress);
}

Vector3 blend(const Positions& rows, const InsertedPoint& point) {
    Vector3 sum = Vector3::Zero();
    for (std::size_t c = 0; c < 3; ++c)
        sum += point.weights[c] * rows.row(point.pairs[c]).transpose();
    return sum;
}

bool shows_front(const Positions& positions, const Normals& normals, const GapTriangle& corners) {
    const Vector3 faces = facing(positions, corners);
    const auto [a, b, c] = corners;
    if (!(faces.squaredNorm() > 0.0)) return normals.row(a).dot(normals.row(c)) >= 0.0;
    return (normals.row(a) + normals.row(b) + normals.row(c)).dot(faces) >= 0.0;
}

Vector3 gap_triangle_normal(const Positions& positions, const Normals& normals,
                            const InsertedPoint& point) {
    constexpr double kAgreeing = 0.9, kCancelled = 1e-6;
    Vector3 sum = blend(normals, point);
    if (const double length = sum.norm(); length < kAgreeing) {
        const Vector3 faces = facing(positions, point.pairs);
        if (const double area = faces.norm(); area > 0.0)
            sum += (1.0 - length / kAgreeing) / area * faces;
    }
    if (const double length = sum.norm(); length > kCancelled) return sum / length;
    const auto most = std::ranges::max_element(point.weights) - point.weights.begin();
    return normals.row(point.pairs[to_size(most)]).transpose();
}

double edge_length(const Positions& positions, const GapTriangle& corners) {
    double sum = 0.0;
    for (std::size_t c = 0; c < 3; ++c)
        sum += (positions.row(corners[c]) - positions.row(corners[(c + 1) % 3])).squaredNorm();
    return std::sqrt(sum / 3.0);
}

BoundingRectangle::BoundingRectangle(const GapTriangle& triangle, const Positions& positions)
    : corners(triangle), along(0.0), height(0.0) {
    const auto length = [&](std::size_t c) {
        return (positions.row(triangle[(c + 1) % 3]) - positions.row(triangle[c])).squaredNorm();
    };
    std::size_t longest = 0;
    for (std::size_t c = 1; c < 3; ++c)
        if (length(c) > length(longest)) longest = c;
    std::ranges::rotate(corners, corners.begin() + static_cast<std::ptrdiff_t>(longest));
    const Vector3 origin = positions.row(corners[0]).transpose();
    const Vector3 base = positions.row(corners[1]).transpose() - origin;
    const Vector3 apex = positions.row(corners[2]).transpose() - origin;
    width = base.norm();
    if (!(width > 0.0)) return;
    along = apex.dot(base) / width;
    height = (apex - along / width * base).norm();
}

Wideness::Wideness(const Positions& positions, const GapTriangle& corners) {
    for (std::size_t c = 0; c < 3; ++c)
        squares_[c] = (positions.row(corners[(c + 1) % 3]) - positions.row(corners[(c + 2) % 3]))
                          .squaredNorm();
    std::ranges::sort(squares_);
}

bool Wideness::is_more_than(double radius) const {
    const auto [a, b, c] = squares_;
    // No place is farther than in the triangle whose edges are all as long as the longest.
    if (!(c > 3.0 * radius * radius)) return false;
    if (a + b > c) {  // acute: the center of the circle through the corners
        const double area = 2.0 * (a * b + b * c + c * a) - a * a - b * b - c * c;
        return a * b * c > radius * radius * area;
    }
    // Obtuse: on the longest edge, where the middle line of the second longest meets it.
    return b * std::sqrt(c) > radius * (b + c - a);
}

namespace {

/// Triangles side by side, for loops that the compiler vectorizes.
struct SomeTriangles {
    alignas(32) std::array<RoughCorner, kTrianglesAtOnce> first, second, third;
    alignas(32) std::array<std::int32_t, kTrianglesAtOnce> are_narrow;
};

POINTMORPH_INLINE bool is_surely_narrow(const RoughCorner& first, const RoughCorner& second,
                                        const RoughCorner& third, float radius) {
    const auto squared = [](const RoughCorner& from, const RoughCorner& to) {
        const float x = from[0] - to[0], y = from[1] - to[1], z = from[2] - to[2];
        return x * x + y * y + z * z;
    };
    constexpr float kBelow = 1.0F - 1e-6F;
    radius *= kBelow / 3.0F * (first[3] + second[3] + third[3]);
    const float limit = radius * radius;
    const float x = squared(second, third), y = squared(third, first), z = squared(first, second);
    const float low = std::min(x, y), high = std::max(x, y);
    const float a = std::min(low, z), c = std::max(high, z), b = std::min(high, std::max(low, z));
    // No square is off by more: edges, which aren't longer than 3.5 radii, are off by the
    // roughness.
    const float off = 8.0F * kRoughness * radius + 2e-5F * limit + kRoughness * kRoughness;
    // As in Wideness, with room for what all squares may be off. Nobody can foresee how a
    // triangle is shaped, so that it takes longer to choose a test than to do all.
    const float acute = a + b - c;
    const float area = 2.0F * (a * b + b * c + c * a) - a * a - b * b - c * c;
    const float foot = b + c - a - 4.0F * off, longer = b + off;
    const bool is_short = c + off < 3.0F * limit;
    const bool is_acute =
        (acute > 4.0F * off) & (a * b * c + 4.0F * c * c * off < limit * (area - 16.0F * c * off));
    const bool is_obtuse = (acute < -4.0F * off) & (foot > 0.0F) &
                           (longer * longer * (c + off) < kBelow * limit * foot * foot);
    return (c < 12.0F * limit) & (is_short | is_acute | is_obtuse);
}

POINTMORPH_INLINE void look_at_all(SomeTriangles& some, float radius) {
    for (std::size_t i = 0; i < kTrianglesAtOnce; ++i)
        some.are_narrow[i] = is_surely_narrow(some.first[i], some.second[i], some.third[i], radius);
}
POINTMORPH_WIDE void look_at_all_wide(SomeTriangles& some, float radius) {
    look_at_all(some, radius);
}

}  // namespace

std::uint64_t surely_narrow(std::span<const RoughCorner> rough,
                            std::span<const GapTriangle> triangles, float radius, bool wide) {
    SomeTriangles some;
    if (triangles.size() < kTrianglesAtOnce) some.first = some.second = some.third = {};
    for (std::size_t i = 0; i < triangles.size(); ++i) {
        const auto [a, b, c] = triangles[i];
        some.first[i] = rough[to_size(a)];
        some.second[i] = rough[to_size(b)];
        some.third[i] = rough[to_size(c)];
    }
    if (wide && has_wide_registers())
        look_at_all_wide(some, radius);
    else
        look_at_all(some, radius);
    std::uint64_t result = 0;
    for (std::size_t i = 0; i < triangles.size(); ++i)
        result |= static_cast<std::uint64_t>(some.are_narrow[i]) << i;
    return result;
}

namespace {

using NearCorners = std::array<std::int64_t, SomeSamples::kMost>;

/// Some more than there are.
POINTMORPH_INLINE void look_at_samples(const SampledCorners& corners, const SomeSamples& samples,
                                       double radius, NearCorners& near) {
    const auto& [first, second, third] = corners.places;
    const auto& spacing = corners.spacing;
    for (std::size_t i = 0; i < (samples.count + 3) / 4 * 4; ++i) {
        const double b = samples.right[i], c = samples.up[i], a = 1.0 - b - c;
        const double x = a * first[0] + b * second[0] + c * third[0];
        const double y = a * first[1] + b * second[1] + c * third[1];
        const double z = a * first[2] + b * second[2] + c * third[2];
        const double distance = radius * (a * spacing[0] + b * spacing[1] + c * spacing[2]);
        const double limit = distance * distance;
        const auto is_near = [&](const Vector3& corner) {
            const double u = corner[0] - x, v = corner[1] - y, w = corner[2] - z;
            return static_cast<std::int64_t>(u * u + v * v + w * w < limit);
        };
        near[i] = is_near(first) | is_near(second) | is_near(third);
    }
}
POINTMORPH_WIDE void look_at_samples_wide(const SampledCorners& corners, const SomeSamples& samples,
                                          double radius, NearCorners& near) {
    look_at_samples(corners, samples, radius, near);
}

}  // namespace

std::uint64_t near_corners(const SampledCorners& corners, const SomeSamples& samples, double radius,
                           bool wide) {
    alignas(32) NearCorners near;
    if (wide && has_wide_registers())
        look_at_samples_wide(corners, samples, radius, near);
    else
        look_at_samples(corners, samples, radius, near);
    std::uint64_t result = 0;
    for (std::size_t i = 0; i < samples.count; ++i)
        result |= static_cast<std::uint64_t>(near[i]) << i;
    return result;
}

}  // namespace pointmorph

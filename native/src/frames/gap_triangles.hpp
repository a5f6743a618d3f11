// The triangles between pairs in which resampling inserts points. Internal.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/frames/resampling.hpp"
#include "pointmorph/surface/local_triangles.hpp"

namespace pointmorph {

/// Three pairs between which points may be missing, anticlockwise seen from outside, the lowest
/// first; or a line, with the lower pair twice.
using GapTriangle = std::array<Index, 3>;

/// One of the models, by row, in its own unit ball.
struct EndSamples {
    Normalization unit;
    Positions positions;
    Normals normals;
    KdTree<3> tree;
    std::vector<Index> pairs;  ///< the pair that stands for a row
    Values spacing;
    Values density;  ///< k/r², per share of the surface
    double size;     ///< √area, in the cloud's own unit
    Neighborhoods nearest;
    std::vector<Triangle> triangles;

    /// `pairs` stand for the rows of the cloud, of which there are three or more. `known`, unless
    /// it is null, has Resampling::kNeighbors of each, or more.
    EndSamples(const Cloud& cloud, std::vector<Index> pairs, const OrderedNeighbors* known,
               Progress& progress);
    EndSamples(EndSamples&&) = delete;  // the tree refers to the positions
};

/// For each row of the cloud on one `side` of the pairs the pair that stands for it: the one whose
/// partner lies nearest to the mean of the row's partners on the other cloud.
std::vector<Index> standing_for(std::span<const IndexPair> pairs, Index IndexPair::*side,
                                Index IndexPair::*other_side, const Cloud& cloud,
                                const Cloud& other);

/// The triangles of both models, between the pairs that stand for their corners, and those that
/// keep all pairs of a point together. A triangle with opposite orientations on both models is
/// there twice. Ascending.
std::vector<GapTriangle> gap_triangles(const EndSamples& source, const EndSamples& target,
                                       std::span<const IndexPair> pairs, Progress& progress);

/// Weighted mean of `value_of(pair)` over a point's pairs.
template <class ValueOf>
double blend(const InsertedPoint& point, ValueOf&& value_of) {
    double sum = 0.0;
    for (std::size_t c = 0; c < 3; ++c) sum += point.weights[c] * value_of(point.pairs[c]);
    return sum;
}

/// Weighted mean of the rows of a point's pairs.
Vector3 blend(const Positions& rows, const InsertedPoint& point);

/// Whether a triangle shows its front where its corners do. One that doesn't is folded over, or
/// leads through the inside of a shape: filled, it would show its back face. A line has no front:
/// its ends must agree.
bool shows_front(const Positions& positions, const Normals& normals, const GapTriangle& corners);

/// The corners' mean normal at a point; the less they agree, the more the triangle's own counts.
Vector3 gap_triangle_normal(const Positions& positions, const Normals& normals,
                            const InsertedPoint& point);

/// Root of the mean squared length of a triangle's edges.
double edge_length(const Positions& positions, const GapTriangle& corners);

/// How far the place of a triangle that is farthest from all corners is from them.
class Wideness {
public:
    Wideness(const Positions& positions, const GapTriangle& corners);

    bool is_more_than(double radius) const;

private:
    std::array<double, 3> squares_;  ///< of edges, ascending
};

/// A place in the unit ball, and the spacing there: all that is needed to see that most triangles
/// are narrow, at a quarter of the memory traffic.
using RoughCorner = std::array<float, 4>;
/// By how much two rough places may seem farther apart, or nearer, than they are.
constexpr float kRoughness = 2e-7F;

/// So many triangles are looked at side by side.
constexpr std::size_t kTrianglesAtOnce = 64;
/// Which of some triangles surely are no wider than `radius` mean spacings of their corners: then
/// Wideness::is_more_than() of that is false. The lowest bit tells it of the first. Where it isn't
/// sure, Wideness has to be asked. There are kTrianglesAtOnce or fewer; `wide`: in wide registers,
/// with the same result.
std::uint64_t surely_narrow(std::span<const RoughCorner> rough,
                            std::span<const GapTriangle> triangles, float radius, bool wide = true);

/// How far apart samples lie.
struct SampleDistance {
    double step;           ///< no more than that, but for sides that would have too many
    double coarser = 1.0;  ///< of so many along a side, one

    double samples_along(double side) const {
        constexpr double kMost = 256.0;
        return std::max(1.0, std::floor(std::clamp(std::ceil(side / step), 1.0, kMost) / coarser));
    }
};

/// A triangle's bounding rectangle in its plane, above its longest edge.
struct BoundingRectangle {
    GapTriangle corners;  ///< the first two at the ends of the longest edge
    double width;         ///< 0 where all corners lie at one place
    double along;         ///< from the first corner to below the third, 0 to width
    double height;

    BoundingRectangle(const GapTriangle& triangle, const Positions& positions);

    double samples(const SampleDistance& distance) const {
        return distance.samples_along(width) * distance.samples_along(height);
    }
};

/// Some samples of a triangle, one after another.
struct SomeSamples {
    static constexpr std::size_t kMost = 64;

    GapTriangle corners;  ///< as BoundingRectangle has them
    std::size_t count = 0;
    alignas(32) std::array<double, kMost> right{}, up{};  ///< weights of the second and third

    InsertedPoint operator[](std::size_t i) const {
        return {corners, {1.0 - right[i] - up[i], right[i], up[i]}, {}};
    }
    void add(double to_right, double upward, bool is_inside) {
        right[count] = to_right;
        up[count] = upward;
        count += is_inside;
    }
};

/// Where the corners of samples are, and what they have to be multiplied with.
struct SampledCorners {
    std::array<Vector3, 3> places;
    std::array<double, 3> spacing;
};

/// Which samples lie closer to one of their corners than `radius` times the spacing there. The
/// lowest bit tells it of the first. `wide`: in wide registers, with the same result.
std::uint64_t near_corners(const SampledCorners& corners, const SomeSamples& samples, double radius,
                           bool wide = true);

/// Calls `take(samples)` with uniform samples of a triangle's bounding rectangle, those inside,
/// some at a time, until it returns false.
template <class Take>
void each_few_samples(const GapTriangle& triangle, const Positions& positions,
                      const SampleDistance& distance, Take&& take) {
    const BoundingRectangle box(triangle, positions);
    if (!(box.width > 0.0)) return;
    const double columns = distance.samples_along(box.width);
    const double rows = distance.samples_along(box.height);
    SomeSamples samples{box.corners};
    for (double j = 0.5; j < rows; ++j) {
        const double up = box.height > 0.0 ? j / rows : 0.0;
        const double left = up * box.along / box.width;
        for (double i = 0.5; i < columns; ++i) {
            const double right = i / columns - left;
            samples.add(right, up, !(right < 0.0) & !(right + up > 1.0));
            if (samples.count < SomeSamples::kMost) continue;
            if (!take(samples)) return;
            samples.count = 0;
        }
    }
    if (samples.count > 0) take(samples);
}

}  // namespace pointmorph

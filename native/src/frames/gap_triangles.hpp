// The triangles between pairs in which resampling inserts points. Internal.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

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

    /// `pairs` stand for the rows of the cloud, of which there are three or more.
    EndSamples(const Cloud& cloud, std::vector<Index> pairs, Progress& progress);
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
                                       std::span<const IndexPair> pairs);

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

/// Whether some place of a triangle is farther than `radius` from all corners.
bool is_wider(const Positions& positions, const GapTriangle& corners, double radius);

/// Calls `take(point)` at uniform samples of a triangle's bounding rectangle in its plane, those
/// inside, no more than `step` apart, until it returns false.
template <class Take>
void each_sample(GapTriangle corners, const Positions& positions, double step, Take&& take) {
    constexpr double kMostSteps = 256.0;  // along either side of the rectangle
    // The longest edge first: the rectangle's base.
    const auto length = [&](std::size_t c) {
        return (positions.row(corners[(c + 1) % 3]) - positions.row(corners[c])).squaredNorm();
    };
    std::size_t longest = 0;
    for (std::size_t c = 1; c < 3; ++c)
        if (length(c) > length(longest)) longest = c;
    std::ranges::rotate(corners, corners.begin() + static_cast<std::ptrdiff_t>(longest));
    const Vector3 origin = positions.row(corners[0]).transpose();
    const Vector3 base = positions.row(corners[1]).transpose() - origin;
    const Vector3 apex = positions.row(corners[2]).transpose() - origin;
    const double width = base.norm();
    if (!(width > 0.0)) return;
    const double along = apex.dot(base) / width;  // 0 to width, the base being the longest
    const double height = (apex - along / width * base).norm();

    const auto count = [&](double side) {
        return std::clamp(std::ceil(side / step), 1.0, kMostSteps);
    };
    const double columns = count(width), rows = count(height);
    InsertedPoint point{corners, {}, {}};
    for (double j = 0.5; j < rows; ++j) {
        const double up = height > 0.0 ? j / rows : 0.0;
        for (double i = 0.5; i < columns; ++i) {
            const double right = i / columns - up * along / width;
            if (right < 0.0 || right + up > 1.0) continue;
            point.weights = {1.0 - right - up, right, up};
            if (!take(point)) return;
        }
    }
}

}  // namespace pointmorph

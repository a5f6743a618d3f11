// Stage `closest_point`: the point of some triangles that lies nearest to a place.
#pragma once

#include <array>
#include <limits>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

/// A point of a surface of triangles.
struct SurfacePoint {
    Index triangle = -1;       ///< −1: none
    Vector3 weights{0, 0, 0};  ///< of the triangle's corners, ≥ 0, sum 1
    double squared_distance = std::numeric_limits<double>::infinity();
};

/// Where a point of a surface is when the triangles' corners are rows of `positions`.
inline Vector3 place_of(const SurfacePoint& point, const Triangles& triangles,
                        const Positions& positions) {
    const auto corners = triangles.row(point.triangle);
    return point.weights[0] * positions.row(corners[0]).transpose() +
           point.weights[1] * positions.row(corners[1]).transpose() +
           point.weights[2] * positions.row(corners[2]).transpose();
}

/// The point of the triangle a b c nearest to p (Ericson, Real-Time Collision Detection, 5.1.5).
SurfacePoint closest_on_triangle(const Vector3& p, const Vector3& a, const Vector3& b,
                                 const Vector3& c);

/// A tree of boxes over triangles. Queries are const and may run in parallel.
class TriangleTree {
public:
    /// Keeps references to both, which must outlive it; the corners of `triangles` are rows of
    /// `positions`.
    TriangleTree(const Positions& positions, const Triangles& triangles, Progress& progress);
    TriangleTree(const Positions&, Triangles&&, Progress&) = delete;
    TriangleTree(Positions&&, const Triangles&, Progress&) = delete;

    /// The same triangles with their corners elsewhere; of these it keeps a reference. To be called
    /// as well once positions have changed where they are.
    void move(const Positions& positions, Progress& progress);
    void move(Positions&&, Progress&) = delete;

    /// The nearest point that is nearer than `within` (plain distance), on the lowest of several
    /// triangles. `guess` is a triangle that may be near, or −1: the result is the same, but for
    /// which triangle of several is taken, and sooner found.
    SurfacePoint closest(const Vector3& place,
                         double within = std::numeric_limits<double>::infinity(),
                         Index guess = -1) const;

private:
    struct Box {
        Vector3 low = Vector3::Zero(), high = Vector3::Zero();

        double squared_distance(const Vector3& p) const {
            return (low - p).cwiseMax(p - high).cwiseMax(0.0).squaredNorm();
        }
    };

    /// Of a subtree: where it is rooted, and which triangles it holds.
    struct Branch {
        Index node;
        Index begin, end;  ///< in `order_`
    };
    void split(const Branch& branch, const Positions& middles);
    std::array<Branch, 2> halved(const Branch& branch, const Positions& middles);
    Box box_of(Index begin, Index end) const;
    SurfacePoint on(Index triangle, const Vector3& place) const;

    const Triangles* triangles_;
    const Positions* positions_;
    std::vector<Index> order_;  ///< triangles, leaf by leaf
    /// Children of a node come after it: the left one next to it, the right one after all of the
    /// left one's.
    struct Node {
        Box box;
        Index begin, end;  ///< in `order_`
        Index right;       ///< −1 for a leaf
        Index lowest;      ///< of its triangles
    };
    std::vector<Node> nodes_;
};

}  // namespace pointmorph

// Delaunay stars of points in their tangent planes: a surface's triangles around one of them. Not
// for callers of the library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Neighbors whose normals' product is below this lie on the other side of a thin part.
inline constexpr double kOpposed = -0.2;

/// A neighbor in a Delaunay star, and the gap between it and the next one anticlockwise.
struct Spoke {
    Index neighbor;
    double radius;  ///< of the empty disc that touches point and both; infinite if there is none
    bool outside = false;
};

/// Delaunay stars of single points in their tangent planes. Holds scratch memory: one a thread.
class StarBuilder {
public:
    StarBuilder(const Positions& positions, const Normals& normals)
        : positions_(positions), normals_(normals) {}

    /// The star of point i among `rows`, which are ascending by distance. Returns true if no point
    /// farther away than all of them can change it.
    ///
    /// The Voronoi cell of i is cut out of a square by one bisector after the other. Its corners
    /// are the centers of the empty discs, and a neighbor more than twice as far as the farthest
    /// corner can't cut it.
    bool build(Index i, std::span<const Index> rows);

    /// Whether some of `rows`, which are ascending by distance, lie around point i so closely that
    /// largest_radius() is below `factor` times spacing(), whatever other points there are. No
    /// proof of the contrary, but many times as quick as the star.
    bool is_surrounded(Index i, std::span<const Index> rows, double factor);

    /// Adds points farther away, again ascending by distance.
    bool extend(std::span<const Index> rows);

    /// The squared distance from which on no neighbor changes the star.
    double squared_reach() const { return reach_; }

    /// Anticlockwise seen from outside; valid until the next star is built.
    std::span<const Spoke> spokes();

    /// Length of the third shortest spoke (the longest of fewer; 0 without any): the spacing
    /// around the point, also where points stand in rows, or spokes reach across a hole.
    double spacing() const;

    /// Radius of the largest empty disc that touches the point; infinite on the cloud's hull.
    double largest_radius() const;

private:
    struct Corner {
        double x, y;
        Index row;  ///< whose bisector leads from this corner to the next; −1 for the square
        double squared = 0.0;  ///< distance of that row
    };

    void look_at(Index i);
    /// The direction as seen in the tangent plane, the distance as in space: the surface, unrolled.
    /// False for a point that tells nothing: right above or below, at the same place, or on the
    /// other side.
    bool unroll(Index j, double& x, double& y, double& squared) const;
    void cut(double x, double y, double squared, Index row);

    const Positions& positions_;
    const Normals& normals_;
    std::vector<Corner> cell_, cut_;
    std::vector<double> beyond_;  ///< how far each corner lies beyond a bisector
    std::vector<Spoke> spokes_;
    Vector3 point_, normal_, u_, v_;
    double reach_ = 0.0;
};

}  // namespace pointmorph

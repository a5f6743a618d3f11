// Stage `geodesics`: smooth shortest curves on a cloud (paper, Morphing of Complex Models).
//
// A path in the surface graph says which way round the curve goes; its points are then drawn
// straight on the surface, each halfway between its neighbors and put back onto the samples'
// surface (curve shortening), which takes the graph's zig-zags out.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

/// A polygon on the surface; open unless stated otherwise.
struct SurfaceCurve {
    Positions points;  ///< #points by 3, in order
    Normals normals;   ///< of the surface there

    Index size() const { return to_index(points.rows()); }
};

/// Length of the open polygon.
double curve_length(const Positions& points);

/// Whether the edges from a to b and from c to d cross, seen along `normal` (unit length). Edges
/// that only touch don't cross.
bool edges_cross(const Eigen::RowVector3d& a, const Eigen::RowVector3d& b,
                 const Eigen::RowVector3d& c, const Eigen::RowVector3d& d, const Vector3& normal);

/// The path with the least sum of edge length × mean of `costs` at both ends (Dijkstra 1959): rows
/// from `from` to `to`, both included. `costs`, one a point, are > 0; empty: the shortest path. The
/// graph is connected.
std::vector<Index> cheapest_path(const SurfaceGraph& graph, Index from, Index to,
                                 const Values& costs);

/// Points about `spacing` apart along the open polygon; its ends stay. Normals are interpolated.
SurfaceCurve resampled(const SurfaceCurve& curve, double spacing);

/// Every point projected onto the surface (see project_onto_surface()), with the normal there. The
/// ends stay where they are.
SurfaceCurve on_surface(SurfaceCurve curve, const KdTree<3>& surface, const Normals& normals,
                        Progress& progress);

/// `rounds` times, every point moves to the middle of its neighbors, or `relaxation` times as far
/// (1 to 2: more where there are many rounds), and is projected back onto the surface. The ends
/// stay. Points start about evenly spaced; none moves to more than twice that spacing from a
/// neighbor.
SurfaceCurve straightened(SurfaceCurve curve, const KdTree<3>& surface, const Normals& normals,
                          Index rounds, double relaxation, Progress& progress);

/// The shortest curve on the surface near a path from sample to sample (see cheapest_path()), with
/// points about `spacing` (> 0) apart: the path, straightened until it gets no shorter. Length
/// errors: see docs/stages/surface/geodesics.md.
SurfaceCurve geodesic(const KdTree<3>& surface, const Normals& normals, std::span<const Index> path,
                      double spacing, Progress& progress);

/// Curves joined end to end.
struct ClosedCurve {
    SurfaceCurve curve;          ///< closed: the first point follows the last
    std::vector<Index> corners;  ///< where each part begins, ascending from 0
};

/// Each of the `parts` ends where the next one begins, the last where the first does.
ClosedCurve closed_curve(std::span<const SurfaceCurve> parts);

}  // namespace pointmorph

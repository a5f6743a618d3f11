// Stage `geodesics`: smooth shortest curves on a cloud (paper, Morphing of Complex Models).
//
// A path in the surface graph says which way round the curve goes; its points are then drawn
// straight on the surface, each halfway between its neighbours and put back onto the samples'
// surface (curve shortening), which takes the graph's zig-zags out.
#pragma once

#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

/// A polygon on the surface, open unless said otherwise.
struct SurfaceCurve {
    Positions points;  ///< #points by 3, in order
    Normals normals;   ///< of the surface there

    Index size() const { return static_cast<Index>(points.rows()); }
};

/// Length of the open polygon.
double curve_length(const Positions& points);

/// Whether the edges from a to b and from c to d cross, seen along `normal`, which has unit length;
/// touching isn't crossing.
bool edges_cross(const Eigen::RowVector3d& a, const Eigen::RowVector3d& b,
                 const Eigen::RowVector3d& c, const Eigen::RowVector3d& d, const Vector3& normal);

/// The path with the least sum of edge length × mean of `costs` at both ends (Dijkstra 1959): rows
/// from `from` to `to`, both included. `costs`, one a point, are > 0; none given: the shortest
/// path. The graph is connected.
std::vector<Index> cheapest_path(const SurfaceGraph& graph, Index from, Index to,
                                 const Values& costs);

/// Points about `spacing` apart along the open polygon; its ends stay. Normals are interpolated.
SurfaceCurve resampled(const SurfaceCurve& curve, double spacing);

/// Every point put onto the surface that the samples on its side span (see landed()), with the
/// normal there. The ends stay where they are.
SurfaceCurve on_surface(SurfaceCurve curve, const KdTree<3>& surface, const Normals& normals,
                        Progress& progress);

/// `rounds` times: every point moves to the middle of its neighbours, or `relaxation` times as far
/// (1 to 2, for many rounds), and back onto the surface; the ends stay. Points are about evenly
/// spaced at first; none moves off to more than twice that distance from its neighbours.
SurfaceCurve straightened(SurfaceCurve curve, const KdTree<3>& surface, const Normals& normals,
                          Index rounds, double relaxation, Progress& progress);

/// The shortest curve on the surface from one sample to another, points about `spacing` (> 0)
/// apart: the graph's shortest path, straightened until it doesn't get shorter. `graph` joins the
/// samples of `surface`. Length errors: see docs/stages/geodesics.md.
SurfaceCurve geodesic(const KdTree<3>& surface, const Normals& normals, const SurfaceGraph& graph,
                      Index from, Index to, double spacing, Progress& progress);

}  // namespace pointmorph

// First guesses at the places of a shape of genus 0 on the sphere. Internal.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/sphere/spherical_parameterization.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

/// Nodes whose cells touch. The weight of an edge is the length of the cells' common border,
/// counted in neighbors across it, over the nodes' distance: about that of a Delaunay
/// triangulation, and always positive.
struct CellGraph {
    SurfaceGraph graph;
    std::vector<double> weights;  ///< of `graph.neighbors`
};

/// `cells[i]` is the row of point i's node in `nodes`, or −1; `nearest` is ascending by distance.
CellGraph cell_graph(const Neighborhoods& nearest, const Normals& normals,
                     std::span<const Index> cells, const Positions& nodes);

/// Calls `visit` with guesses at the nodes' places on the unit sphere, until it returns false:
/// neighbors next to each other, though some may be on the wrong side of others. First the
/// directions from the middle of the shape. Then: one node, the middle of the shape, is left out;
/// its neighbors go onto a circle, all others to the weighted mean of their neighbors (Tutte 1963),
/// and from the plane onto the sphere. Limbs, which this shrinks to specks, are opened round by
/// round: edges are loosened where the map has shrunk (after Yoshizawa, Belyaev, Seidel 2004). Some
/// of the rounds are guesses.
void each_first_sphere(const CellGraph& cells, const Positions& nodes, const Normals& normals,
                       const SphericalOptions& options,
                       const std::function<bool(const Positions&)>& visit, Progress& progress);

}  // namespace pointmorph

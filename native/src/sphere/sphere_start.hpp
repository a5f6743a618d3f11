// A first guess at where a shape of genus 0 lies on the sphere; not for callers of the library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/sphere/spherical_parameterization.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

/// Nodes whose cells touch. The weight of an edge is the length of the border, measured by the
/// neighbours that lie on either side of it, over the nodes' distance: that of a Delaunay
/// triangulation, about, and always positive.
struct CellGraph {
    SurfaceGraph graph;
    std::vector<double> weights;  ///< of `graph.neighbors`
};

/// `cells[i]` is the place of point i's node in `nodes`, or −1; `nearest` is ascending by distance.
CellGraph cell_graph(const Neighborhoods& nearest, const Normals& normals,
                     std::span<const Index> cells, const Positions& nodes);

/// Guesses at where the nodes lie on the unit sphere: neighbours next to each other, though some
/// may be on the wrong side of others. All but one node in the middle of the shape go into the
/// plane, its neighbours onto a circle, the others to the weighted mean of theirs (Tutte), and from
/// there onto the sphere. Limbs, which come out as specks, are opened round by round: edges are
/// loosened where the map has shrunk (after Yoshizawa, Belyaev, Seidel 2004). The guesses are the
/// directions from the middle, and what comes of some of the rounds.
std::vector<Positions> first_spheres(const CellGraph& cells, const Positions& nodes,
                                     const Normals& normals, const SphericalOptions& options,
                                     Progress& progress);

}  // namespace pointmorph

// Stage `spherical_parameterization`: a closed shape of genus 0 onto the unit sphere, without a cut
// (the paper's future work).
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/surface/local_triangles.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

struct SphericalOptions {
    /// About so many of the points, but no more than a fifth of them, are triangulated and laid
    /// onto the sphere; 100 or more.
    Index nodes = 1500;
    /// Rounds in which what the first map has shrunk is opened, and how much in each: the power of
    /// its squared scale by which its edges are loosened.
    Index opening_rounds = 20;
    double opening = 0.25;
    /// Share of the points that may lie in parts of their own; these go with what is nearest.
    double largest_loose_share = 0.15;
    /// Share of the surface on which the triangles may contradict the normals.
    double largest_wrong_share = 0.09;
};

/// Some points of a cloud, triangulated as a closed surface of genus 0, and where they lie on the
/// unit sphere. No triangle is turned over there.
struct SphericalMesh {
    std::vector<Index> rows;  ///< of the cloud; those required first, in their order
    Positions positions;
    Normals normals;
    std::vector<Triangle> triangles;  ///< places in `rows`, anticlockwise seen from outside
    Positions images;                 ///< unit length
    SurfaceGraph graph;               ///< of nodes whose surroundings touch, lengths in √area
    Index loose = 0;                  ///< points of the cloud that aren't on the largest part

    Index size() const { return static_cast<Index>(rows.size()); }
};

/// `normals` are unit length and point outwards; `nearest` joins the cloud; `required` rows, none
/// twice, are among the nodes; `name` is the cloud's, for errors. Throws TopologyError where the
/// shape isn't closed, of genus 0 and in one piece, or its normals point inwards.
SphericalMesh spherical_mesh(const KdTree<3>& tree, const Normals& normals,
                             const Neighborhoods& nearest, std::span<const Index> required,
                             const SphericalOptions& options, const std::string& name,
                             Progress& progress);

/// Where points on the shape lie on the sphere: in the triangle that is nearest and faces as they
/// do. #points by 3.
Positions onto_sphere(const SphericalMesh& mesh, const Positions& points, const Normals& normals,
                      Progress& progress);

/// Share of the triangles that are turned over on the sphere.
double turned_over(std::span<const Triangle> triangles, const Positions& images);

}  // namespace pointmorph

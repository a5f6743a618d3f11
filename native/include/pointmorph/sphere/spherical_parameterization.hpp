// Stage `spherical_parameterization`: a closed shape of genus 0 onto the unit sphere, without a cut
// (future work in the paper).
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/surface/local_triangles.hpp"
#include "pointmorph/surface/sampled_surface.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

struct SphericalOptions {
    /// How many points are triangulated and placed on the sphere, about; 100 or more, and never
    /// more than a fifth of all.
    Index nodes = 1500;
    /// Rounds in which parts that the first map has shrunk are opened, and how much in each: the
    /// power of the squared scale by which edges are loosened; 0 or more.
    Index opening_rounds = 20;
    double opening = 0.25;
    /// Largest share of the points that may lie outside the largest component, 0 to 1. They go
    /// where the nearest part of it goes.
    double largest_loose_share = 0.15;
    /// Largest share of the surface on which triangles may contradict the normals; 0 to 1.
    double largest_wrong_share = 0.09;
};

/// Some points of a cloud, triangulated as a closed surface of genus 0, and their places on the
/// unit sphere, where no triangle is turned over.
struct SphericalMesh {
    std::vector<Index> rows;  ///< of the cloud; the required ones first, in their order
    Positions positions;
    Normals normals;
    std::vector<Triangle> triangles;  ///< indices into `rows`, anticlockwise seen from outside
    Positions images;                 ///< unit length
    SurfaceGraph graph;               ///< of nodes whose cells touch, lengths in √area
    Index loose = 0;                  ///< points of the cloud outside the largest component

    Index size() const { return to_index(rows.size()); }
};

/// The surface's normals point outward. The `required` rows, none twice, are among the nodes.
/// Throws TopologyError where the shape isn't closed, of genus 0 and connected, or its normals
/// point inward. `tree`, where it is known, is that of the surface's positions.
SphericalMesh spherical_mesh(const SampledSurface& surface, std::span<const Index> required,
                             const SphericalOptions& options, Progress& progress,
                             const KdTree<3>* tree = nullptr);

/// Where a point lies in a mesh: on the shape, or on the sphere.
struct PlaceInMesh {
    Index triangle;
    Vector3 shares;  ///< of its corners; sum 1
};

/// Finds where points on a shape lie in its mesh: the nearest triangle that faces the same way, and
/// the place in it. Keeps a reference, and doesn't look at the images.
class MeshPlaces {
public:
    explicit MeshPlaces(const SphericalMesh& mesh);
    ~MeshPlaces();

    /// Of the points from `begin` to `end`, into the same rows of `places`. May be called by
    /// several threads at once.
    void find(const Positions& points, const Normals& normals, Index begin, Index end,
              std::span<PlaceInMesh> places, Progress& progress) const;

private:
    struct Parts;
    std::unique_ptr<const Parts> parts_;
};

/// The places on the sphere of points whose places in the mesh are known. #points by 3.
Positions onto_sphere(const SphericalMesh& mesh, std::span<const PlaceInMesh> places);

/// The same of points on the shape.
Positions onto_sphere(const SphericalMesh& mesh, const Positions& points, const Normals& normals,
                      Progress& progress);

/// Share of the triangles that are turned over on the sphere.
double turned_over(std::span<const Triangle> triangles, const Positions& images);

}  // namespace pointmorph

// Points near a sphere as a closed triangulation that follows the shape they come from; not for
// callers of the library.
#pragma once

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "sphere/ring_mesh.hpp"

namespace pointmorph {

/// The convex hull of points on the unit sphere (Delaunay, by insertion and flips), whatever the
/// rounding a closed surface of genus 0.
RingMesh hull_on_sphere(const Positions& sphere);

/// Replaces edges, so that triangles of the shape itself, whose points are `positions`, are well
/// shaped and face as the normals do.
void flip_to_shape(RingMesh& mesh, const Positions& positions, const Normals& normals,
                   Progress& progress);

}  // namespace pointmorph

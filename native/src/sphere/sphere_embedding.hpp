// A closed triangulated surface of genus 0 onto the unit sphere with no triangle turned over; not
// for callers of the library.
#pragma once

#include <span>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/surface/local_triangles.hpp"
#include "sphere/ring_mesh.hpp"

namespace pointmorph {

/// How far the images of triangles on the sphere are from equilateral ones of the area that they
/// should have, all the same: the sum of the Dirichlet energy E of each (of a map from such a
/// triangle) times 1 + 1/D², where D is the determinant of the corners over twice the area.
/// Infinite as a triangle turns over, which the area between corners, seen through the center,
/// wouldn't tell. Least is 4 · area for each.
class Roundness {
public:
    /// `weight` is a factor of the energy. Keeps the span.
    Roundness(std::span<const Triangle> triangles, double weight);

    double at(const Positions& places) const;
    /// Where the energy is finite.
    void add_gradient(const Positions& places, Positions& gradient) const;

private:
    /// Coordinates of a few triangles, by columns, so that loops over them use wide registers.
    struct Block;
    std::size_t fill(Block& block, const Positions& places, std::size_t first) const;

    std::span<const Triangle> triangles_;
    double weight_;
    double area_;  ///< that each should have
};

/// Places of the vertices of `mesh`, all of which have a ring. Vertices are taken away one by one
/// until four are left, which lie on a tetrahedron, and come back one by one into the part of
/// their ring that sees all of it, while the places around and then all are improved by the energy
/// above, all triangles of one area (Shen, Jiang, Zorin, Panozzo 2019; Praun and Hoppe 2003).
/// `positions` are those of the shape: the closest vertices go first.
Positions embed_on_sphere(RingMesh mesh, const Positions& positions, Progress& progress);

}  // namespace pointmorph

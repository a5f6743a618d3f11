// A closed triangulated surface of genus 0 onto the unit sphere with no triangle turned over; not
// for callers of the library.
#pragma once

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "sphere/ring_mesh.hpp"

namespace pointmorph {

/// How far the image of a triangle on the sphere is from an equilateral one of the area that it
/// should have: its Dirichlet energy E (of a map from such a triangle) times 1 + 1/D², where
/// D is the determinant of the corners over twice the area. Infinite as the triangle turns over,
/// which the area between corners, seen through the center, wouldn't tell. Least is 4 · area.
double sphere_energy(const Vector3& a, const Vector3& b, const Vector3& c, double area);
/// A column a corner.
Matrix3 sphere_energy_gradient(const Vector3& a, const Vector3& b, const Vector3& c, double area);

/// Places of the vertices of `mesh`, all of which have a ring. Vertices are taken away one by one
/// until four are left, which lie on a tetrahedron, and come back one by one into the part of
/// their ring that sees all of it, while the places around and then all are improved by the energy
/// above, all triangles of one area (Shen, Jiang, Zorin, Panozzo 2019; Praun and Hoppe 2003).
/// `positions` are those of the shape: the closest vertices go first.
Positions embed_on_sphere(RingMesh mesh, const Positions& positions, Progress& progress);

}  // namespace pointmorph

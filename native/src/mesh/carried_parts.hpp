// Parts of a mesh that go along with what is around them. Not for callers of the library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/mesh/closest_point.hpp"
#include "pointmorph/mesh/mesh.hpp"
#include "pointmorph/mesh/wrapping.hpp"

namespace pointmorph {

/// Small parts of a mesh for which the target has nothing, as eyeballs and teeth where it is one
/// skin: those that would lie on the part of the target that a larger part of the mesh lies on as
/// well, and to which the inverse map takes far less of the target than their share. Laid onto the
/// target's skin, they would be flattened and folded. Ascending; none that has marks or is held.
/// `target_parts` says which part of the target each part keeps to, `on_mesh` where the target's
/// samples lie on the mesh.
std::vector<Index> parts_without_counterpart(const Mesh& mesh, std::span<const Index> target_parts,
                                             std::span<const SurfacePoint> on_mesh,
                                             const WrapHolds& holds);

/// The mesh without some parts: their places stay, without triangles. What lies on them in
/// `on_mesh` is put onto the nearest triangle of the others.
Mesh without_parts(const Mesh& mesh, std::span<const Index> parts,
                   std::vector<SurfacePoint>& on_mesh, Progress& progress);

/// Puts parts where the places around them at rest go, which end at `x`: each by the similarity
/// that suits most of these best. `rest` is the mesh without these parts.
void carry_parts(const Mesh& mesh, const Mesh& rest, std::span<const Index> parts, Positions& x,
                 Progress& progress);

/// Moves parts inward, each as a whole, until nothing of them is outside of `surface`, which is
/// closed: so that they don't show where it has nothing for them.
void sink_parts(const Mesh& mesh, std::span<const Index> parts, const Mesh& surface, Positions& x,
                Progress& progress);

}  // namespace pointmorph

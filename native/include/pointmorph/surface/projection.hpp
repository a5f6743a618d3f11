// Stage `projection`: images that lie near another cloud's surface, moved onto it.
#pragma once

#include <span>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// Projects every image onto the surface that the samples around `anchors[i]` span, those on the
/// anchor's side of it only: halfway between the plane through their weighted mean across their
/// weighted normal (Adamson and Alexa 2003) and the weighted mean of their own tangent planes,
/// whose errors on a curved surface are opposite. Where that lies outside of the samples' convex
/// hull in the plane, over the edge of an open patch, the nearest point of the hull is taken.
/// #images by 3. `anchors` are rows of `surface`, one an image; `normals` has #surface unit rows.
/// `nearest`, where they are known, are the neighborhoods of the samples, ascending by distance.
Positions project_onto_surface(const Positions& images, std::span<const Index> anchors,
                               const KdTree<3>& surface, const Normals& normals, Progress& progress,
                               const Neighborhoods* nearest = nullptr);

}  // namespace pointmorph

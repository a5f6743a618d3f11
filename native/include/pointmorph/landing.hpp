// Stage `landing`: images that lie near another cloud's surface, put onto it.
#pragma once

#include <span>

#include "pointmorph/kd_tree.hpp"
#include "pointmorph/progress.hpp"
#include "pointmorph/types.hpp"

namespace pointmorph {

/// Projects every image onto the surface that the samples around `anchors[i]` span: the plane
/// through their weighted mean across their weighted normal, with weights that fall with the
/// distance from the image (the implicit surface of Adamson and Alexa 2003), of samples on the
/// anchor's side of the surface only. Where that lies outside of the samples' convex hull in the
/// plane, over the edge of an open patch, the nearest point of the hull is taken. #images by 3.
/// `anchors` are rows of `surface`, one an image; `normals` has #surface unit rows.
Positions landed(const Positions& images, std::span<const Index> anchors, const KdTree<3>& surface,
                 const Normals& normals, Progress& progress);

}  // namespace pointmorph

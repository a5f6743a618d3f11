// Where a map turns the surface over, its images are moved until it no longer does. Not for callers
// of the library.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// A cloud whose points are mapped, or onto which they are. Refers to all of it.
struct UnfoldingCloud {
    const KdTree<3>& tree;
    const Normals& normals;                  ///< of unit length
    const Neighborhoods* nearest = nullptr;  ///< ascending by distance, where they are known
};

/// Images on the surface of `there`, a row for each point of `here`, which they were landed on at
/// the side of the surface of `anchors`, rows of `there`.
struct LandedImages {
    Positions positions;
    std::vector<Index> anchors;
};

/// Looks for points where the images of the nearest points on their side of the surface show the
/// back of `there`, and moves these and what is around them to where their neighbors' images, by
/// an affine map, say that they belong, onto the surface of `there` again. A group of points is
/// moved only where fewer are turned over then and nothing is stretched more than it was. Points
/// that are `held` stay. Returns the rows that have been moved, ascending. Where much is turned
/// over, the map is mirrored or worse, and nothing is moved.
std::vector<Index> unfold(LandedImages& images, const UnfoldingCloud& here,
                          const UnfoldingCloud& there, std::span<const std::uint8_t> held,
                          double normal_weight, Progress& progress);

}  // namespace pointmorph

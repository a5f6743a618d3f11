// Half turns of long thin shapes about their own length, however they are bent: what is a snake's
// belly and what its back is hard to tell. Not for callers of the library.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/pose.hpp"

namespace pointmorph {

/// Half turns about the axis of a shape.
struct Rolls {
    std::vector<Similarity> turns;  ///< of each point, about the axis next to it
    Values lengths;                 ///< how far along the surface each point lies from one end
    double thickness;               ///< how far points lie off the axis, in the mean
};

/// None where the shape, from end to end along its surface, is less than twenty times as long as
/// its points lie off its axis, in the mean; where it is of several pieces; and where its points
/// are too few to tell. Long bodies with short legs and flat strips have some: whether a roll fits
/// them is for its cost to say. `along` are node_distances() of the shape.
std::optional<Rolls> half_rolls(const CoarseShape& shape, const Eigen::MatrixXd& along);

/// The turns, but none of the points around marks that a half turn would take elsewhere. Marks tell
/// the roll only near them: further on, a shape may still be twisted. Features are coarse rows of
/// the shape; curves and regions are its guides and labels.
std::vector<Similarity> untold_turns(const Rolls& rolls, const CoarseShape& shape,
                                     std::span<const Index> features);

/// The map before which every point of the source has made its turn. Its misfit is that of `map`.
/// Of `target`, only its nodes count.
Candidate followed_by_turns(const Candidate& map, const CoarseShape& source,
                            const CoarseShape& target, std::span<const Similarity> turns);

}  // namespace pointmorph

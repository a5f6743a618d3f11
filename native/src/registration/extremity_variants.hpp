// Other ways in which the extremities of two shapes may belong together. Not for callers of the
// library.
#pragma once

#include <vector>

#include "pointmorph/base/types.hpp"
#include "registration/pose_trials.hpp"

namespace pointmorph {

/// Extremities that a map brings together.
ExtremityMatches matches_under(const PoseSearch& search, const Trial& trial);

/// Along the source and along the target; rows and columns are places in the lists of extremities.
NodeDistances distances_between_extremities(const PoseSearch& search);

/// Ways in which the extremities may belong together, the likeliest first: as the map has them, and
/// changed a little; see changed_pairings().
std::vector<ExtremityMatches> extremity_variants(const PoseSearch& search, const Trial& trial);

/// Pairings that differ little from `now` (places in lists of `sources` and `targets` extremities):
/// with a pair more or less, with one extremity exchanged for one left alone, with two swapped, and
/// with three exchanged in turn, as nose and ears where a head was turned. Each once, sorted.
std::vector<ExtremityMatches> changed_pairings(const ExtremityMatches& now, Index sources,
                                               Index targets);

/// Up to `count` likely pairings in which two pairs of `now` or more have swapped their targets, as
/// both hands and both feet where a person is seen from behind: the two swaps after which distances
/// along both shapes contradict each other least, wherever the map of `now` has taken them, and
/// further ones while these lessen that. The likeliest first, the pairs of each sorted.
std::vector<ExtremityMatches> exchanged_pairings(const ExtremityMatches& now,
                                                 const NodeDistances& along, std::size_t count);

}  // namespace pointmorph

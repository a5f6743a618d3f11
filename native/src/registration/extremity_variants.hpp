// Other ways in which the extremities of two shapes may belong together. Not for callers of the
// library.
#pragma once

#include <vector>

#include "pointmorph/base/types.hpp"
#include "registration/pose_trials.hpp"

namespace pointmorph {

/// Ways in which the extremities may belong together, the likeliest first: as the map has them, and
/// changed a little; see changed_pairings().
std::vector<ExtremityMatches> extremity_variants(const PoseSearch& search, const Trial& trial);

/// Pairings that differ little from `now` (places in lists of `sources` and `targets` extremities):
/// with a pair more or less, with one extremity exchanged for one left alone, with two swapped, and
/// with three exchanged in turn, as nose and ears where a head was turned. Each once, sorted.
std::vector<ExtremityMatches> changed_pairings(const ExtremityMatches& now, Index sources,
                                               Index targets);

}  // namespace pointmorph

// Other ways in which the tips of two shapes may belong together. Not a part of the library.
#pragma once

#include <vector>

#include "pointmorph/base/types.hpp"
#include "registration/pose_trials.hpp"

namespace pointmorph {

/// Ways in which the tips may belong together, the likeliest first: as the map has them, and with
/// one pair more or less, two of them swapped, three exchanged in turn, or one exchanged.
std::vector<Tips> tip_variants(const PoseSearch& search, const Trial& trial);

/// Pairings that differ little from `now` (places in lists of `sources` and `targets` tips): with a
/// pair more or less, with one tip exchanged for one left alone, with two swapped, and with three
/// exchanged in turn, as nose and ears where a head was turned. Each once, sorted.
std::vector<std::vector<IndexPair>> changed_pairings(const std::vector<IndexPair>& now,
                                                     Index sources, Index targets);

}  // namespace pointmorph

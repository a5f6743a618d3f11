// Stage `sampling`: evenly spread points out of many (blue noise, by weighted sample elimination;
// Yuksel, Sample Elimination for Generating Poisson Disk Sample Sets, 2015).
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Rows of `count` candidates that lie evenly over the surface, among them all of `keep`: these
/// first, in their order, then the others, ascending. Good with 3 to 5 times as many candidates as
/// samples; where candidates are denser, more of them go. Where `normals` (#candidates by 3, or 0
/// rows) are given, only points whose normals are less than a right angle apart keep their
/// distance, so that both sides of a thin sheet are sampled. Throws OptionError where `count` is
/// more than there are candidates or less than there are to keep, or where `keep` holds a row
/// twice or one that isn't there.
std::vector<Index> blue_noise(const Positions& candidates, const Normals& normals, Index count,
                              std::span<const Index> keep, Progress& progress);

}  // namespace pointmorph

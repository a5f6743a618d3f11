// Tips of a shape that carry no mark: a tail or an ear would shrink to a speck inside its disk, at
// another place on each model. Not for callers of the library.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/surface/graph_extremities.hpp"
#include "surface/coarse_cloud.hpp"

namespace pointmorph {

/// A feature this near to a tip, in √area, stands for it.
inline constexpr double kMarked = 0.1;

/// Distances from the first `features` coarse points to all, in √area.
std::vector<Values> distances_from(const CoarseCloud& coarse, std::size_t features);

/// The most prominent tips of the coarse points.
std::vector<Extremity> tips_of(const CoarseCloud& coarse, Index most, Progress& progress);

/// Tips away from the features: rows of the cloud, and their distances along the surface from all
/// features in √area, #tips by #features.
struct UnmarkedTips {
    std::vector<Index> rows;
    Eigen::MatrixXd distances;
};
UnmarkedTips unmarked_tips(const CoarseCloud& coarse, std::span<const Values> from, Index most,
                           Progress& progress);

/// Rows of tips in one patch (those with `in_patch`) that belong together: each other's best by
/// far, in how far `apart` they lie in the disk and along the surface from all features.
std::vector<IndexPair> paired_tips(const UnmarkedTips& source, const UnmarkedTips& target,
                                   const std::function<bool(bool is_source, Index row)>& in_patch,
                                   const std::function<double(Index, Index)>& apart);

}  // namespace pointmorph

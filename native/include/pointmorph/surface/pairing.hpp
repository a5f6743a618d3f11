// Stage `pairing`: which source point goes to which target point (paper, Point Pairs Assignment).
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

struct PairingOptions {
    /// A cluster of the merged domain is split while it holds more points of either cloud than
    /// this (the paper's σ) and at least two of each; 2 to 1000.
    Index max_cluster_size = 10;
};

/// Pairs of rows, sorted by source, then target; none twice. Every row of both clouds is in at
/// least one.
using Pairing = std::vector<IndexPair>;

/// Merges both clouds' images in the common domain and splits them recursively by planes through
/// the centroid across the direction of greatest variation into clusters with at least one point
/// of each; pairs within each cluster every point of the smaller side with the nearest one that
/// isn't taken, closest first, then every point left with its nearest. Distances are those of the
/// domain. `features`, pairs of rows, are paired first and kept out of the clusters. Both clouds
/// have at least one point; coordinates are finite. Throws OptionError.
///
/// A split that would leave one half without a point of either cloud is moved to the nearest place
/// along the axis where it doesn't; else the other principal axes are tried; else each cloud is
/// halved by itself along the first (where points coincide: by row), so that clusters end.
///
/// Instantiated for the domains in use: 2 (disk) and 3 (sphere).
template <int Dim>
Pairing pair_points(const typename KdTree<Dim>::Points& source,
                    const typename KdTree<Dim>::Points& target, std::span<const IndexPair> features,
                    const PairingOptions& options, Progress& progress);

}  // namespace pointmorph

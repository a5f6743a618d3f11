// The route from two closed shapes of the same genus to pairs of points through many disks: both
// cut alike into patches by a network of curves, patches onto disks, merged and paired disk by
// disk. Not for callers of the library.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "morph/patch_cloud.hpp"
#include "morph/point_features.hpp"
#include "morph/route_result.hpp"
#include "pointmorph/disk/network.hpp"
#include "pointmorph/surface/transfer.hpp"

namespace pointmorph {

using Loops = std::vector<std::vector<std::string>>;

struct NetworkRouteOptions {
    DecompositionOptions decomposition;
    PatchOptions patches;
    TransferOptions transfer;
};

struct TracedNetwork {
    Network network;
    /// The network's corners: the features, and unmarked extremities that belong together.
    std::vector<PointFeature> corners;
    std::vector<std::string> names;  ///< of the corners
    Pairing extremities;             ///< those of the corners that are unmarked extremities
};

/// The network alone; its loops are traced first. Needs the shapes' topology.
TracedNetwork traced_network(const RouteInput& input, const Loops& loops,
                             const DecompositionOptions& options, Progress& progress);

/// The disks stand in a row, 4 apart. Throws FeatureError for features or loops from which no
/// network can be made, TopologyError, and the errors of the stages.
RouteResult match_in_network(const RouteInput& input, const Loops& loops,
                             const NetworkRouteOptions& options, Progress& progress);

}  // namespace pointmorph

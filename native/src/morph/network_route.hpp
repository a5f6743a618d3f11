// From two closed shapes of the same genus to pairs of points through many disks: both cut alike
// into patches by a network of curves, patches onto disks, merged and paired disk by disk.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "morph/point_features.hpp"
#include "morph/prepared_shape.hpp"
#include "pointmorph/disk/network.hpp"
#include "pointmorph/morph/morph.hpp"

namespace pointmorph {

struct TracedNetwork {
    Network network;
    std::vector<PointFeature> known;
    std::vector<std::string> names;  ///< of `known`, which are the network's corners
};

/// The network alone. `features` as below.
TracedNetwork traced_network(const Side& source, const Side& target, const MorphInput& input,
                             std::span<const Feature> features, const MorphOptions& options,
                             MorphReport& report, Progress& progress);

struct NetworkRoute {
    DiskPoints source, target;  ///< rows of the sides; the disks stand in a row, 4 apart
    Pairing pairs;
    Positions source_images, target_images;  ///< of both sides, on the other one
};

/// `features`, in canonical order, are rows of the sides; see point_features(). Fills in what the
/// report says of the curves and the parameterization. Throws FeatureError for features or loops
/// from which no network can be made, TopologyError, and the errors of the stages.
NetworkRoute match_in_network(Side& source, Side& target, const MorphInput& input,
                              std::span<const Feature> features, const MorphOptions& options,
                              MorphReport& report, Progress& progress);

}  // namespace pointmorph

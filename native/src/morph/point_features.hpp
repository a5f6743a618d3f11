// What of the features the disks can use: points. Not for callers of the library.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "morph/prepared_shape.hpp"
#include "pointmorph/morph/morph.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

/// A pair of points that are to meet, rows of the sides.
struct PointFeature {
    std::string name;
    IndexPair rows;
};

/// Points, and some of each curve. With method paper, regions throw FeatureError, and the report
/// gets a warning where there are soft features.
std::vector<PointFeature> point_features(const Side& source, const Side& target,
                                         std::span<const Feature> features,
                                         const MorphOptions& options, MorphReport& report,
                                         Progress& progress);

}  // namespace pointmorph

// The features as points, which is all that the common domains of the paper's method can use. Not
// for callers of the library.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "morph/route_result.hpp"

namespace pointmorph {

/// A pair of points that are to meet, sorted rows.
struct PointFeature {
    std::string name;
    IndexPair rows;
};

/// The rims of two open patches; empty for closed shapes.
struct Rims {
    std::span<const Index> source{}, target{};
};

/// Points, and some of each curve; regions are left out.
std::vector<PointFeature> point_features(const RouteInput& input, const Rims& rims,
                                         Progress& progress);

std::vector<IndexPair> rows_of(std::span<const PointFeature> features);

}  // namespace pointmorph

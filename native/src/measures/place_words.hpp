// How the advice on bad places names them. Internal.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

/// A marked point of the source, by the name of its feature.
struct MarkedPoint {
    const std::string* name;
    Index row;
};

/// The points and curves that places are described by; regions are too wide for that.
std::vector<MarkedPoint> marked_points(std::span<const Feature> features);

/// The source, in the unit ball around the origin, as places on it are described.
struct DescribedShape {
    const Positions& positions;
    double root_area;  ///< √area
    const std::string& name;
};

/// Where a point of the source lies, by the features; the mark that would help there; and what to
/// call the source after that.
struct PlaceWords {
    std::string where, remedy, source;
};
PlaceWords words_for(const DescribedShape& source, Index row, std::span<const MarkedPoint> marks);

/// "0.034 %", "42 %", "99.6 %": 100 % only where it is all.
std::string percent(double share);

/// With a capital, and a full stop.
std::string sentence(std::string text);

}  // namespace pointmorph

// Curves and regions as features, and clouds to mark.
#pragma once

#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

inline std::vector<Index> rows_from(Index first, Index count) {
    std::vector<Index> rows(to_size(count));
    std::iota(rows.begin(), rows.end(), first);
    return rows;
}

inline Feature curve(std::string name, std::vector<Index> source, std::vector<Index> target,
                     bool closed = false, bool hard = false, double weight = 1.0) {
    return {std::move(name),
            FeatureKind::kCurve,
            {std::move(source), {}},
            {std::move(target), {}},
            closed,
            hard,
            weight};
}

inline Feature region(std::string name, Marked source, Marked target, bool hard = false,
                      double weight = 1.0) {
    return {
        std::move(name), FeatureKind::kRegion, std::move(source), std::move(target), false, hard,
        weight};
}

inline Cloud cloud_of(Positions positions, std::string name) {
    Cloud cloud;
    cloud.name = std::move(name);
    cloud.positions = std::move(positions);
    return cloud;
}

}  // namespace pointmorph

#include "pointmorph/measures/quality.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "measures/measured_map.hpp"
#include "measures/worst_places.hpp"

namespace pointmorph {

std::string name_of(Flaw flaw) {
    constexpr std::array names{"mirrored", "folded", "lost", "stretched", "squeezed"};
    return names[to_size(flaw)];
}

std::string direction_in_words(const Positions& positions, Index row) {
    const Vector3 extent = positions.cwiseAbs().colwise().maxCoeff();
    std::string words;
    for (int axis = 0; axis < 3; ++axis) {
        const double place = positions(row, axis);
        if (std::abs(place) <= std::max(0.4 * extent[axis], 0.1)) continue;
        words += words.empty() ? "toward " : ", ";
        words += place < 0.0 ? "-" : "+";
        words += "XYZ"[axis];
    }
    return words.empty() ? "in the middle" : words;
}

Quality measure_quality(const TwoWayMap& map, std::span<const Feature> features,
                        Progress& progress) {
    const auto prepared = [&](const Cloud& cloud, double first, double last) {
        const Progress::Part part(progress, first, last);
        return MeasuredCloud(cloud, progress);
    };
    const MeasuredCloud from = prepared(map.source, 0.0, 0.3), to = prepared(map.target, 0.3, 0.6);
    MeasuredMaps maps;
    {
        const Progress::Part part(progress, 0.6, 0.98);
        maps = measure_maps(from, to, map, progress);
    }
    Quality quality;
    {
        const Progress::Part part(progress, 0.98, 1.0);
        quality.worst = worst_places(from, to, maps, map, features, progress);
    }
    quality.features = feature_residuals(features, {from.tree, from.normals, maps.there.images},
                                         {to.tree, to.normals, maps.back.images}, progress);
    quality.source = std::move(maps.there.points);
    quality.target = std::move(maps.back.points);
    quality.source_to_target = maps.there.figures;
    quality.target_to_source = maps.back.figures;
    return quality;
}

}  // namespace pointmorph

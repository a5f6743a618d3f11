#include "pointmorph/measures/quality.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "measures/measured_map.hpp"
#include "measures/worst_places.hpp"
#include "pointmorph/base/parallel.hpp"

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

namespace {

std::vector<Index> renumbered(std::vector<Index> rows, std::span<const Index> numbers) {
    for (Index& row : rows) row = numbers[to_size(row)];
    return rows;
}

std::vector<Feature> in_spatial_order(std::span<const Feature> features, const MeasuredCloud& from,
                                      const MeasuredCloud& to) {
    std::vector<Feature> result(features.begin(), features.end());
    for (Feature& feature : result) {
        feature.source.rows = renumbered(std::move(feature.source.rows), from.sorted);
        feature.target.rows = renumbered(std::move(feature.target.rows), to.sorted);
    }
    return result;
}

PointQuality in_given_order(const PointQuality& points, const MeasuredCloud& cloud) {
    const std::vector<Index>& sorted = cloud.sorted;
    return {gather(points.stretch, sorted),    gather(points.measured, sorted),
            gather(points.flipped, sorted),    gather(points.reached, sorted),
            gather(points.round_trip, sorted), gather(points.distortion, sorted)};
}

}  // namespace

Quality measure_quality(const TwoWayMap& map, std::span<const Feature> features,
                        Progress& progress) {
    std::array<std::optional<OrderedNeighbors>, 2> found;
    const auto neighbors = [&](const Cloud& cloud, const OrderedNeighbors* known,
                               std::optional<OrderedNeighbors>& own, double first, double last) {
        const Progress::Part part(progress, first, last);
        return known
                   ? known
                   : &own.emplace(ordered_neighbors(cloud.positions, kMeasuredNeighbors, progress));
    };
    const OrderedNeighbors* near_source =
        neighbors(map.source, map.source_neighbors, found[0], 0.0, 0.2);
    const OrderedNeighbors* near_target =
        neighbors(map.target, map.target_neighbors, found[1], 0.2, 0.4);
    std::optional<MeasuredCloud> source, target;
    on_both(progress, [&](bool is_source, Progress&) {
        if (is_source)
            source.emplace(map.source, *near_source);
        else
            target.emplace(map.target, *near_target);
    });
    MeasuredCloud &from = *source, &to = *target;
    MeasuredMaps maps;
    {
        const Progress::Part part(progress, 0.5, 0.98);
        maps = measure_maps(from, to, map, progress);
    }
    const std::vector<Feature> marked = in_spatial_order(features, from, to);
    Quality quality;
    {
        const Progress::Part part(progress, 0.98, 1.0);
        quality.worst = worst_places(from, to, maps, map, marked, progress);
    }
    for (Place& place : quality.worst) {
        place.source = from.given(place.source);
        place.target = to.given(place.target);
    }
    quality.features = feature_residuals(marked, {from.tree, from.normals, maps.there.images},
                                         {to.tree, to.normals, maps.back.images}, progress);
    on_both(progress, [&](bool is_source, Progress&) {
        (is_source ? quality.source : quality.target) =
            in_given_order((is_source ? maps.there : maps.back).points, is_source ? from : to);
    });
    quality.source_to_target = maps.there.figures;
    quality.target_to_source = maps.back.figures;
    return quality;
}

}  // namespace pointmorph

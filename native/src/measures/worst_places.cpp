#include "measures/worst_places.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

#include "measures/place_words.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr double kPlaceRadius = 0.1;    // in √area
constexpr double kPlaceDistance = 0.2;  // in √area
constexpr double kFoldShows = 0.2;      // of the bad points
constexpr double kSmallestShare = 5e-4;
constexpr std::size_t kMostPlaces = 5;

/// What is wrong at a point.
Flaw flaw_of(const PointQuality& points, Index i, bool mirrored) {
    const double larger = points.stretch(i, 0), smaller = points.stretch(i, 1);
    const double lost =
        std::max(points.round_trip[i] / kBadRoundTrip, points.reached[to_size(i)] ? 0.0 : kBad);
    if (points.measured[to_size(i)] && (points.flipped[to_size(i)] != 0) != mirrored)
        return Flaw::kFolded;
    if (lost > strain(larger, smaller)) return Flaw::kLost;
    return larger * smaller > 1.0 ? Flaw::kStretched : Flaw::kSqueezed;
}

/// A bad place, as seen from one of the clouds.
struct Spot {
    Index row;
    Flaw flaw;
    double distortion;
    double share;
    double factor;   ///< by which its bad points are stretched or squeezed, median
    double badness;  ///< area times distortion over the limit
};

/// `alone`: see lie_at_ends().
std::vector<Spot> find_spots(const MeasuredCloud& cloud, const MeasuredMap& map,
                             const std::vector<char>& alone, Progress& progress) {
    const PointQuality& points = map.points;
    const auto counts = [&](Index i) { return alone.empty() || alone[to_size(i)] == 0; };
    // Single bad points are noise: a place is bad on average over neighbors.
    Values smooth(cloud.size());
    parallel_for(cloud.size(), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            double sum = points.distortion[i];
            for (const Index j : cloud.near(i)) sum += points.distortion[j];
            smooth[i] = sum / static_cast<double>(cloud.near(i).size() + 1);
        }
    });
    std::vector<Index> candidates;
    for (Index i = 0; i < cloud.size(); ++i)
        if (smooth[i] > kBad && counts(i)) candidates.push_back(i);
    std::ranges::sort(candidates, [&](Index i, Index j) {
        return std::pair(-smooth[i], i) < std::pair(-smooth[j], j);
    });

    const double area = cloud.spacing.squaredNorm();
    const double distance = kPlaceDistance * cloud.root_area;
    const bool mirrored = is_mirrored(map.figures);
    std::vector<Spot> spots;
    std::vector<std::pair<Index, double>> around;
    for (const Index i : candidates) {
        progress.throw_if_cancelled();
        const bool apart = std::ranges::none_of(spots, [&](const Spot& spot) {
            return (cloud.position(spot.row) - cloud.position(i)).norm() < distance;
        });
        if (!apart) continue;
        Spot spot{i, Flaw::kStretched, smooth[i], 0.0, 1.0, 0.0};
        std::array<double, 5> by_flaw{};
        std::vector<double> factors;
        cloud.tree.within(cloud.positions.row(i).data(), kPlaceRadius * cloud.root_area, around);
        for (const auto& [j, squared_distance] : around) {
            if (!(points.distortion[j] > kBad && counts(j)) && j != i) continue;
            const double share = area > 0.0 ? cloud.spacing[j] * cloud.spacing[j] / area : 0.0;
            spot.share += share;
            spot.badness += share * (points.distortion[j] - kBad);
            by_flaw[to_size(flaw_of(points, j, mirrored))] += share;
            factors.push_back(
                std::max(points.stretch(j, 0), 1.0 / std::max(points.stretch(j, 1), 1e-300)));
        }
        spot.flaw = static_cast<Flaw>(std::ranges::max_element(by_flaw) - by_flaw.begin());
        // A fold stretches what is around it, and only one of its layers comes back.
        if (by_flaw[to_size(Flaw::kFolded)] > kFoldShows * spot.share) spot.flaw = Flaw::kFolded;
        spot.factor = std::min(quantile(factors, 0.5), kStrongest);
        spots.push_back(spot);
    }
    std::erase_if(spots, [](const Spot& spot) { return spot.share < kSmallestShare; });
    return spots;
}

// --- Words

std::string times(double factor) {
    std::array<char, 32> text{};
    std::snprintf(text.data(), text.size(), factor < 10.0 ? "%.1f times" : "%.0f times", factor);
    return text.data();
}

/// A bad place, as the user reads about it.
struct Seen : Spot {
    bool on_source;
    Index source, target;
};

/// What a map back squeezes, the morph stretches.
Flaw seen_from_the_other_side(Flaw flaw) {
    if (flaw == Flaw::kSqueezed) return Flaw::kStretched;
    return flaw == Flaw::kStretched ? Flaw::kSqueezed : flaw;
}

std::string advice_on(const Seen& seen, const PlaceWords& words, const std::string& source,
                      const std::string& target) {
    const std::string& here = seen.on_source ? source : target;
    const std::string& there = seen.on_source ? target : source;
    const auto what = [&]() -> std::string {
        switch (seen.flaw) {
            case Flaw::kFolded:
                return "the map folds over itself";
            case Flaw::kLost:
                return "a part of " + here + " has no counterpart on " + there;
            case Flaw::kSqueezed:
                return words.source + " is squeezed " + times(seen.factor);
            default:
                return words.source + " is stretched " + times(seen.factor);
        }
    };
    return sentence(words.where + " " + what() + " (" + percent(seen.share) + " of " + here +
                    "): " + words.remedy);
}

}  // namespace

std::vector<Place> worst_places(const MeasuredCloud& from, const MeasuredCloud& to,
                                const MeasuredMaps& maps, const TwoWayMap& map,
                                std::span<const Feature> features, Progress& progress) {
    const std::string &source_name = map.source.name, &target_name = map.target.name;
    std::vector<Spot> on_source, on_target;
    on_both(progress, [&](bool is_source, Progress& its) {
        const MeasuredCloud &here = is_source ? from : to, &other = is_source ? to : from;
        const MeasuredMap& way = is_source ? maps.there : maps.back;
        const std::vector<char> alone =
            lie_at_ends(way.images, other.places_of(is_source ? map.target_ends : map.source_ends),
                        kEndNear * other.root_area, its);
        (is_source ? on_source : on_target) = find_spots(here, way, alone, its);
    });
    std::vector<Seen> seen;
    for (const Spot& spot : on_source)
        seen.push_back({spot, true, spot.row, maps.there.foot[to_size(spot.row)]});
    for (const Spot& spot : on_target) {
        seen.push_back({spot, false, maps.back.foot[to_size(spot.row)], spot.row});
        seen.back().flaw = seen_from_the_other_side(spot.flaw);
    }
    std::ranges::stable_sort(seen, std::ranges::greater{}, &Seen::badness);

    std::vector<Place> worst;
    if (is_mirrored(maps.there.figures) || is_mirrored(maps.back.figures)) {
        Index row = 0;
        maps.there.points.distortion.minCoeff(&row);
        worst.push_back(
            {row, maps.there.foot[to_size(row)], Flaw::kMirrored, maps.there.points.distortion[row],
             maps.there.figures.flipped, true, "",
             "The map turns " + source_name +
                 " inside out or swaps left and right: recalculate the normals of both models to "
                 "point outward, and check that no feature is on the other side of one."});
    }
    const std::vector<MarkedPoint> marked = marked_points(features);
    for (const Seen& spot : seen) {
        if (worst.size() == kMostPlaces) break;
        const bool apart = std::ranges::none_of(worst, [&](const Place& place) {
            return place.flaw != Flaw::kMirrored &&
                   (from.position(place.source) - from.position(spot.source)).norm() <
                       kPlaceDistance * from.root_area &&
                   (to.position(place.target) - to.position(spot.target)).norm() <
                       kPlaceDistance * to.root_area;
        });
        if (!apart) continue;
        const PlaceWords words =
            words_for({from.positions, from.root_area, source_name}, spot.source, marked);
        worst.push_back({spot.source, spot.target, spot.flaw, spot.distortion, spot.share,
                         spot.on_source, words.where,
                         advice_on(spot, words, source_name, target_name)});
    }
    return worst;
}

}  // namespace pointmorph

#include "measures/doubtful_places.hpp"

#include <algorithm>
#include <cstddef>
#include <functional>
#include <limits>
#include <utility>

#include "measures/place_words.hpp"

namespace pointmorph {

namespace {

// Lengths are in √area.
constexpr double kDoubtful = 0.5;     // less confidence is worth a word
constexpr double kDoubtsApart = 0.2;  // at least, of doubtful places
constexpr double kSmallestDoubt = 0.002;
constexpr std::size_t kMostDoubts = 5;

/// A doubtful place, as seen from one of the clouds.
struct DoubtfulSpot {
    bool on_source;
    Index row;
    double confidence, share, doubt;
    bool unreached;
};

void add_spots(const JudgedNodes& nodes, bool on_source, std::vector<DoubtfulSpot>& spots) {
    const JudgedSurface& surface = nodes.surface;
    const Values& confidence = nodes.confidence;
    const auto is_doubtful = [&](Index k) {
        return !nodes.alone[to_size(k)] && confidence[k] < kDoubtful;
    };
    std::vector<Index> candidates;
    for (Index k = 0; k < surface.count(); ++k)
        if (is_doubtful(k)) candidates.push_back(k);
    std::ranges::stable_sort(candidates, {}, [&](Index k) { return confidence[k]; });
    std::vector<Index> taken;
    std::vector<std::pair<Index, double>> around;
    for (const Index k : candidates) {
        if (std::ranges::any_of(taken, [&](Index other) {
                return (surface.places.row(k) - surface.places.row(other)).norm() < kDoubtsApart;
            }))
            continue;
        taken.push_back(k);
        nodes.trees.by_place.within(surface.places.row(k).data(), kDoubtsApart / 2.0, around);
        DoubtfulSpot spot{on_source, surface.rows[to_size(k)],        0.0, 0.0,
                          0.0,       nodes.unreached[to_size(k)] != 0};
        Index count = 0;
        for (const auto& [l, squared_distance] : around) {
            if (!is_doubtful(l)) continue;
            spot.confidence += confidence[l];
            ++count;
        }
        spot.confidence /= count;
        spot.share = static_cast<double>(count) / surface.count();
        spot.doubt = spot.share * (kDoubtful - spot.confidence);
        if (spot.share >= kSmallestDoubt) spots.push_back(spot);
    }
}

/// The row of the other cloud that a row's image is nearest to, of those that it is paired with.
Index partner_of(const TwoWayMap& map, bool on_source, Index row) {
    const Positions& images = on_source ? map.source_images : map.target_images;
    const Positions& other = on_source ? map.target.positions : map.source.positions;
    Index best = -1;
    double least = std::numeric_limits<double>::infinity();
    for (const IndexPair& pair : map.pairs) {
        if ((on_source ? pair.source : pair.target) != row) continue;
        const Index partner = on_source ? pair.target : pair.source;
        const double squared = (other.row(partner) - images.row(row)).squaredNorm();
        if (squared >= least) continue;
        least = squared;
        best = partner;
    }
    return best;
}

std::string advice_about(const DoubtfulSpot& spot, const PlaceWords& words,
                         const DoubtfulPlace& place, const TwoWayMap& map) {
    const std::string& here = (spot.on_source ? map.source : map.target).name;
    const std::string& there = (spot.on_source ? map.target : map.source).name;
    const std::string what = spot.unreached
                                 ? " nothing of " + there + " comes near a part of " + here + " (" +
                                       percent(place.share) +
                                       " of it). Either this part has no counterpart, or the map " +
                                       "is wrong: then "
                                 : " the map may be wrong (" + percent(place.confidence) +
                                       " sure, " + percent(place.share) + " of " + here + "): ";
    return sentence(words.where + what + words.remedy);
}

/// A place to be named.
struct NamedPlace {
    DoubtfulPlace place;
    double doubt;
};

/// Those with the most doubt, of what nothing comes near the first among them.
std::vector<NamedPlace> named_places(const JudgedSurface& source, const JudgedSurface& target,
                                     const TwoWayMap& map, std::vector<DoubtfulSpot> spots,
                                     std::span<const Feature> features) {
    std::ranges::stable_sort(spots, std::ranges::greater{}, &DoubtfulSpot::doubt);
    const auto unreached = std::ranges::find(spots, true, &DoubtfulSpot::unreached);
    if (unreached != spots.end()) std::rotate(spots.begin(), unreached, unreached + 1);
    const std::vector<MarkedPoint> marked = marked_points(features);
    std::vector<NamedPlace> places;
    for (const DoubtfulSpot& spot : spots) {
        if (places.size() == kMostDoubts) break;
        const Index partner = partner_of(map, spot.on_source, spot.row);
        if (partner < 0) continue;
        DoubtfulPlace place{spot.on_source ? spot.row : partner,
                            spot.on_source ? partner : spot.row,
                            spot.confidence,
                            spot.share,
                            spot.unreached,
                            spot.on_source,
                            {},
                            {}};
        const bool is_apart = std::ranges::none_of(places, [&](const NamedPlace& other) {
            const auto distance = [](const JudgedSurface& surface, Index a, Index b) {
                return surface.scale * (surface.positions.row(a) - surface.positions.row(b)).norm();
            };
            return distance(source, place.source, other.place.source) < kDoubtsApart &&
                   distance(target, place.target, other.place.target) < kDoubtsApart;
        });
        if (!is_apart) continue;
        const PlaceWords words = words_for({source.positions, 1.0 / source.scale, map.source.name},
                                           place.source, marked);
        place.where = words.where;
        place.advice = advice_about(spot, words, place, map);
        places.push_back({std::move(place), spot.doubt});
    }
    std::ranges::stable_sort(places, std::ranges::greater{}, &NamedPlace::doubt);
    return places;
}

std::string warning_about(double right, const TwoWayMap& map) {
    return "Only " + percent(right) + " of the map from " + map.source.name + " to " +
           map.target.name +
           " is likely right: mark more features on both models. If they have nothing in common, "
           "no map between them is right.";
}

}  // namespace

DoubtfulPlaces doubtful_places(const JudgedNodes& source, const JudgedNodes& target, double right,
                               const TwoWayMap& map, std::span<const Feature> features) {
    std::vector<DoubtfulSpot> spots;
    add_spots(source, true, spots);
    add_spots(target, false, spots);
    std::vector<NamedPlace> named =
        named_places(source.surface, target.surface, map, std::move(spots), features);
    DoubtfulPlaces result;
    if (right < kMostlyRight) result.warning = warning_about(right, map);
    for (NamedPlace& one : named) result.places.push_back(std::move(one.place));
    return result;
}

}  // namespace pointmorph

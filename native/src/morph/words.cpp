#include "morph/words.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "base/angle.hpp"
#include "measures/place_words.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/measures/quality.hpp"

namespace pointmorph {

namespace {

/// Where a row lies: near a point or curve feature, or toward which sides of the bounding box.
std::string where(const Cloud& cloud, Index row, std::span<const Feature> features,
                  Marked Feature::*marked) {
    constexpr double kNear = 0.1;  // of the bounding box's diagonal
    double least =
        kNear *
        (cloud.positions.colwise().maxCoeff() - cloud.positions.colwise().minCoeff()).norm();
    std::string near;
    for (const Feature& feature : features) {
        if (feature.kind == FeatureKind::kRegion) continue;  // which has no place of its own
        for (const Index of : (feature.*marked).rows) {
            const double distance = (cloud.positions.row(of) - cloud.positions.row(row)).norm();
            if (distance > least) continue;
            least = distance;
            near = "near \"" + feature.name + "\"";
        }
    }
    if (!near.empty()) return near;
    return direction_in_words(normalization(cloud.positions).apply(cloud.positions), row);
}

/// "0.49, -2, 30", where words don't tell places apart.
std::string coordinates(const Cloud& cloud, Index row) {
    std::array<char, 96> text{};
    const auto place = cloud.positions.row(row);
    std::snprintf(text.data(), text.size(), "%.2g, %.2g, %.2g", place.x(), place.y(), place.z());
    return text.data();
}

/// How a rival map differs from the one that was chosen.
std::string difference(const Rival& rival, const Cloud& source, std::span<const Feature> features) {
    switch (rival.swap) {
        case Swap::kEnds:
            return "with one end and the other swapped";
        case Swap::kSides:
            return "with its sides, such as left and right, swapped";
        case Swap::kTurned:
            return "rotated differently";
        case Swap::kRolled:
            return "rolled about its length, with opposite sides swapped";
        default:
            break;
    }
    std::vector<std::string> places;
    for (const Index place : rival.places) {
        std::string words = where(source, place, features, &Feature::source);
        if (!words.empty() && std::ranges::find(places, words) == places.end())
            places.push_back(std::move(words));
    }
    std::string text = "with parts of it matched differently";
    for (const std::string& place : places)
        text += (&place == &places.front() ? " (" : "; ") + place;
    return places.empty() ? text : text + ")";
}

}  // namespace

std::vector<std::string> preparation_warnings(const PreparedShapes& shapes, bool by_pieces) {
    std::vector<std::string> warnings;
    for (const PreparedShape* shape : {&shapes.source, &shapes.target})
        if (shape->normals_reversed)
            warnings.push_back("The normals of " + shape->name +
                               " pointed inward: they were reversed.");
    for (const PreparedShape* shape : {&shapes.source, &shapes.target})
        if (shape->left_out > 0)
            warnings.push_back(
                shape->name + ": " + std::to_string(shape->left_out) +
                (shape->left_out == 1 ? " stray point follows" : " stray points follow") +
                " the nearest other point.");
    if (by_pieces &&
        std::max(shapes.source.topology.main().size(), shapes.target.topology.main().size()) > 1)
        return warnings;
    const std::string difference = difference_in_words(shapes.source.topology, shapes.source.name,
                                                       shapes.target.topology, shapes.target.name);
    if (!difference.empty()) warnings.push_back(difference);
    return warnings;
}

std::vector<std::string> handle_warnings(const PreparedShapes& shapes) {
    const Topology &source = shapes.source.topology, &target = shapes.target.topology;
    if (source.main().size() > 1 || target.main().size() > 1) return {};
    const std::optional<Index> s = source.components.front().genus,
                               t = target.components.front().genus;
    if (!s || !t || *s == *t || std::min(*s, *t) > 0 || std::max(*s, *t) > 1) return {};
    const std::string &one = shapes.source.name, &other = shapes.target.name;
    if (*s > *t)
        return {"The hole through " + one + " can't close: its wall becomes a thin tube through " +
                other + ". Fill that hole first, or give " + other + " one."};
    return {"No hole can open in the faces of " + one + ": they span the one through " + other +
            ". Give " + one + " a hole first, or fill that of " + other + "."};
}

std::vector<std::string> paper_warnings(std::span<const Feature> features) {
    if (std::ranges::all_of(features, &Feature::hard)) return {};
    return {
        "Method paper has no soft features: points, and some points of each curve, are met "
        "exactly."};
}

std::string faces_were_reversed(const std::string& shape, bool only_some) {
    return (only_some ? "Some faces of " : "The faces of ") + shape +
           " pointed inward: they were reversed.";
}

std::string normals_disagree() {
    return "The normals of one model point inward, so its shading will flip during the morph. "
           "Recalculate them to point outward.";
}

std::string earlier_map_was_ignored(const std::string& domain) {
    return "The earlier map was ignored: with domain " + domain +
           " the search starts in that domain. To continue from the map, use domain auto.";
}

std::string mark_went_far(const std::string& name, double distance) {
    return "Computed from scratch: \"" + name + "\" moved too far (" +
           in_short(std::round(100.0 * distance) / 100.0) +
           " √area) from its place in the earlier map.";
}

std::string update_would_tear() {
    return "Computed from scratch: the changed features would have torn the earlier map.";
}

std::string marks_join_other_parts() {
    return "Computed from scratch: a feature joins parts that the earlier map has with others.";
}

std::string loop_was_suggested(std::span<const std::string> loop) {
    std::string names;
    for (const std::string& name : loop) names += (names.empty() ? "" : ", ") + name;
    return "No loop was given: both models were cut along " + names + ".";
}

std::string cut_was_led_around(const std::string& shape, const std::string& features) {
    return "The cut through " + shape + " goes around " + features +
           ", passing on the same side as on the other model.";
}

std::string curves_take_detours() {
    return "The curves between the features take long detours around each other: check that all "
           "features are in the same places on both models, and that left and right are not "
           "swapped.";
}

std::string fits_mirrored(const std::string& what_fits) {
    return what_fits +
           " much better when one model is mirrored: check that left and right are not swapped "
           "and that the normals of both point outward.";
}

std::string patch_has_holes(const std::string& shape, Index boundary_loops) {
    return shape + ": the longest of " + std::to_string(boundary_loops) +
           " boundary loops becomes the rim of the disk; the others are treated as holes in the "
           "patch.";
}

std::string goes_beyond(const std::string& whole, const std::string& part, double share) {
    return part + " ends where " + whole + " goes on: " + percent(share) + " of " + whole +
           " has no counterpart and joins that border. To stretch " + part +
           " over it, set missing parts to stretch.";
}

std::string separate_parts(const std::string& shape, Index points) {
    return shape + ": " + std::to_string(points) +
           (points == 1 ? " point in a separate part follows"
                        : " points in separate parts follow") +
           " the nearest points of the largest part.";
}

std::string orientation_was_searched(const std::string& source, const std::string& target) {
    return "With fewer than three features, the rotation of " + source + " onto " + target +
           " on the sphere was searched for. Mark three or more if it is wrong.";
}

std::string sphere_is_stretched() {
    return "The map over the sphere is heavily stretched: limbs may be twisted, or features "
           "swapped. Mark more places around the limbs, or use domain auto.";
}

std::string doubts(const Diagnostics& found, const Cloud& source, const Cloud& target,
                   std::span<const Feature> features) {
    const auto from = [&](Index row) {
        return where(source, row, features, &Feature::source) + " of " + source.name;
    };
    const auto onto = [&](Index row) { return where(target, row, features, &Feature::target); };
    std::string text =
        "Parts may have ended up in the wrong place (" + percent(found.confidence) + " sure)";
    std::string mark;
    if (!found.rivals.empty()) {
        const Rival& rival = found.rivals.front();
        constexpr double kJustAsWell = 1.005;  // half a percent worse: a toss-up
        text += ": " + source.name + " fits " + target.name +
                (rival.ratio < kJustAsWell ? " just as well, but " : " nearly as well, but ") +
                difference(rival, source, features);
        mark = from(rival.source);
        std::string now = onto(rival.target), otherwise = onto(rival.rival_target);
        const std::string here = coordinates(target, rival.target),
                          there = coordinates(target, rival.rival_target);
        if (now == otherwise && here != there) {
            now += " (at " + here + ")";
            otherwise += " (at " + there + ")";
        }
        if (now != otherwise)
            mark += ", which is now " + now + " of " + target.name + " and otherwise " + otherwise;
    } else if (!found.proposals.empty()) {
        const Proposal& weakest =
            *std::ranges::min_element(found.proposals, {}, &Proposal::confidence);
        mark = from(weakest.source);
    }
    text += ". Mark one place on both models to settle it";
    return text + (mark.empty() ? "." : ", for instance " + mark + ".");
}

std::vector<std::string> color_warnings(const Cloud& source, const Cloud& target) {
    const bool source_has_none = source.colors.rows() == 0;
    if (source_has_none == (target.colors.rows() == 0)) return {};
    return {(source_has_none ? source : target).name + " has no colors: white is used."};
}

std::vector<std::string> straight_path_warnings(const Cloud& source, const Cloud& target,
                                                const Pairing& pairs) {
    constexpr double kFewDegrees = 10.0;
    const JointSpread spread = joint_spread(source.positions, target.positions, pairs);
    const double degrees = angle_axis(spread.rotation()).angle() * 180.0 / std::numbers::pi;
    if (degrees < kFewDegrees) return {};
    const double half_way =
        spread.half_way() / std::max(std::sqrt(spread.from_size() * spread.to_size()), 1e-300);
    return {target.name + " is rotated " + std::to_string(std::lround(degrees)) + "° relative to " +
            source.name + ". On straight paths, the shape shrinks to " +
            std::to_string(std::lround(100.0 * half_way)) +
            " % of its size halfway: use path rigid to rotate it."};
}

std::string choice_in_words(const std::string& domain, const Topology& source,
                            const Topology& target) {
    return (domain == "product" ? "product space" : domain) + ": " + in_words(source, target);
}

}  // namespace pointmorph

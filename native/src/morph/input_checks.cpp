#include "morph/input_checks.hpp"

#include <algorithm>
#include <map>
#include <string>

#include "morph/mesh_side.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

void check_weights(const Cloud& cloud, const Values& weights, const std::string& name) {
    if (weights.rows() != 0 && weights.rows() != cloud.size())
        throw CloudError(cloud.name,
                         name + " for each of " + std::to_string(cloud.size()) + " vertices",
                         std::to_string(weights.rows()), "Give one weight per vertex, or none.");
    for (Index i = 0; i < weights.rows(); ++i)
        if (!(weights[i] >= 0.0 && weights[i] <= 1.0))
            throw CloudError(cloud.name, "weights from 0 to 1 as " + name,
                             "another at vertex " + std::to_string(i),
                             "Divide them by the largest, or give none.");
}

}  // namespace

void check_shapes(const MorphInput& input, const MorphOptions& options) {
    parallel_invoke(2, [&](int k, bool) {
        const Cloud& cloud = k == 0 ? input.source : input.target;
        validate(cloud, is_sampled(cloud, options) ? 0 : kMinimumPoints);
    });
    validate(input.features, input.source, input.target);
    check_weights(input.source, input.source_holds.rigid, "rigid");
    check_weights(input.source, input.source_holds.fixed, "fixed");
    check_weights(input.target, input.target_holds.rigid, "rigid");
    check_weights(input.target, input.target_holds.fixed, "fixed");
}

void check_loop(std::span<const std::string> loop, std::span<const Feature> features) {
    for (std::size_t i = 0; i < loop.size(); ++i) {
        const auto& name = loop[i];
        const auto feature = std::ranges::find(features, name, &Feature::name);
        if (feature == features.end())
            throw FeatureError("loop", "names of features", "\"" + name + "\", which isn't one",
                               "Mark that feature on both models, or remove it from the loop.");
        if (feature->kind != FeatureKind::kPoint)
            throw FeatureError("loop", "point features",
                               "\"" + name + "\", a " + name_of(feature->kind),
                               "Remove it from the loop, or mark a point.");
        if (std::ranges::find(loop.first(i), name) != loop.first(i).end())
            throw FeatureError("loop", "each feature once", "\"" + name + "\" twice",
                               "Remove one of the two.");
    }
    if (!loop.empty() && loop.size() < 3)
        throw FeatureError("loop", "at least 3 features", std::to_string(loop.size()),
                           "Add features to the loop, or leave it out.");
}

void check_loops(const MorphInput& input, const MorphOptions& options) {
    check_loop(input.loop, input.features);
    for (const auto& loop : input.more_loops) check_loop(loop, input.features);
    if (!input.more_loops.empty() && options.domain != Domain::kNetwork &&
        (options.domain != Domain::kAuto || options.method != Method::kPaper))
        throw OptionError("domain", "network, for several loops",
                          "another with " + std::to_string(input.more_loops.size() + 1) + " loops",
                          "Give one loop, or use domain network.");
}

void check_for_paper(std::span<const Feature> features) {
    const auto region = std::ranges::find(features, FeatureKind::kRegion, &Feature::kind);
    if (region != features.end())
        throw FeatureError(
            "feature \"" + region->name + "\"", "points and curves with method paper", "a region",
            "Use method auto, which supports regions, or mark points along the region's border.");
}

void check_places(std::span<const Feature> features, const PreparedShape& source,
                  const PreparedShape& target) {
    const auto check = [&](const PreparedShape& shape, Marked Feature::*side) {
        std::map<Index, const Feature*> at;
        for (const Feature& f : features) {
            if (f.kind != FeatureKind::kPoint) continue;
            const auto [other, is_new] = at.try_emplace((f.*side).rows.front(), &f);
            if (!is_new)
                throw FeatureError("feature \"" + f.name + "\"", "a place of its own",
                                   "that of \"" + other->second->name + "\" on " + shape.name,
                                   "Move or remove one of the two.");
        }
    };
    check(source, &Feature::source);
    check(target, &Feature::target);
}

void check_start(const RefinementStart& start, const Cloud& source, const Cloud& target) {
    const auto s = start.source_images.rows(), t = start.target_images.rows();
    if (s == 0 && t == 0) return;
    const std::string expected = "finite images of " + std::to_string(source.size()) + " and " +
                                 std::to_string(target.size()) + " points";
    constexpr const char* kHelp = "Use the maps of a morph of the same clouds, or none.";
    if (s != source.size() || t != target.size() || !start.source_images.allFinite() ||
        !start.target_images.allFinite())
        throw CloudError("start", expected,
                         "those of " + std::to_string(s) + " and " + std::to_string(t), kHelp);
    if (!lie_around(start.source_images, target) || !lie_around(start.target_images, source))
        throw CloudError("start", expected + " on or around the other cloud",
                         "one a billion times as far away as the cloud is large", kHelp);
}

bool lie_around(const Positions& places, const Cloud& cloud) {
    constexpr double kFarthest = 1e9;  // in sizes of the cloud
    const Normalization unit = normalization(cloud.positions);
    const auto away = (places.rowwise() - unit.center.transpose()).array().abs();
    return (away <= kFarthest * unit.scale).all();
}

void require_closed(Closed purpose, const PreparedShape& shape, std::span<const Index> given,
                    const BoundaryOptions& options, Progress& progress) {
    if (!is_rim(shape, find_boundary(shape, given, options, progress).loop)) return;
    switch (purpose) {
        case Closed::kLoop:
            throw FeatureError("loop", "closed models, which a loop cuts open",
                               shape.name + ", which is open and needs no loop",
                               "Go without a loop.");
        case Closed::kNetwork:
            throw TopologyError(shape.name, "a closed surface for a network of curves",
                                "an open surface, whose boundary is known",
                                "Use domain disk or method auto.");
        case Closed::kSphere:
            throw TopologyError(
                shape.name, "a closed surface for domain sphere", "an open surface",
                "Use domain disk for open surfaces, or method auto with domain auto "
                "for shapes of any topology.");
    }
}

void check_pairs(const Pairing& pairs, const Cloud& source, const Cloud& target) {
    const auto check = [&](const Cloud& cloud, Index IndexPair::*side) {
        std::vector<char> in_a_pair(to_size(cloud.size()));
        for (const IndexPair& pair : pairs) {
            const Index row = pair.*side;
            if (row < 0 || row >= cloud.size())
                throw CloudError(cloud.name,
                                 "pairs of its " + std::to_string(cloud.size()) + " points",
                                 "row " + std::to_string(row), "Use the morph's own pairs.");
            in_a_pair[to_size(row)] = 1;
        }
        if (std::ranges::find(in_a_pair, 0) != in_a_pair.end())
            throw CloudError(cloud.name, "every point in a pair", "some in no pair",
                             "Use the morph's own pairs.");
    };
    check(source, &IndexPair::source);
    check(target, &IndexPair::target);
}

}  // namespace pointmorph

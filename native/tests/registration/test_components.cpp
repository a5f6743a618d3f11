#include "pointmorph/registration/components.hpp"

#include <gtest/gtest.h>

#include "checks.hpp"
#include "joined_shapes.hpp"
#include "pointmorph/morph/morph.hpp"
#include "registration/watched_options.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

constexpr Index kBody = 3000, kEye = 250;

Positions ball(Index count, double radius, double x, double y, double z) {
    return (shapes::sphere(count) * radius).rowwise() + Eigen::RowVector3d(x, y, z);
}

using shapes::together;

/// A long body with two eyes on stalks that aren't there.
Positions creature(double length, double eye, double height) {
    Positions body = shapes::sphere(kBody);
    body.col(0) *= length;
    body.col(2) *= 0.8;
    return together(
        {body, ball(kEye, eye, length, 0.5, height), ball(kEye, eye, length, -0.5, height)});
}

Topology topology_of(std::vector<Index> sizes) {
    Topology topology;
    for (std::size_t p = 0; p < sizes.size(); ++p) {
        topology.labels.insert(topology.labels.end(), to_size(sizes[p]), to_index(p));
        topology.components.push_back({sizes[p], 0, false, 0});
    }
    return topology;
}

TEST(Components, AreMatchedByPlaceAndSize) {
    const Topology s = topology_of({900, 50, 40}), t = topology_of({800, 60, 50, 50});
    // The source's second is the target's third; the target's second is somewhere else.
    const Positions source =
        together({ball(900, 1, 0, 0, 0), ball(50, 0.1, 0, 2, 0), ball(40, 0.1, 0, -2, 0)});
    const Positions target = together({ball(800, 1.1, 0, 0, 0), ball(60, 0.1, 5, 0, 0),
                                       ball(50, 0.12, 0, 2.1, 0), ball(50, 0.08, 0, -2.1, 0)});
    const ComponentMatching m =
        match_components({s, source, source, source}, {t, target, target, target}, {}, {});
    EXPECT_EQ(m.matched, (std::vector<IndexPair>{{0, 0}, {1, 2}, {2, 3}}));
    EXPECT_TRUE(m.source_alone.empty());
    EXPECT_EQ(m.target_alone, std::vector<Index>{1});
    const std::string one = "one", two = "two";
    const auto words = components_in_words(m, {s, one}, {t, two});
    ASSERT_EQ(words.size(), 2u);
    EXPECT_NE(words[0].find("3 pieces of one and two"), std::string::npos);
    EXPECT_NE(words[1].find("1 piece of two (60 points) has no counterpart"), std::string::npos);
}

TEST(Components, OfOtherSizesDontBelongTogether) {
    const Topology s = topology_of({900, 100}), t = topology_of({900, 100});
    const Positions source = together({ball(900, 1, 0, 0, 0), ball(100, 0.1, 0, 2, 0)});
    const Positions target = together({ball(900, 1, 0, 0, 0), ball(100, 0.5, 0, 2, 0)});
    const ComponentMatching m =
        match_components({s, source, source, source}, {t, target, target, target}, {}, {});
    EXPECT_EQ(m.matched.size(), 1u);
    EXPECT_EQ(m.source_alone, std::vector<Index>{1});
}

TEST(Components, OfAMorphKeepToThemselves) {
    MorphInput input;
    input.source = {"one", creature(2.0, 0.2, 0.9), {}, {}, {}};
    input.target = {
        "two", (creature(2.3, 0.15, 1.1) * 3.0 * shapes::rotation(5).transpose()), {}, {}, {}};
    MorphOptions options;
    options.refinement = lighter_where_watched();
    Progress progress;
    const Morph morph(std::move(input), options, progress);
    const auto component = [](Index row) { return row < kBody ? 0 : row < kBody + kEye ? 1 : 2; };
    for (const auto& [s, t] : morph.pairs())
        EXPECT_EQ(component(s) == 0, component(t) == 0) << s << " with " << t;
    // A left eye is an eye of one side, all of it.
    std::array<std::array<int, 3>, 3> counts{};
    for (const auto& [s, t] : morph.pairs()) ++counts[to_size(component(s))][to_size(component(t))];
    for (std::size_t eye : {1u, 2u})
        EXPECT_EQ(std::min(counts[eye][1], counts[eye][2]), 0) << "eye " << eye;
    EXPECT_EQ(morph.report().source_topology.components.size(), 3u);
    EXPECT_FALSE(morph.report().warnings.empty());
}

TEST(Components, WithoutACounterpartAreJoined) {
    SKIP_WHERE_WATCHED();
    MorphInput input;
    input.source = {"one", creature(2.0, 0.2, 0.9), {}, {}, {}};
    Positions body = shapes::sphere(kBody);
    body.col(0) *= 2.2;
    input.target = {"two", body, {}, {}, {}};
    Progress progress;
    const Morph morph(std::move(input), {}, progress);
    EXPECT_TRUE(checks::is_total(morph.pairs(), kBody + 2 * kEye, kBody));
    EXPECT_TRUE(checks::mentions(morph.report().warnings,
                                 "2 pieces of one (500 points) have no counterpart"));
}

TEST(Example, Components) {
    const Topology source_topology = topology_of({900, 50}),
                   target_topology = topology_of({800, 50});
    const Positions source = together({ball(900, 1, 0, 0, 0), ball(50, 0.1, 0, 2, 0)});
    const Positions target = together({ball(800, 1.1, 0, 0, 0), ball(50, 0.12, 0, 2.1, 0)});
    const Positions &source_normals = source, &target_normals = target;
    const Positions &source_images = source, &target_images = target;
    const Similarity alignment;
    // --- example
    const ComponentView on_source{source_topology, source, source_normals, source_images};
    const ComponentView on_target{target_topology, target, target_normals, target_images};
    const ComponentMatching found = match_components(on_source, on_target, alignment, {});
    const std::vector<IndexPair>& partners = found.matched;
    // --- end of the example
    EXPECT_EQ(partners, (std::vector<IndexPair>{{0, 0}, {1, 1}}));
    EXPECT_TRUE(found.source_alone.empty());
}

}  // namespace
}  // namespace pointmorph

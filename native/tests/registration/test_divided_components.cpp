#include "registration/divided_components.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "joined_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/morph/morph.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

using shapes::together;

/// Points all over a box, about a spacing apart.
Positions box(const Vector3& middle, const Vector3& extents, double spacing) {
    std::vector<Eigen::RowVector3d> points;
    for (int axis = 0; axis < 3; ++axis) {
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        const int m = std::max(1, static_cast<int>(std::lround(extents[u] / spacing))),
                  n = std::max(1, static_cast<int>(std::lround(extents[v] / spacing)));
        for (const double side : {-0.5, 0.5})
            for (int i = 0; i < m; ++i)
                for (int j = 0; j < n; ++j) {
                    Vector3 point = middle;
                    point[axis] += side * extents[axis];
                    point[u] += ((i + 0.5) / m - 0.5) * extents[u];
                    point[v] += ((j + 0.5) / n - 0.5) * extents[v];
                    points.emplace_back(point.transpose());
                }
    }
    Positions all(static_cast<Eigen::Index>(points.size()), 3);
    for (std::size_t i = 0; i < points.size(); ++i)
        all.row(static_cast<Eigen::Index>(i)) = points[i];
    return all;
}

/// Clouds as the components of one shape, in their order.
struct Scene {
    explicit Scene(const std::vector<Positions>& clouds) : positions(together(clouds)) {
        for (const Positions& cloud : clouds) {
            const auto points = to_index(cloud.rows());
            topology.labels.insert(topology.labels.end(), to_size(points),
                                   to_index(topology.components.size()));
            topology.components.push_back({points, 0, false, 0});
        }
    }

    ComponentView view() const { return {topology, positions, positions, positions}; }

    Positions positions;
    Topology topology{};
};

constexpr double kSpacing = 0.05;

std::vector<Positions> seat_and_legs() {
    std::vector<Positions> clouds{box({0, 0, 0}, {1, 1, 0.1}, kSpacing)};
    for (const double x : {-0.45, 0.45})
        for (const double y : {-0.45, 0.45})
            clouds.push_back(box({x, y, -0.5}, {0.1, 0.1, 0.8}, kSpacing));
    return clouds;
}

/// With a panel for a back, which comes last.
std::vector<Positions> panel_chair() {
    std::vector<Positions> clouds = seat_and_legs();
    clouds.push_back(box({0, 0.45, 0.6}, {1, 0.08, 1}, kSpacing));
    return clouds;
}

double rod_place(int rod) {
    return 0.225 * (rod - 2);
}

/// With five rods for a back, which come last.
std::vector<Positions> rods_chair() {
    std::vector<Positions> clouds = seat_and_legs();
    for (int rod = 0; rod < 5; ++rod)
        clouds.push_back(box({rod_place(rod), 0.45, 0.6}, {0.07, 0.07, 1}, kSpacing));
    return clouds;
}

DividedComponents divided(const Scene& source, const Scene& target,
                          std::span<const IndexPair> marks = {}) {
    Progress progress;
    const ComponentMatching matching =
        match_components(source.view(), target.view(), marks, {}, {}, progress);
    return divide_components(source.view(), target.view(), matching, {marks, {}, {}}, progress);
}

/// Of each row of the panel, which is what its label has for a partner: the rod before it.
void expect_strips(const Scene& panel, const Topology& shares,
                   const std::function<Index(Index)>& partner) {
    constexpr Index kFirstRod = 5;
    for (std::size_t i = 0; i < panel.topology.labels.size(); ++i) {
        if (panel.topology.labels[i] != 5) continue;
        const double x = panel.positions(static_cast<Eigen::Index>(i), 0);
        const Index rod = partner(shares.labels[i]) - kFirstRod;
        ASSERT_GE(rod, 0);
        EXPECT_LT(std::abs(x - rod_place(rod)), 0.16) << i;
    }
}

TEST(DividedComponents, APanelGoesOntoFiveRods) {
    const Scene panel(panel_chair()), rods(rods_chair());
    const DividedComponents found = divided(panel, rods);
    EXPECT_EQ(found.among_target, std::vector<Index>{5});
    EXPECT_TRUE(found.among_source.empty());
    EXPECT_TRUE(found.matching.source_alone.empty());
    EXPECT_TRUE(found.matching.target_alone.empty());
    EXPECT_EQ(found.source.components.size(), rods.topology.components.size());
    expect_strips(panel, found.source, [&](Index label) {
        return std::ranges::find(found.matching.matched, label, &IndexPair::source)->target;
    });
    EXPECT_EQ(std::ranges::count(found.kinds, GroupKind::kShareOfSource), 5);
    EXPECT_EQ(divisions_in_words(found, "one", "two"),
              std::vector<std::string>{"1 piece of one is divided among 5 of two, which lie "
                                       "together in its place."});
}

TEST(DividedComponents, FiveRodsGoOntoAPanel) {
    const Scene panel(panel_chair()), rods(rods_chair());
    const DividedComponents found = divided(rods, panel);
    EXPECT_EQ(found.among_source, std::vector<Index>{5});
    EXPECT_TRUE(found.among_target.empty());
    EXPECT_TRUE(found.matching.source_alone.empty());
    expect_strips(panel, found.target, [&](Index label) {
        return std::ranges::find(found.matching.matched, label, &IndexPair::target)->source;
    });
    EXPECT_EQ(std::ranges::count(found.kinds, GroupKind::kShareOfTarget), 5);
}

TEST(DividedComponents, LegsStayLegs) {
    const Scene panel(panel_chair()), rods(rods_chair());
    const DividedComponents found = divided(panel, rods);
    for (Index leg = 0; leg < 5; ++leg)
        EXPECT_EQ(std::ranges::count(found.matching.matched, IndexPair{leg, leg}), 1) << leg;
}

TEST(DividedComponents, StraysStayLast) {
    std::vector<Positions> clouds = panel_chair();
    clouds.push_back(box({3, 0, 0}, {0.01, 0.01, 0.01}, kSpacing));
    Scene panel(clouds);
    panel.topology.strays = 1;
    const DividedComponents found = divided(panel, Scene(rods_chair()));
    EXPECT_EQ(found.among_target, std::vector<Index>{5});
    EXPECT_EQ(found.source.main().size(), 10u);
    EXPECT_EQ(found.source.labels.back(), 10);
}

TEST(DividedComponents, CounterpartsStayWhole) {
    const Scene rods(rods_chair());
    const DividedComponents found = divided(rods, rods);
    EXPECT_TRUE(found.among_target.empty() && found.among_source.empty());
    EXPECT_TRUE(found.kinds.empty());
    EXPECT_EQ(found.source.labels, rods.topology.labels);
}

TEST(DividedComponents, AFigureOfOnePieceIsNotDividedForItsHead) {
    const Positions body = shapes::sphere(900);
    const Positions head = (shapes::sphere(200) * 0.4).rowwise() + Eigen::RowVector3d(0, 0, 1.4);
    const DividedComponents found = divided(Scene({body, head}), Scene({together({body, head})}));
    EXPECT_TRUE(found.among_target.empty() && found.among_source.empty());
}

TEST(DividedComponents, WhatIsMarkedStaysWhole) {
    const Scene panel(panel_chair()), rods(rods_chair());
    const auto first_of = [](const Scene& scene, Index component) {
        return to_index(std::ranges::find(scene.topology.labels, component) -
                        scene.topology.labels.begin());
    };
    const std::vector<IndexPair> marks{{first_of(panel, 5), first_of(rods, 7)}};
    EXPECT_TRUE(divided(panel, rods, marks).among_target.empty());
}

TEST(DividedComponents, WhatSpoilsTheLikenessIsLeftOut) {
    std::vector<Positions> clouds = rods_chair();
    clouds.push_back(box({0.4, 0.45, 1.0}, {0.2, 0.1, 0.2}, 0.02));
    const DividedComponents found = divided(Scene(panel_chair()), Scene(clouds));
    EXPECT_EQ(found.among_target, std::vector<Index>{5});
    EXPECT_EQ(found.matching.target_alone, std::vector<Index>{10});
}

TEST(DividedComponents, SmallSharesAreNone) {
    std::vector<Positions> clouds = rods_chair();
    for (const int rod : {1, 3})  // inside
        clouds.push_back(box({rod_place(rod), 0.45, 0.6}, {0.01, 0.01, 0.01}, kSpacing));
    const DividedComponents found = divided(Scene(panel_chair()), Scene(clouds));
    EXPECT_EQ(found.among_target, std::vector<Index>{5});
    EXPECT_EQ(found.matching.target_alone, (std::vector<Index>{10, 11}));
}

TEST(DividedComponents, WhatLosesItsCounterpartIsMatchedOnceMore) {
    const Positions knob = box({1.5, 0, 0}, {0.3, 0.3, 0.3}, kSpacing);
    std::vector<Positions> panel = panel_chair(), rods = rods_chair();
    panel.push_back(knob);
    rods.push_back(knob);
    const Scene source(panel), target(rods);
    ComponentMatching matching;  // the panel with the knob
    for (Index leg = 0; leg < 5; ++leg) matching.matched.push_back({leg, leg});
    matching.matched.push_back({5, 10});
    matching.source_alone = {6};
    matching.target_alone = {5, 6, 7, 8, 9};
    Progress progress;
    const DividedComponents found =
        divide_components(source.view(), target.view(), matching, {{}, {}, {}}, progress);
    EXPECT_EQ(found.among_target, std::vector<Index>{5});
    EXPECT_EQ(std::ranges::count(found.matching.matched, IndexPair{6, 10}), 1);
    EXPECT_TRUE(found.matching.source_alone.empty() && found.matching.target_alone.empty());
}

TEST(DividedComponents, OfATargetThatLiesElsewhere) {
    const Scene panel(panel_chair());
    Scene rods(rods_chair());
    Similarity alignment;
    alignment.scale = 2.0;
    alignment.rotation << 0, -1, 0, 1, 0, 0, 0, 0, 1;
    alignment.translation = {3, 4, 5};
    const Positions images = alignment.inverse().apply(panel.positions), back = rods.positions;
    rods.positions = alignment.inverse().apply(rods.positions);
    const ComponentView source{panel.topology, panel.positions, panel.positions, images},
        target{rods.topology, rods.positions, rods.positions, back};
    Progress progress;
    const ComponentMatching matching =
        match_components(source, target, {}, alignment, {}, progress);
    const DividedComponents found =
        divide_components(source, target, matching, {{}, alignment, {}}, progress);
    EXPECT_EQ(found.among_target, std::vector<Index>{5});
    EXPECT_EQ(found.source.labels, divided(panel, Scene(rods_chair())).source.labels);
}

TEST(DividedComponents, AreTheSameForAnyNumberOfThreads) {
    const Scene panel(panel_chair()), rods(rods_chair());
    const auto with = [&](int threads) {
        const ThreadCount limit(threads);
        return divided(panel, rods);
    };
    const DividedComponents one = with(1), three = with(3);
    EXPECT_EQ(one.source.labels, three.source.labels);
    EXPECT_EQ(one.matching.matched, three.matching.matched);
}

TEST(DividedComponents, CanBeCancelled) {
    const Scene panel(panel_chair()), rods(rods_chair());
    Progress progress, ending([](std::string_view, double) { return false; });
    const ComponentMatching matching =
        match_components(panel.view(), rods.view(), {}, {}, {}, progress);
    EXPECT_THROW(divide_components(panel.view(), rods.view(), matching, {{}, {}, {}}, ending),
                 Cancelled);
}

/// A crown of one piece is not divided among thousands of leaves, and it takes no time to say so.
TEST(DividedComponents, ACrownIsNotDividedAmongLeaves) {
    constexpr Index kLeaves = 2000;
    const Positions crown = shapes::sphere(10000), places = shapes::sphere(kLeaves);
    std::vector<Positions> leaves;
    for (Index leaf = 0; leaf < kLeaves; ++leaf)
        leaves.push_back((shapes::sphere(8) * 0.02).rowwise() + places.row(leaf));
    const DividedComponents found = divided(Scene({crown}), Scene(leaves));
    EXPECT_TRUE(found.among_target.empty() && found.among_source.empty());
}

TEST(DividedComponents, AreToldOfOnlyAsDivided) {
    Scene panel(panel_chair());
    panel.topology.components[5].is_open = true;
    const Scene rods(rods_chair());
    const DividedComponents found = divided(panel, rods);
    Progress progress;
    ComponentGroups groups =
        group_components({found.source, panel.positions, panel.positions, panel.positions},
                         {found.target, rods.positions, rods.positions, rods.positions},
                         found.matching, {}, progress);
    groups.kinds = found.kinds;
    const std::string one = "one", two = "two";
    const std::vector<std::string> words =
        components_in_words(found.matching, groups, {found.source, one}, {found.target, two});
    ASSERT_EQ(words.size(), 1u);
    EXPECT_EQ(words[0].find("5 pieces of one and two were matched"), 0u) << words[0];
}

/// Clouds that lie in the same place: every point goes where it is.
Refinement staying(const Positions& source, const Positions& target) {
    Refinement map;
    map.source_images = source;
    map.target_images = target;
    map.source_product.resize(source.rows(), 12);
    map.source_product << source, source, source, source;
    map.target_product.resize(target.rows(), 12);
    map.target_product << target, target, target, target;
    return map;
}

/// A loose screw above the panel, in the place of the middle rod's group.
TEST(DividedComponents, GoAsWholesWhereOthersHaveJoinedThem) {
    std::vector<Positions> clouds = panel_chair();
    clouds.push_back(box({0, 0.45, 1.4}, {0.1, 0.1, 0.1}, kSpacing));
    const Scene rods(rods_chair()), panel(clouds);
    const DividedComponents found = divided(rods, panel);
    ASSERT_EQ(found.among_source, std::vector<Index>{5});
    const ComponentView source{found.source, rods.positions, rods.positions, rods.positions},
        target{found.target, panel.positions, panel.positions, panel.positions};
    Progress progress;
    ComponentGroups groups = group_components(source, target, found.matching, {}, progress);
    groups.kinds = found.kinds;
    const Index middle = groups.source.groups[to_size(std::ranges::find(rods.topology.labels, 7) -
                                                      rods.topology.labels.begin())];
    ASSERT_TRUE(groups.joined[to_size(middle)]);
    ComponentOptions options;
    options.fewest_points = 10000;
    const Refinement map =
        mapped_by_group(staying(rods.positions, panel.positions), source, target, {groups, {}},
                        {options, {}, Matrix3::Identity()}, progress);
    double widest = 0.0;
    for (std::size_t i = 0; i < rods.topology.labels.size(); ++i)
        if (rods.topology.labels[i] == 7)
            widest = std::max(widest, map.source_images(static_cast<Eigen::Index>(i), 0));
    EXPECT_GT(widest, 0.07);  // half of the rod is 0.035, half of its share 0.11
}

/// Outward, of a box().
Normals normals_of(const Positions& box) {
    const Eigen::RowVector3d least = box.colwise().minCoeff(), most = box.colwise().maxCoeff();
    Normals normals(box.rows(), 3);
    for (Eigen::Index i = 0; i < box.rows(); ++i)
        for (int axis = 0; axis < 3; ++axis)
            normals(i, axis) = (box(i, axis) == most[axis]) - (box(i, axis) == least[axis]);
    return normals;
}

Cloud cloud_of(const std::vector<Positions>& boxes) {
    std::vector<Positions> normals;
    for (const Positions& box : boxes) normals.push_back(normals_of(box));
    return {"chair", together(boxes), together(normals), {}, {}};
}

/// The chair with rods onto the paneled one: every rod fills its strip, and legs stay legs.
TEST(DividedComponents, OfAMorphFillThePanelRodByRod) {
    SKIP_WHERE_WATCHED();
    const Scene panel(panel_chair()), rods(rods_chair());
    MorphInput input;
    input.source = cloud_of(rods_chair());
    input.target = cloud_of(panel_chair());
    input.source_parts = rods.topology.labels;
    input.target_parts = panel.topology.labels;
    Progress progress;
    const Morph morph(std::move(input), {}, progress);
    std::vector<int> astray(10, 0), all(10, 0);
    for (const auto& [s, t] : morph.pairs()) {
        const Index from = rods.topology.labels[to_size(s)], to = panel.topology.labels[to_size(t)];
        ++all[to_size(from)];
        const bool is_right =
            from < 5 ? to == from
                     : to == 5 && std::abs(panel.positions(t, 0) - rod_place(from - 5)) < 0.16;
        astray[to_size(from)] += is_right ? 0 : 1;
    }
    for (std::size_t c = 0; c < all.size(); ++c) {
        EXPECT_GT(all[c], 0) << c;
        EXPECT_EQ(astray[c], 0) << c << " of " << all[c];
    }
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/registration/components.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "checks.hpp"
#include "joined_shapes.hpp"
#include "marked_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/morph/morph.hpp"
#include "registration/watched_options.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

constexpr Index kBody = 3000, kEye = 250, kRest = 1000;

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

ComponentView view(const Topology& topology, const Positions& positions, const Positions& images) {
    return {topology, positions, positions, images};
}

TEST(Components, AreMatchedByPlaceAndSize) {
    Progress progress;
    const Topology s = topology_of({900, 50, 40}), t = topology_of({800, 60, 50, 50});
    // The source's second is the target's third; the target's second is somewhere else.
    const Positions source =
        together({ball(900, 1, 0, 0, 0), ball(50, 0.1, 0, 2, 0), ball(40, 0.1, 0, -2, 0)});
    const Positions target = together({ball(800, 1.1, 0, 0, 0), ball(60, 0.1, 5, 0, 0),
                                       ball(50, 0.12, 0, 2.1, 0), ball(50, 0.08, 0, -2.1, 0)});
    const ComponentView from = view(s, source, source), onto = view(t, target, target);
    const ComponentMatching m = match_components(from, onto, {}, {}, {}, progress);
    EXPECT_EQ(m.matched, (std::vector<IndexPair>{{0, 0}, {1, 2}, {2, 3}}));
    EXPECT_TRUE(m.source_alone.empty());
    EXPECT_EQ(m.target_alone, std::vector<Index>{1});
    const std::string one = "one", two = "two";
    const ComponentGroups groups = group_components(from, onto, m, {}, progress);
    const auto words = components_in_words(m, groups, {s, one}, {t, two});
    ASSERT_EQ(words.size(), 1u);  // nothing else lies where the map takes the fourth
    EXPECT_NE(words[0].find("3 pieces of one and two"), std::string::npos);
}

TEST(Components, OfOtherSizesDontBelongTogetherUnlessTheMapSaysSo) {
    Progress progress;
    const Topology s = topology_of({900, 100}), t = topology_of({900, 100});
    const Positions source = together({ball(900, 1, 0, 0, 0), ball(100, 0.1, 0, 2, 0)});
    const Positions target = together({ball(900, 1, 0, 0, 0), ball(100, 0.5, 0, 2, 0)});
    const Positions onto_body = 0.5 * source, from_body = 0.5 * target;
    const ComponentMatching apart = match_components(
        view(s, source, onto_body), view(t, target, from_body), {}, {}, {}, progress);
    EXPECT_EQ(apart.matched.size(), 1u);
    EXPECT_EQ(apart.source_alone, std::vector<Index>{1});
    const ComponentMatching together_ =
        match_components(view(s, source, source), view(t, target, target), {}, {}, {}, progress);
    EXPECT_EQ(together_.matched.size(), 2u);
}

TEST(Components, ThatMarksJoinBelongTogether) {
    Progress progress;
    // Two eyes, and a map that leaves them where they are: marks exchange them.
    const Topology topology = topology_of({900, 50, 50});
    const Positions both =
        together({ball(900, 1, 0, 0, 0), ball(50, 0.2, 1, 0.3, 0), ball(50, 0.2, 1, -0.3, 0)});
    const std::vector<IndexPair> marks{{910, 960}, {960, 910}};
    const ComponentView shape = view(topology, both, both);
    EXPECT_EQ(match_components(shape, shape, {}, {}, {}, progress).matched,
              (std::vector<IndexPair>{{0, 0}, {1, 1}, {2, 2}}));
    EXPECT_EQ(match_components(shape, shape, marks, {}, {}, progress).matched,
              (std::vector<IndexPair>{{0, 0}, {1, 2}, {2, 1}}));
}

TEST(Components, OfOtherSizesAreJoinedByOneMark) {
    Progress progress;
    const Topology s = topology_of({900, 100}), t = topology_of({900, 100});
    const Positions source = together({ball(900, 1, 0, 0, 0), ball(100, 0.1, 0, 2, 0)});
    const Positions target = together({ball(900, 1, 0, 0, 0), ball(100, 0.5, 0, 2, 0)});
    const Positions onto_body = 0.5 * source, from_body = 0.5 * target;
    const std::vector<Feature> marks{point_feature("eye", 950, 950)};
    EXPECT_EQ(match_components(view(s, source, onto_body), view(t, target, from_body),
                               joining_marks(marks), {}, {}, progress)
                  .matched,
              (std::vector<IndexPair>{{0, 0}, {1, 1}}));
}

/// The one component is matched with the figure's, and the foot belongs to it.
void expect_foot_on_figure(const ComponentView& loose, const ComponentView& figure,
                           std::span<const IndexPair> marks, std::vector<IndexPair> matched,
                           Index foot) {
    Progress progress;
    const ComponentMatching m = match_components(loose, figure, marks, {}, {}, progress);
    EXPECT_EQ(m.matched, matched);
    EXPECT_EQ(m.source_alone, std::vector<Index>{foot});
    const ComponentGroups groups = group_components(loose, figure, m, {}, progress);
    EXPECT_TRUE(groups.source_vanishing.empty());
    const Index row =
        to_index(std::ranges::find(loose.topology.labels, foot) - loose.topology.labels.begin());
    const Index group = groups.target.groups[to_size(marks[0].target)];
    EXPECT_EQ(groups.source.groups[to_size(row)], group);
    EXPECT_EQ(groups.source.anchors[to_size(row)], -1);
    EXPECT_TRUE(groups.joined[to_size(group)]);
}

TEST(Components, AFootThatIsMarkedOnAFigureOfOnePieceIsOnIt) {
    const Positions body = ball(900, 1, 0, 0, 0), foot = ball(100, 0.2, 0.3, 0, -1.2);
    const Topology loose = topology_of({900, 100}), figure = topology_of({1000});
    const Positions source = together({body, foot});
    // The map has no room for it, too.
    Positions images = source;
    images.bottomRows(100).rowwise().normalize();
    expect_foot_on_figure(view(loose, source, images), view(figure, source, source),
                          std::vector<IndexPair>{{950, 950}}, {{0, 0}}, 1);
    // A hat besides, and a mark from the body to it.
    const Topology with_hat = topology_of({1000, 90});
    const Positions target = together({source, ball(90, 0.3, 0, 0, 1.5)});
    expect_foot_on_figure(view(loose, source, source), view(with_hat, target, target),
                          std::vector<IndexPair>{{950, 950}, {10, 1010}}, {{0, 0}}, 1);
    // Neither body is most of its shape.
    const Topology two = topology_of({500, 400, 50}), twins = topology_of({500, 450});
    const Positions second = ball(400, 1, 4, 0, 0), toe = ball(50, 0.2, 4.3, 0, -1.2);
    const Positions three = together({ball(500, 1, 0, 0, 0), second, toe}),
                    both = together({ball(500, 1, 0, 0, 0), second, toe});
    expect_foot_on_figure(view(two, three, three), view(twins, both, both),
                          std::vector<IndexPair>{{920, 920}}, {{0, 0}, {1, 1}}, 2);
    // Two marks outweigh one that comes before them.
    expect_foot_on_figure(view(two, three, three), view(twins, both, both),
                          std::vector<IndexPair>{{930, 920}, {910, 10}, {920, 910}},
                          {{0, 0}, {1, 1}}, 2);
}

TEST(Components, AFigureThatIsMarkedOnAFootIsNoPartOfIt) {
    // The figure has no counterpart: the target has another foot, far away, and something else.
    Progress progress;
    const Positions foot = ball(100, 0.2, 0.3, 0, -1.2);
    const Topology s = topology_of({500, 490, 100}), t = topology_of({500, 100});
    const Positions source = together({ball(500, 1, 0, 0, 0), ball(490, 1, 40, 0, 0), foot});
    const Positions target = together({ball(500, 1, 0, 0, 0), foot});
    const std::vector<IndexPair> marks{{1050, 550}, {600, 550}};
    const ComponentMatching m =
        match_components(view(s, source, source), view(t, target, target), marks, {}, {}, progress);
    EXPECT_EQ(m.matched, (std::vector<IndexPair>{{0, 0}, {2, 1}}));
    EXPECT_EQ(m.source_alone, std::vector<Index>{1});
    EXPECT_TRUE(m.on_others.empty());
}

TEST(Components, TooSmallToFollowKeepTheirPlaceWhereThereIsRoom) {
    // A ball in two halves, and forty specks around it that both have.
    Progress progress;
    std::vector<Positions> parts{ball(500, 1, 0, 0, 0), ball(500, 1, 4, 0, 0)};
    std::vector<Index> sizes{500, 500};
    for (Index k = 0; k < 40; ++k) {
        parts.push_back(ball(5, 0.05, 2, 0.5 * (k - 20), 3));
        sizes.push_back(5);
    }
    Topology topology = topology_of(sizes);
    topology.strays = 40;
    const Positions all = together(parts);
    const ComponentView shape = view(topology, all, all);
    const ComponentMatching m = match_components(shape, shape, {}, {}, {}, progress);
    EXPECT_EQ(m.matched, (std::vector<IndexPair>{{0, 0}, {1, 1}}));
    const ComponentGroups groups = group_components(shape, shape, m, {}, progress);
    EXPECT_TRUE(groups.source_vanishing.empty());
    for (const Index group : groups.source.groups) EXPECT_GE(group, 0);
}

TEST(Components, OfThinShapesAreToldFromThick) {
    Progress progress;
    // A disc and a ball of the same size change places.
    const Topology topology = topology_of({900, 100, 100});
    Positions disc = ball(100, 0.25, 0, 0, 0);
    disc.col(2) *= 0.05;
    const Positions body = ball(900, 1, 0, 0, 0), round = ball(100, 0.2, 0, 0, 0);
    const Eigen::RowVector3d here(1.3, 0.3, 0), there(1.3, -0.3, 0);
    const Positions source = together({body, disc.rowwise() + here, round.rowwise() + there}),
                    target = together({body, round.rowwise() + here, disc.rowwise() + there});
    // The map takes both to the middle and says nothing.
    Positions images = source, back = target;
    images.bottomRows(200).rowwise() = Eigen::RowVector3d(1.3, 0, 0);
    back.bottomRows(200).rowwise() = Eigen::RowVector3d(1.3, 0, 0);
    EXPECT_EQ(match_components(view(topology, source, images), view(topology, target, back), {}, {},
                               {}, progress)
                  .matched,
              (std::vector<IndexPair>{{0, 0}, {1, 2}, {2, 1}}));
}

TEST(Components, WithoutRoomGoWithWhatIsNearest) {
    Progress progress;
    // A plate on a ball, and a kernel in its middle: the map takes both onto the ball's own image.
    const Topology s = topology_of({900, 100, 100}), t = topology_of({900});
    Positions plate = ball(100, 0.3, 0, 0, 0);
    plate.col(2) = 0.03 * plate.col(2).array() + 1.05 -
                   0.5 * plate.leftCols(2).rowwise().squaredNorm().array();
    const Positions body = ball(900, 1, 0, 0, 0);
    const Positions source = together({body, plate, ball(100, 0.3, 0.01, 0, 0)});
    Positions images = source;
    images.bottomRows(200).rowwise().normalize();
    const ComponentView from = view(s, source, images), onto = view(t, body, body);
    const ComponentMatching m = match_components(from, onto, {}, {}, {}, progress);
    EXPECT_EQ(m.source_alone, (std::vector<Index>{1, 2}));
    const ComponentGroups groups = group_components(from, onto, m, {}, progress);
    EXPECT_EQ(groups.source_vanishing, (std::vector<Index>{1, 2}));
    EXPECT_TRUE(groups.target_appearing.empty());
    EXPECT_EQ(groups.joined, std::vector<char>{0});
    std::vector<Index> of_plate, of_kernel;
    for (Index i = 0; i < 900; ++i) EXPECT_EQ(groups.source.anchors[to_size(i)], -1);
    EXPECT_EQ(groups.source.loose, rows_from(900, 200));
    EXPECT_TRUE(groups.target.loose.empty());
    for (Index i = 900; i < 1100; ++i)
        (i < 1000 ? of_plate : of_kernel).push_back(groups.source.anchors[to_size(i)]);
    // The plate lies on the points under it; they would tear the kernel, which goes to one of them.
    for (std::size_t k = 0; k < of_plate.size(); ++k)
        EXPECT_LT((body.row(of_plate[k]) - plate.row(static_cast<Eigen::Index>(k))).norm(), 0.15);
    EXPECT_EQ(std::ranges::count(of_kernel, of_kernel.front()), 100);
    const std::string one = "one", two = "two";
    EXPECT_TRUE(
        checks::mentions(components_in_words(m, groups, {s, one}, {t, two}),
                         "2 pieces of one (18 % of it) have no counterpart and shrink into"));
}

TEST(Components, ThatAreStraysAreNotToldOf) {
    Progress progress;
    // A plate that lies on a ball, and a speck on it.
    Topology s = topology_of({900, 100, 5});
    s.strays = 1;
    const Topology t = topology_of({900});
    const Positions body = ball(900, 1, 0, 0, 0);
    const Positions source = together({body, ball(100, 0.2, 0, 0, 1.1), ball(5, 0.02, 0, 0, -1)});
    const Positions images = source.rowwise().normalized();
    const ComponentView from = view(s, source, images), onto = view(t, body, body);
    const ComponentMatching m = match_components(from, onto, {}, {}, {}, progress);
    const ComponentGroups groups = group_components(from, onto, m, {}, progress);
    for (Index i = 900; i < 1005; ++i) EXPECT_GE(groups.source.anchors[to_size(i)], 0) << i;
    EXPECT_EQ(groups.source.loose, rows_from(900, 100));
    EXPECT_EQ(groups.source_vanishing, std::vector<Index>{1});
}

TEST(Components, WithRoomOfTheirOwnKeepTheirPlace) {
    Progress progress;
    // Head and body, and a figure of one piece.
    const Topology s = topology_of({900, 300}), t = topology_of({1200});
    const Positions source = together({ball(900, 1, 0, 0, 0), ball(300, 0.4, 0, 0, 1.4)});
    const ComponentView from = view(s, source, source), onto = view(t, source, source);
    const ComponentMatching m = match_components(from, onto, {}, {}, {}, progress);
    EXPECT_EQ(m.source_alone, std::vector<Index>{1});
    const ComponentGroups groups = group_components(from, onto, m, {}, progress);
    EXPECT_TRUE(groups.source_vanishing.empty());
    EXPECT_EQ(groups.joined, std::vector<char>{1});
    for (const Index anchor : groups.source.anchors) EXPECT_EQ(anchor, -1);
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

TEST(Components, KeepToRegionsAsWell) {
    SKIP_WHERE_WATCHED();
    MorphInput input;
    input.source = {"one", creature(2.0, 0.2, 0.9), {}, {}, {}};
    input.target = {"two", creature(2.3, 0.15, 1.1), {}, {}, {}};
    Feature region;
    region.name = "rear";
    region.kind = FeatureKind::kRegion;
    for (Index i = 0; i < kBody; ++i) {
        if (input.source.positions(i, 0) < -1.2) region.source.rows.push_back(i);
        if (input.target.positions(i, 0) < -1.0) region.target.rows.push_back(i);
    }
    input.features = {region};
    Progress progress;
    const Morph morph(std::move(input), {}, progress);
    for (const auto& [s, t] : morph.pairs()) {
        EXPECT_EQ(s < kBody, t < kBody);
        EXPECT_EQ(std::ranges::binary_search(region.source.rows, s),
                  std::ranges::binary_search(region.target.rows, t))
            << s << " with " << t;
    }
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
                                 "2 pieces of one (" +
                                     std::to_string(std::lround(50000.0 / (kBody + 2 * kEye))) +
                                     " % of it) have no counterpart and shrink"));
    // All of an eye goes to where it touches the body.
    const Positions images = morph.source_to_target(progress).middleRows(kBody, kEye);
    const double size = (images.colwise().maxCoeff() - images.colwise().minCoeff()).norm();
    EXPECT_LT(size, 4.0 * 0.2);
}

/// A ball; under it a plate, or a ball at each end of one and a small one in between.
Positions with_plate() {
    Positions plate = shapes::sphere(kRest);
    plate.col(0) *= 2.0;
    plate.col(1) *= 0.6;
    plate.col(2) = plate.col(2).array() * 0.1 - 1.4;
    return together({shapes::sphere(kBody), plate});
}

/// Across the plate, so that it isn't divided among them.
Positions with_balls() {
    return together({shapes::sphere(kBody), ball(kRest / 2, 0.35, -0.6, -1.6, -1.5),
                     ball(kRest / 4, 0.3, 0.4, 1.3, -1.5), ball(kRest / 4, 0.2, -0.2, 0.3, -1.5)});
}

const Topology& plate_topology() {
    static const Topology topology = topology_of({kBody, kRest});
    return topology;
}

const Topology& balls_topology() {
    static const Topology topology = topology_of({kBody, kRest / 2, kRest / 4, kRest / 4});
    return topology;
}

TEST(Components, ThatAreAloneOnBothSidesAreOneAnothersAllTogether) {
    Progress progress;
    const Positions source = with_plate(), target = with_balls();
    const ComponentView from = view(plate_topology(), source, source),
                        onto = view(balls_topology(), target, target);
    ComponentMatching m = match_components(from, onto, {}, {}, {}, progress);
    ASSERT_EQ(m.matched, (std::vector<IndexPair>{{0, 0}}));  // each ball is too small for the plate
    match_rest(m, from, onto, {}, {}, progress);
    EXPECT_EQ(m.matched, (std::vector<IndexPair>{{0, 0}, {1, 1}}));
    EXPECT_EQ(m.source_rest, std::vector<Index>{1});
    EXPECT_EQ(m.target_rest, (std::vector<Index>{1, 2, 3}));
    const ComponentGroups groups = group_components(from, onto, m, {}, progress);
    EXPECT_EQ(groups.count, 2);
    EXPECT_EQ(groups.joined, (std::vector<char>{0, 0}));
    EXPECT_TRUE(groups.source_vanishing.empty() && groups.target_appearing.empty());
    for (const GroupedPoints* side : {&groups.source, &groups.target})
        for (Index i = 0; i < kBody + kRest; ++i) {
            EXPECT_EQ(side->groups[to_size(i)], i < kBody ? 0 : 1);
            EXPECT_EQ(side->anchors[to_size(i)], -1);
        }
    const std::string one = "one", two = "two";
    const auto words =
        components_in_words(m, groups, {plate_topology(), one}, {balls_topology(), two});
    ASSERT_EQ(words.size(), 1u);
    EXPECT_NE(words[0].find("1 piece of one and 3 of two"), std::string::npos) << words[0];
}

TEST(Components, ThatAreAloneArentOneAnothersWhereTheyAreLittleOrFarOrOnOthers) {
    Progress progress;
    const Positions source = with_plate(), target = with_balls();
    const ComponentView from = view(plate_topology(), source, source),
                        onto = view(balls_topology(), target, target);
    const ComponentMatching before = match_components(from, onto, {}, {}, {}, progress);
    const auto rest = [&](const ComponentView& there, const ComponentMatching& matching,
                          const ComponentOptions& options) {
        ComponentMatching m = matching;
        match_rest(m, from, there, {}, options, progress);
        return m.target_rest;
    };
    EXPECT_EQ(rest(onto, before, {}), (std::vector<Index>{1, 2, 3}));
    ComponentOptions large;
    large.rest_share = 1.01 * kRest / (kBody + kRest);
    EXPECT_TRUE(rest(onto, before, large).empty());
    Positions far = target;
    far.bottomRows(kRest).col(2).array() += 12.0;
    EXPECT_TRUE(rest(view(balls_topology(), far, far), before, {}).empty());
    ComponentMatching marked = before;  // the first ball belongs onto the source's ball
    marked.on_others = {{0, 1}};
    EXPECT_EQ(rest(onto, marked, {}), (std::vector<Index>{2, 3}));
    marked.on_others = {{0, 1}, {0, 2}, {0, 3}};
    EXPECT_TRUE(rest(onto, marked, {}).empty());
    ComponentMatching none = before;  // nothing is alone on the source
    none.source_alone.clear();
    EXPECT_TRUE(rest(onto, none, {}).empty());
}

TEST(Components, ThatAreAloneOnBothSidesCoverOneAnother) {
    SKIP_WHERE_WATCHED();
    MorphInput input;
    input.source = {"one", with_plate(), {}, {}, {}};
    input.target = {"two", with_balls(), {}, {}, {}};
    Progress progress;
    const Morph morph(std::move(input), {}, progress);
    EXPECT_TRUE(checks::is_total(morph.pairs(), kBody + kRest, kBody + kRest));
    EXPECT_TRUE(checks::mentions(morph.report().warnings,
                                 "one another as a whole: 1 piece of one and 3 of two"));
    std::array<int, 2> astray{};
    for (const auto& [s, t] : morph.pairs())
        astray[s < kBody ? 0 : 1] += (s < kBody) != (t < kBody);
    EXPECT_EQ(astray, (std::array<int, 2>{}));
}

constexpr Index kBars = 30, kPoints = 120;

/// A ring of thirty bars around a ball; on the target some are longer, others shorter, and all are
/// slanted. Marks on the ball say how it lies.
MorphInput rings() {
    const auto ring = [](bool is_target) {
        std::vector<Positions> parts{shapes::sphere(kBody)};
        for (Index k = 0; k < kBars; ++k) {
            Positions bar = shapes::sphere(kPoints) * 0.09;
            bar.col(2) *= (2.0 + 0.4 * (7 * k % 5)) * (is_target ? 0.8 + 0.3 * (k % 3) : 1.0);
            bar.col(0) += (is_target ? 0.4 : 0.0) * bar.col(2);
            const double angle = 2.0 * std::numbers::pi * k / kBars;
            parts.push_back(bar.rowwise() +
                            Eigen::RowVector3d(2.2 * std::cos(angle), 2.2 * std::sin(angle), 0.0));
        }
        return together(parts);
    };
    MorphInput input;
    input.source = {"one", ring(false), {}, {}, {}};
    input.target = {"two", ring(true), {}, {}, {}};
    for (Index k = 0; k < 8; ++k)
        input.features.push_back(point_feature("mark " + std::to_string(k), 370 * k, 370 * k));
    return input;
}

TEST(Components, AreMappedByThemselvesHoweverMany) {
    SKIP_WHERE_WATCHED();
    const Positions target = rings().target.positions;
    Progress progress;
    const Morph morph(rings(), {}, progress);
    const auto part = [](Index row) { return row < kBody ? -1 : (row - kBody) / kPoints; };
    for (const auto& [s, t] : morph.pairs()) ASSERT_EQ(part(s), part(t)) << s << " with " << t;
    // Of every bar, each point belongs to the same share of its length.
    const Positions images = morph.source_to_target(progress), off = images - target;
    EXPECT_LT(off.bottomRows(kBars * kPoints).rowwise().norm().mean(), 0.05);

    MorphOptions one_thread;
    one_thread.threads = 1;
    const Morph again(rings(), one_thread, progress);
    EXPECT_EQ(again.source_to_target(progress), images);
    EXPECT_EQ(again.pairs(), morph.pairs());

    // A mark that moves on the ball leaves the bars with their partners.
    std::vector<Feature> moved = rings().features;
    Index& row = moved[3].target.rows.front();
    row = shapes::nearest_row(target, target.row(row).transpose() + Vector3(0.1, 0.1, 0.1));
    const Morph updated = morph.updated(moved, progress);
    for (const auto& [s, t] : updated.pairs()) ASSERT_EQ(part(s), part(t)) << s << " with " << t;
}

TEST(Components, CanBeStoppedAmongThem) {
    SKIP_WHERE_WATCHED();
    int asked = 0;
    Progress progress(
        [&](std::string_view stage, double) { return stage != "pieces" || ++asked < 3; });
    EXPECT_THROW(Morph(rings(), {}, progress), Cancelled);
    EXPECT_EQ(asked, 3);
}

TEST(Example, Components) {
    Progress progress;
    const Topology source_topology = topology_of({900, 50}),
                   target_topology = topology_of({800, 50});
    const Positions source = together({ball(900, 1, 0, 0, 0), ball(50, 0.1, 0, 2, 0)});
    const Positions target = together({ball(800, 1.1, 0, 0, 0), ball(50, 0.12, 0, 2.1, 0)});
    const Positions &source_normals = source, &target_normals = target;
    const Positions &source_images = source, &target_images = target;
    const std::vector<IndexPair> marks;
    const Similarity alignment;
    // --- example
    const ComponentView on_source{source_topology, source, source_normals, source_images};
    const ComponentView on_target{target_topology, target, target_normals, target_images};
    const ComponentMatching found =
        match_components(on_source, on_target, marks, alignment, {}, progress);
    const std::vector<IndexPair>& partners = found.matched;
    // --- end of the example
    EXPECT_EQ(partners, (std::vector<IndexPair>{{0, 0}, {1, 1}}));
    EXPECT_TRUE(found.source_alone.empty());
}

}  // namespace
}  // namespace pointmorph

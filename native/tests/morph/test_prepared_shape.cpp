#include "morph/prepared_shape.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <string>
#include <string_view>
#include <vector>

#include "pointmorph/base/error.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

PreparedShape prepared(const Cloud& cloud, const PreparationOptions& options = {}) {
    Progress progress;
    return prepare({cloud}, options, progress);
}

Cloud ball(Index count) {
    Cloud cloud;
    cloud.name = "ball";
    cloud.positions = (2.0 * shapes::sphere(count)).rowwise() + Eigen::RowVector3d(5.0, -3.0, 1.0);
    return cloud;
}

Cloud permuted(const Cloud& cloud, std::span<const Index> order) {
    Cloud result = cloud;
    result.positions = gather(cloud.positions, order);
    if (cloud.normals.rows() > 0) result.normals = gather(cloud.normals, order);
    return result;
}

TEST(PreparedShape, RowsGoBothWaysAndPositionsComeBack) {
    const Cloud cloud = ball(900);
    const PreparedShape shape = prepared(cloud);
    ASSERT_EQ(shape.size(), 900);
    EXPECT_EQ(inverse_order(shape.given_rows), shape.sorted_rows);
    const Positions back = gather(shape.unit.restore(shape.positions), shape.sorted_rows);
    EXPECT_LT((back - cloud.positions).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_LE(shape.positions.rowwise().norm().maxCoeff(), 1.0 + 1e-12);
    EXPECT_EQ(to_given(shape.sorted_rows, shape).size(), 900u);
    for (Index given = 0; given < 900; ++given)
        EXPECT_EQ(shape.given_rows[to_size(shape.sorted_rows[to_size(given)])], given);
}

TEST(PreparedShape, PointsAtOnePlaceShareARowThatTheLowestStandsFor) {
    const Cloud once = ball(500);
    Cloud thrice = once;
    thrice.positions = once.positions.replicate(3, 1);
    const PreparedShape single = prepared(once), shape = prepared(thrice);
    EXPECT_EQ(shape.positions, single.positions);
    EXPECT_EQ(shape.given_rows, single.given_rows);  // the first copies are the lowest rows
    for (Index given = 0; given < 1500; ++given)
        EXPECT_EQ(shape.sorted_rows[to_size(given)], single.sorted_rows[to_size(given % 500)]);

    // Every copy is paired: with the one partner, and no pair twice.
    Pairing sorted;
    for (Index i = 0; i < 500; ++i) sorted.push_back({i, i});
    const Pairing pairs = to_given(sorted, shape, single);
    EXPECT_EQ(pairs.size(), 1500u);
    for (const IndexPair& pair : pairs) EXPECT_EQ(pair.source % 500, pair.target);
    EXPECT_TRUE(std::ranges::is_sorted(pairs));
}

TEST(PreparedShape, DoesNotDependOnTheOrderOfTheGivenRows) {
    const Cloud cloud = ball(800);
    const auto order = shapes::permutation(800, 11);
    const PreparedShape a = prepared(cloud), b = prepared(permuted(cloud, order));
    EXPECT_EQ(a.positions, b.positions);
    EXPECT_EQ(a.normals, b.normals);
    EXPECT_EQ(a.nearest.indices, b.nearest.indices);
    EXPECT_EQ(a.topology.labels, b.topology.labels);
    EXPECT_EQ(gather(a.radii, order), b.radii);
    for (std::size_t i = 0; i < 800; ++i)
        EXPECT_EQ(a.given_rows[i], order[to_size(b.given_rows[i])]);
}

TEST(PreparedShape, BothAreAsEachAlone) {
    const Cloud source = ball(600), target = ball(700);
    Progress progress;
    const PreparedShapes both = prepare_both({.source = source, .target = target}, {}, progress);
    EXPECT_EQ(both.source.normals, prepared(source).normals);
    EXPECT_EQ(both.target.normals, prepared(target).normals);
    EXPECT_EQ(both.target.nearest.indices, prepared(target).nearest.indices);
    EXPECT_EQ(both.target.topology.components.size(), 1u);
}

TEST(PreparedShape, GivenNormalsAreKeptAndEstimatedOnesAgree) {
    Cloud cloud = ball(900);
    const Positions directions = shapes::sphere(900);
    const PreparedShape estimated = prepared(cloud);
    EXPECT_FALSE(estimated.normals_given);
    const Values along =
        (gather(directions, estimated.given_rows).array() * estimated.normals.array())
            .rowwise()
            .sum();
    EXPECT_GT(std::abs(along.sum()), 0.99 * 900);  // all outward, or all inward

    cloud.normals = 3.0 * directions;
    const PreparedShape given = prepared(cloud);
    EXPECT_TRUE(given.normals_given);
    EXPECT_FALSE(given.normals_reversed);
    EXPECT_LT((given.normals - gather(directions, given.given_rows)).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_EQ(completed(cloud, given).normals, cloud.normals);

    cloud.normals = -directions;
    const PreparedShape inward = prepared(cloud);
    EXPECT_TRUE(inward.normals_reversed);
    EXPECT_EQ(completed(cloud, inward).normals, -cloud.normals);
    EXPECT_LT((inward.normals - given.normals).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(PreparedShape, TurningTwiceChangesNothing) {
    Cloud cloud;
    cloud.positions = shapes::grid(25);
    const PreparedShape shape = prepared(cloud);
    ASSERT_TRUE(shape.loops.has_value());
    ASSERT_EQ(shape.loops->size(), 1u);
    const PreparedShape once = with_normals_reversed(shape), twice = with_normals_reversed(once);
    EXPECT_EQ(once.normals, Normals(-shape.normals));
    EXPECT_EQ(BoundaryLoop(once.loops->front().rbegin(), once.loops->front().rend()),
              shape.loops->front());
    EXPECT_EQ(twice.normals, shape.normals);
    EXPECT_EQ(twice.loops, shape.loops);
}

TEST(PreparedShape, RadiiAreTheSpacingInGivenLengthsOrThoseGiven) {
    Cloud cloud = ball(2000);
    const PreparedShape shape = prepared(cloud);
    // Each of 2,000 points on a sphere of radius 2 has this share of its area.
    const double spacing = std::sqrt(4.0 * std::acos(-1.0) * 4.0 / 2000);
    EXPECT_NEAR(shape.radii.mean(), spacing, 0.15 * spacing);
    EXPECT_GT(shape.radii.minCoeff(), 0.0);
    EXPECT_EQ(completed(cloud, shape).radii, shape.radii);
    cloud.radii = Values::LinSpaced(2000, 1.0, 2.0);
    EXPECT_EQ(prepared(cloud).radii, cloud.radii);
}

TEST(PreparedShape, StraysAreLeftOutAndTheNearestStandForThem) {
    Cloud cloud = ball(1000);
    cloud.positions.conservativeResize(1002, 3);
    cloud.positions.row(1000) << 90, -3, 1;
    cloud.positions.row(1001) << 5, 80, 1;
    const PreparedShape shape = prepared(cloud);
    EXPECT_EQ(shape.left_out, 2);
    ASSERT_EQ(shape.size(), 1000);
    EXPECT_EQ(shape.nearest.size(), 1000);
    for (const Index given : {1000, 1001}) {
        const Index stands_in = shape.given_rows[to_size(shape.sorted_rows[to_size(given)])];
        Index nearest;
        (cloud.positions.topRows(1000).rowwise() - cloud.positions.row(given))
            .rowwise()
            .squaredNorm()
            .minCoeff(&nearest);
        EXPECT_EQ(stands_in, nearest);
    }
}

TEST(PreparedShape, ScatteredPointsMakeNoDifference) {
    Cloud clean = ball(2000);
    clean.positions = shapes::torus(2000, 0.4);
    Cloud dusty = clean;
    constexpr Index kDust = 20;
    dusty.positions.conservativeResize(2000 + kDust, 3);
    dusty.positions.bottomRows(kDust) = 2.0 * shapes::cube_noise(kDust);
    dusty.positions.bottomRows(kDust).col(2).array() += 3.0;
    // In any order of the rows.
    const auto order = shapes::permutation(2000 + kDust, 5);
    const PreparedShape expected = prepared(clean), shape = prepared(permuted(dusty, order));
    EXPECT_EQ(shape.left_out, kDust);
    EXPECT_EQ(shape.positions, expected.positions);
    EXPECT_EQ(shape.normals, expected.normals);
    EXPECT_EQ(shape.nearest.indices, expected.nearest.indices);
    EXPECT_EQ(shape.topology.labels, expected.topology.labels);
    EXPECT_EQ(shape.topology.strays, 0);
    EXPECT_EQ(shape.unit.scale, expected.unit.scale);
    for (Index given = 0; given < 2000 + kDust; ++given) {
        const Index row = order[to_size(given)], sorted = shape.sorted_rows[to_size(given)];
        const Index own =
            row < 2000 ? row : shapes::nearest_row(clean.positions, dusty.positions.row(row));
        EXPECT_EQ(sorted, expected.sorted_rows[to_size(own)]);
        EXPECT_EQ(shape.radii[given], expected.radii[own]);
        EXPECT_EQ(order[to_size(shape.given_rows[to_size(sorted)])], own);
    }
}

TEST(PreparedShape, MarkedPointsAreNotLeftOut) {
    Cloud source = ball(2000);
    source.positions.conservativeResize(2001, 3);
    source.positions.row(2000) << 5, -3, 5;  // a tip, half as far out as the ball is large
    const Cloud target = source;
    Progress progress;
    EXPECT_EQ(prepared(source).left_out, 1);
    const std::vector<Feature> features{point_feature("tip", 2000, 17)};
    const PreparedShapes shapes =
        prepare_both({.source = source, .target = target, .features = features}, {}, progress);
    const auto own = [](const PreparedShape& shape, Index given) {
        return shape.given_rows[to_size(shape.sorted_rows[to_size(given)])];
    };
    EXPECT_EQ(own(shapes.source, 2000), 2000);
    EXPECT_NE(own(shapes.target, 2000), 2000);
    EXPECT_EQ(shapes.source.left_out, 0);
    EXPECT_EQ(shapes.target.left_out, 1);
}

TEST(PreparedShape, ProgressNeverGoesBackward) {
    Cloud source = ball(3000);
    source.positions.conservativeResize(3030, 3);
    source.positions.middleRows(3000, 20) =
        (10.0 * shapes::cube_noise(20)).rowwise() + Eigen::RowVector3d(30.0, 0.0, 0.0);
    source.positions.bottomRows(10) =
        (0.1 * shapes::sphere(10)).rowwise() + Eigen::RowVector3d(0.0, 20.0, 0.0);
    const Cloud target = source;
    std::string last_stage;
    double last = 0.0;
    Progress progress(
        [&](std::string_view stage, double fraction) {
            if (stage == "topology") return true;  // which looks at each component anew
            const bool is_next = stage != last_stage || fraction >= last - 1e-12;
            EXPECT_TRUE(is_next) << stage << ", " << last << " to " << fraction;
            last_stage = stage;
            last = fraction;
            return true;
        },
        std::chrono::milliseconds(0));
    EXPECT_GT(prepare_both({.source = source, .target = target}, {}, progress).source.left_out, 0);
}

TEST(PreparedShape, PointsOfFacesAreNeverLeftOut) {
    Cloud cloud = ball(1000);
    cloud.positions.conservativeResize(1060, 3);
    cloud.positions.bottomRows(60) =
        (10.0 * shapes::cube_noise(60)).rowwise() + Eigen::RowVector3d(30.0, 0.0, 0.0);
    const std::vector<Index> parts(1060, 0);
    Progress progress;
    EXPECT_EQ(prepare({cloud, parts}, {}, progress).left_out, 0);
    cloud.positions.conservativeResize(1020, 3);
    EXPECT_EQ(prepared(cloud).left_out, 20);
}

TEST(PreparedShape, TheBoundaryIsFoundOrTheOneThatIsGiven) {
    constexpr Index kSide = 25;
    Cloud cloud;
    cloud.name = "grid";
    cloud.positions = shapes::grid(kSide);
    const PreparedShape shape = prepared(cloud);
    Progress progress;
    const Boundary found = find_boundary(shape, {}, {}, progress);
    EXPECT_EQ(found.found, 1);
    EXPECT_TRUE(is_rim(shape, found.loop));
    auto border = shapes::grid_border(kSide);
    std::vector<Index> rows = to_given(found.loop, shape);
    std::ranges::sort(rows);
    std::vector<Index> expected(border.begin(), border.end());
    std::ranges::sort(expected);
    EXPECT_EQ(rows, expected);

    const Boundary given = find_boundary(shape, border, {}, progress);
    EXPECT_EQ(given.found, 1);
    EXPECT_EQ(given.loop.size(), border.size());
    border.front() = kSide * kSide;
    EXPECT_THROW(find_boundary(shape, border, {}, progress), FeatureError);

    const Boundary none = find_boundary(prepared(ball(900)), {}, {}, progress);
    EXPECT_EQ(none.found, 0);
    EXPECT_FALSE(is_rim(prepared(ball(900)), none.loop));
}

TEST(PreparedShape, TheTopologyCanBeLookedAtAgainMoreClosely) {
    constexpr TopologyOptions kAtAGlance{.cells = 40, .points = 200};
    const Cloud cloud = ball(900);
    const PreparedShape glance = prepared(cloud, {.topology = kAtAGlance});
    Progress progress;
    const PreparedShape closely = with_topology(glance, {}, {}, {}, progress);
    const PreparedShape at_once = prepared(cloud);
    EXPECT_EQ(closely.topology.labels, at_once.topology.labels);
    EXPECT_EQ(closely.topology.components.front().genus, at_once.topology.components.front().genus);
    EXPECT_EQ(closely.normals, glance.normals);
}

TEST(PreparedShape, BadInputIsRefusedInWords) {
    Progress progress;
    Cloud few = ball(900);
    few.positions = few.positions.topRows(kMinimumPoints - 1).replicate(4, 1).eval();
    EXPECT_THROW(prepare({few}, {}, progress), CloudError);
    const Cloud cloud = ball(900);
    const std::vector<Index> parts(899, 0);
    EXPECT_THROW(prepare({cloud, parts}, {}, progress), CloudError);
}

}  // namespace
}  // namespace pointmorph

#include "registration/annealing.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>
#include <vector>

#include "pointmorph/cloud/subset.hpp"
#include "registration/eggs.hpp"
#include "registration/node_chain.hpp"

namespace pointmorph {
namespace {

TEST(Annealing, NodesAreMatchedInEveryRoundAndOthersAreDrawn) {
    const Eggs eggs;
    const CoarseShape& egg = eggs.coarse_source;
    const DeformationGraph& graph = egg.levels.front();
    std::mt19937_64 random(7);
    const std::vector<Index> rows = draw_points(egg, graph, 200, random);
    ASSERT_EQ(rows.size(), 200u);
    EXPECT_TRUE(std::equal(graph.node_rows.begin(), graph.node_rows.end(), rows.begin()));
    EXPECT_TRUE(std::is_sorted(rows.begin() + graph.size(), rows.end()));
    EXPECT_EQ(std::set<Index>(rows.begin(), rows.end()).size(), 200u);
    EXPECT_NE(draw_points(egg, graph, 200, random), rows);

    EXPECT_EQ(draw_points(egg, graph, 5, random), graph.node_rows);
    EXPECT_EQ(draw_points(egg, graph, 100000, random).size(), to_size(egg.size()));
}

TEST(Annealing, AMatchCountsHalfAtSoManyMedians) {
    const std::vector<double> distances{0.0, 1.0, 2.0, 6.0, 1000.0};  // median 2
    const std::vector<double> weights = robust_weights(distances, 3.0);
    EXPECT_EQ(weights[0], 1.0);
    EXPECT_NEAR(weights[3], 0.5, 1e-6);
    EXPECT_LT(weights[4], 1e-4);
    EXPECT_TRUE(std::ranges::is_sorted(weights, std::greater<>()));
    // All at their matches: none is an outlier.
    for (const double w : robust_weights({0.0, 0.0, 0.0}, 3.0)) EXPECT_EQ(w, 1.0);
}

TEST(Annealing, SmallPartsWhoseMatchesJumpedDontCount) {
    const DeformationGraph graph = node_chain(20);
    Positions positions = Positions::Zero(20, 3), matches;
    positions.col(0).setLinSpaced(20, 0.0, 19.0);
    matches = positions;
    matches.bottomRows(4).col(1).array() += 50.0;
    const MatchedNodes nodes{positions, matches};
    const std::vector<double> strict = untorn(graph, nodes, 1.0, 0.25);
    for (std::size_t k = 0; k < 20; ++k) EXPECT_EQ(strict[k], k < 16 ? 1.0 : 0.0);
    for (const double w : untorn(graph, nodes, 1.0, 0.2)) EXPECT_EQ(w, 1.0);
    // A jump of less than twice the distance and two spacings is a stretch.
    for (const double w : untorn(graph, nodes, 30.0, 0.25)) EXPECT_EQ(w, 1.0);
}

TEST(Annealing, ShapesSoftenFromTheFirstToTheLastRoundAfterTheStiffOnes) {
    const RegistrationLevel schedule{.stiff_rounds = 2,
                                     .rounds = 3,
                                     .first_stiffness = 16.0,
                                     .last_stiffness = 1.0,
                                     .solves = 1,
                                     .first_smoothing = 4,
                                     .last_smoothing = 2,
                                     .matched_points = 100,
                                     .full_rounds = 2,
                                     .first_area_weight = 0.4,
                                     .last_area_weight = 0.1};
    const double stiffness[] = {16.0, 16.0, 16.0, 4.0, 1.0};
    const int smoothing[] = {4, 4, 4, 3, 2};
    const double area_weight[] = {0.4, 0.4, 0.4, 0.2, 0.1};
    for (int k = 0; k < 5; ++k) {
        const AnnealingRound round = annealing_round(schedule, k, 10);
        EXPECT_EQ(round.is_stiff, k < 2);
        EXPECT_EQ(round.matches_all, k >= 3);
        EXPECT_EQ(round.draws, k <= 3);  // once for all rounds that match all points
        EXPECT_NEAR(round.stiffness, stiffness[k] / 10, 1e-12);
        EXPECT_EQ(round.smoothing, smoothing[k]);
        EXPECT_NEAR(round.area_weight, area_weight[k], 1e-12);
    }
}

TEST(Annealing, AShapeThatLiesOnItselfStaysThere) {
    const Eggs eggs;
    const CoarseShape& egg = eggs.coarse_source;
    const RegistrationOptions options;
    std::mt19937_64 random(1);
    Progress progress;
    const CoarsePair shapes{egg, egg};
    const Registration r = annealed({shapes, 0, options.levels.front(), options},
                                    {egg.positions, egg.positions}, random, progress);
    EXPECT_LT((r.source_points.positions - egg.positions).rowwise().norm().maxCoeff(), 0.02);
    EXPECT_LT((r.target_points.positions - egg.positions).rowwise().norm().maxCoeff(), 0.02);
}

TEST(Annealing, InPartsItComesToTheSameAsAtOnce) {
    const Eggs eggs;
    const RegistrationOptions options;
    RegistrationLevel schedule = options.levels.front();
    schedule.stiff_rounds = 1;
    schedule.rounds = 5;
    schedule.full_rounds = 2;
    schedule.matched_points = 400;
    const CoarsePair shapes{eggs.coarse_source, eggs.coarse_target};
    const Annealing annealing{shapes, 0, schedule, options};
    const RegistrationStart start{eggs.coarse_source.positions, eggs.coarse_target.positions};
    Progress progress;
    std::mt19937_64 random(1);
    AnnealingRun run(annealing, start, random);
    ASSERT_EQ(run.rounds(), 6);
    run.advance(4, progress);
    const Registration part = run.result();
    run.advance(100, progress);  // no more than there are
    const Registration parts = run.result(), whole = annealed(annealing, start, random, progress);
    EXPECT_NE(part.source.positions, whole.source.positions);
    EXPECT_EQ(parts.source.positions, whole.source.positions);
    EXPECT_EQ(parts.target_points.positions, whole.target_points.positions);
    EXPECT_EQ(run.random(), random);
}

}  // namespace
}  // namespace pointmorph

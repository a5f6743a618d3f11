#include "registration/pose_trials.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

/// A map of twenty nodes that takes them all `offset` aside, either way.
Trial shifted(double energy, double offset) {
    Trial trial;
    trial.energy = energy;
    trial.registration.source.positions = Positions::Constant(20, 3, 0.0);
    trial.registration.source.positions.col(0).setConstant(offset);
    trial.registration.target.positions = -trial.registration.source.positions;
    return trial;
}

TEST(PoseTrials, AClusterHoldsTheBestTwoOfTheTrialsThatLieTogether) {
    const std::vector<Trial> trials{shifted(1.00, 0.0),  shifted(1.05, 0.05), shifted(1.06, 0.1),
                                    shifted(1.10, 0.5),  shifted(1.12, 0.55), shifted(1.20, 1.0),
                                    shifted(1.25, -0.1), shifted(1.26, 1.5),  shifted(1.40, 1.0)};
    const auto at = [&](const PoseCluster& cluster, std::size_t k) {
        return cluster[k] - trials.data();
    };
    const std::vector<PoseCluster> clusters = pose_clusters(trials, 1.3, 2);
    ASSERT_EQ(clusters.size(), 3u);  // the fourth is one too many, the last too bad
    ASSERT_EQ(clusters[0].size(), 2u);
    EXPECT_EQ(at(clusters[0], 0), 0);
    EXPECT_EQ(at(clusters[0], 1), 1);
    ASSERT_EQ(clusters[1].size(), 2u);
    EXPECT_EQ(at(clusters[1], 0), 3);
    EXPECT_EQ(at(clusters[1], 1), 4);
    ASSERT_EQ(clusters[2].size(), 1u);
    EXPECT_EQ(at(clusters[2], 0), 5);

    EXPECT_EQ(pose_clusters(trials, 1.3, 0).size(), 1u);
    EXPECT_EQ(pose_clusters(trials, 1.01, 2).size(), 1u);
    EXPECT_EQ(pose_clusters(trials, 1.3, 9).size(), 4u);
    EXPECT_TRUE(pose_clusters({}, 1.3, 2).empty());
}

TEST(PoseTrials, ALimbThatLiesElsewhereMakesMapsDiffer) {
    const Trial plain = shifted(1.0, 0.0);
    EXPECT_EQ(difference(plain, plain), 0.0);
    EXPECT_NEAR(difference(plain, shifted(1.0, 0.3)), 0.3, 1e-12);
    Trial limb = plain;
    limb.registration.target.positions(7, 1) += 1.0;  // one node of twenty: .05 in the mean
    EXPECT_NEAR(difference(plain, limb), 0.35, 1e-12);
    EXPECT_EQ(difference(plain, limb), difference(limb, plain));
    const NodePlaces places = node_places(plain);
    for (const Trial& other : {plain, shifted(1.0, 0.3), limb})
        for (const double distinct : {0.0, 0.04, 0.06, 0.29, 0.31, 0.34, 0.36, 0.6})
            EXPECT_EQ(differ_by_less(places, node_places(other), distinct),
                      difference(plain, other) < distinct);
}

TEST(PoseTrials, ARankingThatTheTrialsReverseIsInDoubt) {
    const auto map = [](double cost, double offset) {
        Positions images = Positions::Zero(20, 3);
        images.col(0).setConstant(offset);
        return NodeImages{cost, images, images};
    };
    const NodeImages best = map(2.0, 0.0), turned = map(2.2, 0.5), near = map(2.2, 0.1);
    const auto ratio = [&](const NodeImages& other, double least, double least_turned) {
        const std::vector<NodeImages> trials{map(9.0, 0.01), map(least, 0.02), map(9.0, 0.48),
                                             map(least_turned, 0.47)};
        return ratio_in_doubt(best, other, trials);
    };
    EXPECT_NEAR(ratio(turned, 3.0, 3.0), std::sqrt(1.1), 1e-12) << "the trials call it a tie";
    EXPECT_NEAR(ratio(turned, 3.0, 2.9), std::sqrt(1.1 * 2.9 / 3.0), 1e-12);
    EXPECT_EQ(ratio(turned, 3.0, 2.0), 1.0) << "the turned one wasn't chosen";
    EXPECT_NEAR(ratio(turned, 3.0, 4.0), 1.1, 1e-12) << "they agree";
    EXPECT_NEAR(ratio(near, 3.0, 2.0), 1.1, 1e-12) << "trials don't rank limbs";
    EXPECT_NEAR(ratio_in_doubt(best, turned, {}), 1.1, 1e-12);
    const std::vector<NodeImages> one_sided{map(3.0, 0.0)};
    EXPECT_NEAR(ratio_in_doubt(best, turned, one_sided), 1.1, 1e-12);
    EXPECT_NEAR(ratio_in_doubt(best, map(1.96, 0.5), one_sided), 0.98, 1e-12);
}

TEST(PoseTrials, AnchorsAreTheFeaturesAndThoseExtremitiesThatNoneOfThemSitsOn) {
    CoarseShape shape;  // six points, two to a node
    for (const Index node : {0, 0, 1, 1, 2, 2}) {
        if (shape.levels.empty()) shape.levels.emplace_back();
        shape.levels.front().point_nodes.push_back({node});
    }
    const std::vector<Extremity> tips{{1, 1.0}, {3, 1.0}, {5, 1.0}};
    const std::vector<IndexPair> features{{2, 4}};  // nodes 1 and 2
    const PoseOptions options;
    const RegistrationOptions registration;
    const PoseSearch search{{shape, shape, tips}, {shape, shape, tips}, {}, {}, features, options,
                            registration};
    const std::vector<IndexPair> found = anchors(search, {{0, 0}, {1, 1}, {2, 2}});
    ASSERT_EQ(found.size(), 2u);
    EXPECT_EQ(found[0].source, 1);
    EXPECT_EQ(found[0].target, 2);
    EXPECT_EQ(found[1].source, 0);
    EXPECT_EQ(found[1].target, 0);
}

/// An urchin and the same, sampled otherwise and rotated by half a turn.
struct TurnedUrchins {
    Matrix3 turn = Vector3(-1.0, -1.0, 1.0).asDiagonal();
    CoarseShape source = lying(Matrix3::Identity(), 3), target = lying(turn, 4);
    PoseOptions options;
    RegistrationOptions registration;
    NodeDistances distances = node_distances(source, target);
    std::vector<Extremity> source_tips = extremities(source, distances[0], options.extremities),
                           target_tips = extremities(target, distances[1], options.extremities);

    static CoarseShape lying(const Matrix3& as, unsigned seed) {
        const std::vector<Vector3> spikes{{1.2, 0.3, -0.2},
                                          {-0.3, 0.9, 0.5},
                                          {-0.6, -0.5, 0.7},
                                          {0.1, -0.4, -1.0},
                                          {-1.0, 0.3, -0.5}};
        const shapes::Urchin urchin(4000, spikes, seed);
        const double unit = std::sqrt(estimated_area(KdTree<3>(urchin.positions)));
        Progress progress;
        CoarseShapeOptions options;
        options.points = 1500;
        const Positions positions = urchin.positions * as.transpose() / unit;
        return coarse_shape(KdTree<3>(positions), urchin.normals * as.transpose(), {}, options,
                            progress);
    }
    PoseSearch search() const {
        Progress progress;
        return {thinned_shape(source, source_tips, options.points, progress),
                thinned_shape(target, target_tips, options.points, progress),
                distances,
                {},
                {},
                options,
                registration};
    }
};

std::vector<Trial> tried(const PoseSearch& search, const std::vector<TrialStart>& starts) {
    std::vector<Trial> trials;
    Progress progress;
    try_starts(search, starts, trials, progress);
    return trials;
}

TEST(PoseTrials, WhatLooksHopelessHalfwayIsNotFollowed) {
    const TurnedUrchins urchins;
    const PoseSearch search = urchins.search();
    const TrialStart right{Similarity{1.0, urchins.turn, Vector3::Zero()}, {}}, wrong{{}, {}};
    const std::vector<Trial> best = tried(search, {right}), worst = tried(search, {wrong});
    ASSERT_GT(worst.front().energy, 2.0 * best.front().energy);
    ASSERT_GT(difference(worst.front(), best.front()), urchins.options.distinct);

    const std::vector<Trial> both = tried(search, {wrong, right});
    ASSERT_EQ(both.size(), 1u);
    EXPECT_EQ(both.front().energy, best.front().energy);  // what went before it leaves no trace
}

TEST(PoseTrials, MapsToUnlikePointsAreDearerOnceLikenessCounts) {
    const TurnedUrchins urchins;
    PoseSearch search = urchins.search();
    const TrialStart right{Similarity{1.0, urchins.turn, Vector3::Zero()}, {}};
    const std::vector<Trial> before = tried(search, {right});
    std::vector<Trial> trials = before;
    count_likeness(search, trials);
    EXPECT_FALSE(search.counts_likeness) << "no forms are known";
    EXPECT_EQ(trials.front().energy, before.front().energy);

    const FormRadii radii = form_radii(urchins.source, urchins.target);
    for (ThinnedShape* shape : {&search.source, &search.target})
        shape->forms = local_forms(shape->full, shape->full_rows, radii);
    make_comparable(search.source.forms, search.target.forms);
    // The same map to the wrong side: its misfit is as small, its points are unlike.
    trials.push_back(before.front());
    Positions& images = trials.back().registration.source_points.positions;
    images = -images;
    count_likeness(search, trials);
    EXPECT_TRUE(search.counts_likeness);
    const Positions there =
        right.alignment.inverse().apply(before.front().registration.source_points.positions);
    const Positions& back = before.front().registration.target_points.positions;
    const double unlike = 0.5 * (unlikeness(search.source.forms, search.target.forms,
                                            nearest_rows(*search.target.tree, there), {}) +
                                 unlikeness(search.target.forms, search.source.forms,
                                            nearest_rows(*search.source.tree, back), {}));
    EXPECT_NEAR(trials.front().energy,
                before.front().energy * std::pow(unlike + 0.1, urchins.options.likeness), 1e-12);
    EXPECT_GT(trials.back().energy, 1.1 * trials.front().energy);
    std::vector<Trial> again = trials;
    count_likeness(search, again);
    EXPECT_EQ(again.front().energy, trials.front().energy) << "counted once";
    // What is tried from now on is rated alike.
    EXPECT_NEAR(tried(search, {right}).front().energy, trials.front().energy, 1e-12);
}

TEST(PoseTrials, AnchorsBringShapesTogetherThatLieTheOtherWayRound) {
    const TurnedUrchins urchins;
    ExtremityMatches matches;
    for (std::size_t i = 0; i < urchins.source_tips.size(); ++i)
        for (std::size_t j = 0; j < urchins.target_tips.size(); ++j)
            if ((urchins.turn *
                     urchins.source.positions.row(urchins.source_tips[i].point).transpose() -
                 urchins.target.positions.row(urchins.target_tips[j].point).transpose())
                    .norm() < 0.1)
                matches.push_back({to_index(i), to_index(j)});
    ASSERT_GE(matches.size(), 5u);
    const PoseSearch search = urchins.search();
    const auto error = [&](StartPlaces places) {
        const std::vector<Trial> trials = tried(search, {{Similarity{}, matches, places}});
        const Positions truth = search.source.thin.positions * urchins.turn.transpose();
        return (trials.front().registration.source_points.positions - truth)
            .rowwise()
            .norm()
            .mean();
    };
    EXPECT_LT(error(StartPlaces::kAnchored), 0.03);
    EXPECT_GT(error(StartPlaces::kAtRest),
              0.1);  // drawn together, the extremities turn it inside out
}

TEST(PoseTrials, EachRoundOfATrialAsksWhetherToEnd) {
    const ThreadCount alone(1);  // others don't call
    const TurnedUrchins urchins;
    const PoseSearch search = urchins.search();
    ExtremityMatches matches;
    for (Index k = 0; k < 5; ++k) matches.push_back({k, k});
    const Similarity turned{1.0, urchins.turn, Vector3::Zero()};
    const int rounds = urchins.options.trial.rounds;
    for (const TrialStart& start : {TrialStart{turned, {}}, TrialStart{turned, matches},
                                    TrialStart{turned, matches, StartPlaces::kAnchored},
                                    TrialStart{turned, {}, StartPlaces::kTransported}}) {
        const auto calls_until = [&](int last) {
            int calls = 0;
            Progress progress([&](std::string_view, double) { return ++calls < last; },
                              std::chrono::milliseconds(0));
            std::vector<Trial> trials;
            try {
                try_starts(search, {start}, trials, progress);
                EXPECT_EQ(trials.size(), 1u);
            } catch (const Cancelled&) {
                EXPECT_EQ(calls, last) << "asked again after it was told to end";
            }
            return calls;
        };
        EXPECT_GE(calls_until(1000), rounds);
        EXPECT_EQ(calls_until(rounds / 2), rounds / 2);
    }
}

TEST(PoseTrials, WhatTheCallbackThrowsWithinATrialComesBack) {
    const ThreadCount alone(1);
    const TurnedUrchins urchins;
    const PoseSearch search = urchins.search();
    int calls = 0;
    Progress progress(
        [&](std::string_view, double) -> bool {
            if (++calls == 7) throw std::out_of_range("the window is gone");
            return true;
        },
        std::chrono::milliseconds(0));
    std::vector<Trial> trials;
    EXPECT_THROW(try_starts(search, {{Similarity{1.0, urchins.turn, Vector3::Zero()}, {}}}, trials,
                            progress),
                 std::out_of_range);
}

}  // namespace
}  // namespace pointmorph

#include "../src/pose_trials.hpp"

#include <gtest/gtest.h>

#include <vector>

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

TEST(PoseTrials, AWayIsTheBestTwoOfTheTrialsThatLieTogether) {
    const std::vector<Trial> trials{shifted(1.00, 0.0),  shifted(1.05, 0.05), shifted(1.06, 0.1),
                                    shifted(1.10, 0.5),  shifted(1.12, 0.55), shifted(1.20, 1.0),
                                    shifted(1.25, -0.1), shifted(1.26, 1.5),  shifted(1.40, 1.0)};
    const auto at = [&](const Way& way, std::size_t k) { return way[k] - trials.data(); };
    const std::vector<Way> ways = ways_of(trials, 1.3, 2);
    ASSERT_EQ(ways.size(), 3u);  // the fourth is one too many, the last too bad
    ASSERT_EQ(ways[0].size(), 2u);
    EXPECT_EQ(at(ways[0], 0), 0);
    EXPECT_EQ(at(ways[0], 1), 1);
    ASSERT_EQ(ways[1].size(), 2u);
    EXPECT_EQ(at(ways[1], 0), 3);
    EXPECT_EQ(at(ways[1], 1), 4);
    ASSERT_EQ(ways[2].size(), 1u);
    EXPECT_EQ(at(ways[2], 0), 5);

    EXPECT_EQ(ways_of(trials, 1.3, 0).size(), 1u);
    EXPECT_EQ(ways_of(trials, 1.01, 2).size(), 1u);
    EXPECT_EQ(ways_of(trials, 1.3, 9).size(), 4u);
    EXPECT_TRUE(ways_of({}, 1.3, 2).empty());
}

TEST(PoseTrials, ALimbThatLiesElsewhereMakesMapsDiffer) {
    const Trial plain = shifted(1.0, 0.0);
    EXPECT_EQ(difference(plain, plain), 0.0);
    EXPECT_NEAR(difference(plain, shifted(1.0, 0.3)), 0.3, 1e-12);
    Trial limb = plain;
    limb.registration.target.positions(7, 1) += 1.0;  // one node of twenty: .05 in the mean
    EXPECT_NEAR(difference(plain, limb), 0.35, 1e-12);
    EXPECT_EQ(difference(plain, limb), difference(limb, plain));
}

}  // namespace
}  // namespace pointmorph

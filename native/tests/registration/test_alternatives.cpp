#include "pointmorph/registration/alternatives.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace pointmorph {
namespace {

TEST(Alternatives, EveryPlaceIsARowOfTheOtherCloudAndTheRestStays) {
    Alternatives some;
    some.source_rows = {2, 0};
    some.target_rows = {1};
    some.finished = {Values::Constant(1, 1.1), Eigen::MatrixXd::Constant(1, 2, 0.3),
                     Eigen::MatrixXd::Constant(1, 1, 0.4)};
    const std::vector<Index> source{10, 11, 12}, target{20, 21};
    const Alternatives moved = some.with_rows(source, target);
    EXPECT_EQ(moved.source_rows, (std::vector<Index>{12, 10}));
    EXPECT_EQ(moved.target_rows, (std::vector<Index>{21}));
    EXPECT_EQ(moved.finished.ratios, some.finished.ratios);
    EXPECT_EQ(moved.finished.source, some.finished.source);
    EXPECT_EQ(moved.finished.target, some.finished.target);
    EXPECT_TRUE(moved.searched());
}

TEST(Alternatives, WithoutOtherMapsNothingWasSearched) {
    EXPECT_FALSE(Alternatives{}.searched());
    Alternatives tried;
    tried.trials.ratios = Values::Constant(3, 1.0);
    EXPECT_TRUE(tried.searched());
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/registration/diagnostics.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace pointmorph {
namespace {

Diagnostics some() {
    Diagnostics found;
    found.margin = 1.25;
    found.confidence = 0.5;
    found.rivals = {{.ratio = 1.25,
                     .swap = Swap::kSides,
                     .distance = 0.5,
                     .places = {2, 0},
                     .source = 1,
                     .target = 3,
                     .rival_target = 0}};
    found.proposals = {{.source = 2, .target = 1, .confidence = 0.75, .is_extremity = true}};
    found.source_loose = {0};
    found.target_loose = {3, 1};
    found.starts = {{"pose", 0.1, 2.0}, {"tips", 0.2, 3.0}};
    found.start_taken = 1;
    return found;
}

TEST(Diagnostics, EveryRowIsThatOfTheOtherCloudAndTheRestStays) {
    const std::vector<Index> source{10, 11, 12}, target{20, 21, 22, 23};
    const Diagnostics moved = some().with_rows(source, target);
    ASSERT_EQ(moved.rivals.size(), 1u);
    EXPECT_EQ(moved.rivals[0].places, (std::vector<Index>{12, 10}));
    EXPECT_EQ(moved.rivals[0].source, 11);
    EXPECT_EQ(moved.rivals[0].target, 23);
    EXPECT_EQ(moved.rivals[0].rival_target, 20);
    EXPECT_EQ(moved.rivals[0].swap, Swap::kSides);
    EXPECT_EQ(moved.rivals[0].ratio, 1.25);
    ASSERT_EQ(moved.proposals.size(), 1u);
    EXPECT_EQ(moved.proposals[0].source, 12);
    EXPECT_EQ(moved.proposals[0].target, 21);
    EXPECT_EQ(moved.proposals[0].confidence, 0.75);
    EXPECT_EQ(moved.source_loose, std::vector<Index>{10});
    EXPECT_EQ(moved.target_loose, (std::vector<Index>{23, 21}));
    EXPECT_EQ(moved.margin, 1.25);
    EXPECT_EQ(moved.confidence, 0.5);
    EXPECT_EQ(moved.starts.size(), 2u);
    EXPECT_EQ(moved.start_taken, 1u);
}

TEST(Diagnostics, ALaterRegistrationAddsItsStartsAndLoosePiecesAlone) {
    Diagnostics later;
    later.starts = {{"earlier map", 0.0, 1.0}, {"fine", 0.0, 0.5}};
    later.start_taken = 1;
    later.source_loose = {2};
    const Diagnostics both = some().followed_by(later);
    ASSERT_EQ(both.starts.size(), 4u);
    EXPECT_EQ(both.starts[1].start, "tips");
    EXPECT_EQ(both.starts[both.start_taken].start, "fine");
    EXPECT_EQ(both.source_loose, (std::vector<Index>{0, 2}));
    EXPECT_EQ(both.target_loose, some().target_loose);
    EXPECT_EQ(both.confidence, 0.5);
    EXPECT_EQ(both.margin, 1.25);
    EXPECT_EQ(both.rivals.size(), 1u);
    EXPECT_EQ(both.proposals.size(), 1u);
}

}  // namespace
}  // namespace pointmorph

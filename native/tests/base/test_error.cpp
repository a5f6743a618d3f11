#include "pointmorph/base/error.hpp"

#include <gtest/gtest.h>

namespace pointmorph {
namespace {

TEST(Error, SaysWhatWasExpectedWhatWasFoundAndWhatToDo) {
    const Error error("Hill", "points", "none", "Add some.");
    EXPECT_STREQ(error.what(), "Hill: expected points, found none. Add some.");
}

TEST(Error, NumbersHaveSixDigitsAtMost) {
    EXPECT_EQ(in_short(0.5), "0.5");
    EXPECT_EQ(in_short(-1.0 / 3.0), "-0.333333");
    EXPECT_EQ(in_short(1e6), "1e+06");
    EXPECT_EQ(in_short(100.0), "100");
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/base/progress.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <numeric>
#include <stdexcept>
#include <thread>

#include "pointmorph/base/error.hpp"

namespace pointmorph {
namespace {

using namespace std::chrono_literals;

struct Call {
    std::string stage;
    double fraction;
};

TEST(Progress, TellsStagesAndFractions) {
    std::vector<Call> calls;
    Progress progress([&](std::string_view stage, double fraction) {
        calls.push_back({std::string(stage), fraction});
        return true;
    });
    progress.enter("first");
    progress.enter("second");
    std::this_thread::sleep_for(30ms);
    progress.report(0.5);
    std::this_thread::sleep_for(30ms);
    progress.report(7.0);  // never more than all
    progress.finish();
    progress.finish();
    ASSERT_EQ(calls.size(), 4u);
    EXPECT_EQ(calls[0].stage, "first");
    EXPECT_EQ(calls[0].fraction, 0.0);
    EXPECT_EQ(calls[1].stage, "second");
    EXPECT_EQ(calls[2].fraction, 0.5);
    EXPECT_EQ(calls[3].fraction, 1.0);
}

TEST(Progress, PartsInsidePartsAreSharesOfThem) {
    std::vector<double> fractions;
    Progress progress([&](std::string_view, double fraction) {
        fractions.push_back(fraction);
        return true;
    });
    const auto half_done = [&] {
        std::this_thread::sleep_for(30ms);
        progress.report(0.5);
    };
    progress.enter("stage");
    {
        const Progress::Part outer(progress, 0.2, 0.6);
        half_done();
        const Progress::Part inner(progress, 0.5, 1.0);
        half_done();
    }
    half_done();
    ASSERT_EQ(fractions.size(), 4u);
    EXPECT_DOUBLE_EQ(fractions[1], 0.4);
    EXPECT_DOUBLE_EQ(fractions[2], 0.5);
    EXPECT_DOUBLE_EQ(fractions[3], 0.5);
}

TEST(Progress, NeverFallsWithinAStage) {
    std::vector<double> fractions;
    Progress progress(
        [&](std::string_view, double fraction) {
            fractions.push_back(fraction);
            return true;
        },
        0ms);
    progress.enter("stage");
    progress.report(0.75);
    progress.report(0.25);
    progress.poll(0.5);
    progress.report(1.0);
    progress.enter("stage");
    EXPECT_EQ(fractions, (std::vector{0.0, 0.75, 0.75, 0.75, 1.0, 0.0}));
}

TEST(Progress, CallsNoMoreOftenThanItsInterval) {
    int calls = 0;
    Progress progress([&](std::string_view, double) { return ++calls > 0; });
    progress.enter("stage");
    const auto start = std::chrono::steady_clock::now();
    do progress.report(0.5);
    while (std::chrono::steady_clock::now() - start < 100ms);
    const auto elapsed = std::chrono::steady_clock::now() - start;
    EXPECT_GE(calls, 2);
    EXPECT_LE(calls, 2 + elapsed / 20ms);
}

TEST(Progress, TimesStagesAndSumsThoseOfOneName) {
    Progress progress;
    progress.enter("a");
    std::this_thread::sleep_for(5ms);
    progress.enter("b");
    progress.enter("a");
    std::this_thread::sleep_for(5ms);
    progress.finish();
    ASSERT_EQ(progress.stages().size(), 2u);
    EXPECT_EQ(progress.stages()[0].stage, "a");
    EXPECT_GE(progress.stages()[0].seconds, 0.010);
    EXPECT_EQ(progress.stages()[1].stage, "b");
    EXPECT_GE(progress.stages()[1].seconds, 0.0);
}

TEST(Progress, FalseCancelsForGood) {
    int calls = 0;
    Progress progress([&](std::string_view, double) { return ++calls < 2; });
    progress.enter("first");
    EXPECT_FALSE(progress.cancelled());
    EXPECT_THROW(progress.enter("second"), Cancelled);
    EXPECT_TRUE(progress.cancelled());
    EXPECT_THROW(progress.report(0.5), Cancelled);
    EXPECT_FALSE(progress.poll(0.5));
    EXPECT_EQ(calls, 2);
}

TEST(Progress, WhatTheCallbackThrowsReachesTheCaller) {
    Progress progress([](std::string_view, double) -> bool { throw std::domain_error("mine"); });
    EXPECT_THROW(progress.enter("stage"), std::domain_error);
    EXPECT_THROW(progress.report(0.5), Cancelled);  // thrown once, cancelled from then on
}

TEST(Progress, WithoutCallbackIsSilent) {
    Progress progress;
    progress.enter("stage");
    progress.report(0.5);
    EXPECT_TRUE(progress.poll(1.0));
    EXPECT_FALSE(progress.cancelled());
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/base/progress.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <numeric>
#include <stdexcept>
#include <thread>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"

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
        {
            const Progress::Part inner(progress, 0.5, 1.0);
            half_done();
        }
        half_done();
    }
    half_done();
    ASSERT_EQ(fractions.size(), 4u);
    EXPECT_DOUBLE_EQ(fractions[1], 0.5);
    EXPECT_DOUBLE_EQ(fractions[2], 0.4);
    EXPECT_DOUBLE_EQ(fractions[3], 0.5);
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

TEST(ParallelFor, VisitsEveryRowOnceInChunks) {
    for (const int threads : {1, 2, 5}) {
        const ThreadCount scope(threads);
        for (const Index count : {0, 1, 511, 512, 513, 10000}) {
            Progress progress;
            std::vector<std::atomic<int>> visits(to_size(count));
            parallel_for(count, progress, [&](Index begin, Index end) {
                EXPECT_LT(begin, end);
                EXPECT_EQ(begin % 512, 0);
                EXPECT_TRUE(end == count || end - begin == 512);
                for (Index i = begin; i < end; ++i) ++visits[to_size(i)];
            });
            for (const auto& v : visits) EXPECT_EQ(v, 1);
        }
    }
}

TEST(ParallelFor, RunsOnAllThreadsThatItMay) {
    for (const int threads : {1, 3}) {
        const ThreadCount scope(threads);
        Progress progress;
        std::atomic<int> inside{0}, most{0};
        parallel_for(
            300, progress,
            [&](Index, Index) {
                const int now = ++inside;
                int before = most;
                while (before < now && !most.compare_exchange_weak(before, now)) {
                }
                std::this_thread::sleep_for(1ms);
                --inside;
            },
            0.0, 1.0, 1);
        EXPECT_EQ(most, threads);
    }
}

TEST(ParallelFor, ThreadCountIsRestored) {
    const auto threads_used = [] {
        Progress progress;
        std::atomic<int> most{0}, inside{0};
        parallel_for(
            64, progress,
            [&](Index, Index) {
                most = std::max<int>(most, ++inside);
                std::this_thread::sleep_for(2ms);
                --inside;
            },
            0.0, 1.0, 1);
        return most.load();
    };
    const ThreadCount two(2);
    {
        const ThreadCount one(1);
        EXPECT_EQ(threads_used(), 1);
        const ThreadCount same(0);
        EXPECT_EQ(threads_used(), 1);
    }
    EXPECT_EQ(threads_used(), 2);
}

TEST(ParallelFor, ReportsRisingFractionsOfItsShare) {
    std::vector<double> fractions;
    Progress progress([&](std::string_view, double fraction) {
        fractions.push_back(fraction);
        return true;
    });
    progress.enter("stage");
    parallel_for(
        200, progress, [](Index, Index) { std::this_thread::sleep_for(2ms); }, 0.25, 0.75, 1);
    ASSERT_GE(fractions.size(), 3u);
    for (std::size_t i = 1; i < fractions.size(); ++i) {
        EXPECT_GE(fractions[i], 0.25);
        EXPECT_LE(fractions[i], 0.75);
        EXPECT_GE(fractions[i], fractions[i - 1]);
    }
}

TEST(ParallelFor, AnExceptionOfABodyEndsItAndReachesTheCaller) {
    for (const int threads : {1, 4}) {
        const ThreadCount scope(threads);
        Progress progress;
        std::atomic<int> chunks{0};
        const auto run = [&] {
            parallel_for(
                100000, progress,
                [&](Index begin, Index) {
                    ++chunks;
                    if (begin == 20) throw OptionError("k", "one", "two", "Three.");
                    std::this_thread::sleep_for(100us);
                },
                0.0, 1.0, 1);
        };
        EXPECT_THROW(run(), OptionError);
        EXPECT_LT(chunks, 90000);
        EXPECT_FALSE(progress.cancelled());
    }
}

TEST(ParallelFor, CancelEndsItWithinAChunk) {
    for (const int threads : {1, 4}) {
        const ThreadCount scope(threads);
        const auto start = std::chrono::steady_clock::now();
        Progress progress([&](std::string_view, double) {
            return std::chrono::steady_clock::now() - start < 50ms;
        });
        std::atomic<int> chunks{0};
        const auto run = [&] {
            parallel_for(
                1'000'000, progress,
                [&](Index, Index) {
                    ++chunks;
                    std::this_thread::sleep_for(1ms);
                },
                0.0, 1.0, 1);
        };
        EXPECT_THROW(run(), Cancelled);
        EXPECT_GT(chunks, 1);
        EXPECT_LT(chunks, 500'000);
    }
}

TEST(ParallelFor, ACallbackThatThrowsEndsItToo) {
    Progress progress([](std::string_view, double) -> bool { throw std::domain_error("mine"); });
    const auto run = [&] {
        parallel_for(
            100000, progress, [](Index, Index) { std::this_thread::sleep_for(100us); }, 0.0, 1.0,
            1);
    };
    EXPECT_THROW(run(), std::domain_error);
    EXPECT_TRUE(progress.cancelled());
}

TEST(ParallelFor, CancelledBeforeDoesNothing) {
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(progress.enter("stage"), Cancelled);
    int chunks = 0;
    EXPECT_THROW(parallel_for(10, progress, [&](Index, Index) { ++chunks; }), Cancelled);
    EXPECT_EQ(chunks, 0);
}

TEST(ParallelFor, SlotsOfARowDontDependOnThreads) {
    std::vector<double> sums[2];
    for (const int threads : {1, 4}) {
        const ThreadCount scope(threads);
        Progress progress;
        auto& sum = sums[threads > 1];
        sum.resize(20000);
        parallel_for(20000, progress, [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i)
                for (int n = 1; n < 30; ++n) sum[to_size(i)] += 1.0 / (i * n + 1);
        });
    }
    EXPECT_EQ(sums[0], sums[1]);
}

}  // namespace
}  // namespace pointmorph

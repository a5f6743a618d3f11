#include "pointmorph/base/parallel.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#ifndef _WIN32
#include <sys/wait.h>
#include <unistd.h>
#endif

#include "base/thread_checks.hpp"
#include "base/thread_engine.hpp"
#include "pointmorph/base/error.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

using checks::threads_used;
using namespace std::chrono_literals;

/// Everything with each engine that the library is built with.
class ParallelFor : public testing::TestWithParam<const ThreadEngine*> {
    EngineScope engine_{*GetParam()};
};

INSTANTIATE_TEST_SUITE_P(Engines, ParallelFor, testing::ValuesIn(thread_engines()),
                         [](const auto& info) { return std::string(info.param->name); });

/// Sums of the same length as rows, which take a while.
std::vector<double> slow_sums(Index count) {
    std::vector<double> sums(to_size(count));
    Progress progress;
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i)
                for (int n = 1; n < 30; ++n) sums[to_size(i)] += 1.0 / (i * n + 1);
        },
        0.0, 1.0, 64);
    return sums;
}

TEST_P(ParallelFor, VisitsEveryRowOnceInChunks) {
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

TEST_P(ParallelFor, RunsOnAllThreadsThatItMay) {
    for (const int threads : {1, 3, 2, 5}) {
        const ThreadCount scope(threads);
        EXPECT_EQ(threads_used(), threads);
    }
}

TEST_P(ParallelFor, ThreadCountIsRestored) {
    const ThreadCount two(2);
    {
        const ThreadCount one(1);
        EXPECT_EQ(threads_used(), 1);
        const ThreadCount same(0);
        EXPECT_EQ(threads_used(), 1);
    }
    EXPECT_EQ(threads_used(), 2);
}

TEST_P(ParallelFor, ThreadCountIsTheThreadsOwn) {
    const ThreadCount one(1);
    int elsewhere = 0;
    std::thread([&] {
        const ThreadCount three(3);
        elsewhere = threads_used();
    }).join();
    EXPECT_EQ(elsewhere, 3);
    EXPECT_EQ(threads_used(), 1);
}

TEST_P(ParallelFor, ReportsRisingFractionsOfItsShare) {
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

TEST_P(ParallelFor, AnExceptionOfABodyEndsItAndReachesTheCaller) {
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

TEST_P(ParallelFor, CancelEndsItWithinAChunk) {
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

TEST_P(ParallelFor, RowsThatTakeLongEndWhereTheyAsk) {
    for (const int threads : {1, 3}) {
        const ThreadCount scope(threads);
        int calls = 0;
        Progress progress([&](std::string_view, double) { return ++calls < 5; }, 0ms);
        std::atomic<int> begun{0}, ended{0};
        const auto run = [&] {
            parallel_invoke(threads, progress, [&](int, Progress& its) {
                ++begun;
                for (int round = 0; round < 100000; ++round) {
                    its.report(0.5);
                    std::this_thread::sleep_for(20us);
                }
                ++ended;
            });
        };
        EXPECT_THROW(run(), Cancelled);
        EXPECT_GT(begun, 0);
        EXPECT_EQ(ended, 0);
        EXPECT_EQ(calls, 5);
    }
}

TEST_P(ParallelFor, ACallbackThatThrowsEndsItToo) {
    Progress progress([](std::string_view, double) -> bool { throw std::domain_error("mine"); });
    const auto run = [&] {
        parallel_for(
            100000, progress, [](Index, Index) { std::this_thread::sleep_for(100us); }, 0.0, 1.0,
            1);
    };
    EXPECT_THROW(run(), std::domain_error);
    EXPECT_TRUE(progress.cancelled());
}

TEST_P(ParallelFor, CancelledBeforeDoesNothing) {
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(progress.enter("stage"), Cancelled);
    int chunks = 0;
    EXPECT_THROW(parallel_for(10, progress, [&](Index, Index) { ++chunks; }), Cancelled);
    EXPECT_EQ(chunks, 0);
}

TEST_P(ParallelFor, SlotsOfARowDontDependOnThreads) {
    std::vector<double> sums[2];
    for (const int threads : {1, 4}) {
        const ThreadCount scope(threads);
        sums[threads > 1] = slow_sums(20000);
    }
    EXPECT_EQ(sums[0], sums[1]);
}

TEST_P(ParallelFor, ALoopInsideOfABodyStaysOnItsThread) {
    const ThreadCount scope(3);
    std::atomic<int> elsewhere{0};
    std::vector<double> sums[2];
    Progress progress;
    on_both(progress, [&](bool is_source, Progress& own) {
        const auto thread = std::this_thread::get_id();
        sums[is_source] = slow_sums(5000);
        parallel_for(
            50, own, [&](Index, Index) { elsewhere += std::this_thread::get_id() != thread; }, 0.0,
            1.0, 1);
        std::this_thread::sleep_for(2ms);
    });
    EXPECT_EQ(elsewhere, 0);
    EXPECT_EQ(sums[0], sums[1]);
    EXPECT_EQ(sums[0], slow_sums(5000));
    EXPECT_EQ(threads_used(), 3);  // as before
}

TEST_P(ParallelFor, WhatACallerDoesOfSeveralHasAShareEachOfItsProgress) {
    for (int threads = 1; threads <= 3; ++threads) {
        const ThreadCount scope(threads);
        std::vector<double> said;
        Progress progress(
            [&](std::string_view, double fraction) {
                said.push_back(fraction);
                return true;
            },
            0ms);
        progress.enter("stage");
        {
            const Progress::Part part(progress, 0.2, 0.8);
            parallel_invoke(3, progress, [](int, Progress& its) {
                for (const double done : {0.0, 0.5, 1.0}) its.report(done);
            });
        }
        EXPECT_TRUE(std::ranges::is_sorted(said));
        EXPECT_LE(said.back(), 0.8);
        if (threads == 1) {
            const std::vector<double> all{0.0, 0.2, 0.3, 0.4, 0.4, 0.5, 0.6, 0.6, 0.7, 0.8};
            ASSERT_EQ(said.size(), all.size());
            for (std::size_t k = 0; k < all.size(); ++k) EXPECT_NEAR(said[k], all[k], 1e-12);
        }
    }
}

TEST_P(ParallelFor, AnExceptionInsideOfABodyReachesTheCallerThroughBothLoops) {
    const ThreadCount scope(2);
    const auto run = [] {
        parallel_invoke(2, [](int, bool) {
            Progress silent;
            parallel_for(10, silent, [](Index, Index) { throw std::domain_error("inner"); });
        });
    };
    EXPECT_THROW(run(), std::domain_error);
    EXPECT_EQ(threads_used(), 2);
}

TEST_P(ParallelFor, WhoCallsIsAskedWhileItWaitsForOthers) {
    const ThreadCount scope(2);
    std::atomic<int> cancelled{0};
    int asked = 0;
    Progress progress([&](std::string_view, double) { return ++asked < 5; }, 0ms);
    const auto caller = std::this_thread::get_id();
    std::atomic<bool> others{false};
    const auto run = [&] {
        parallel_invoke(2, progress, [&](int, Progress& its) {
            // The caller's ends as soon as there is another.
            const bool is_caller = std::this_thread::get_id() == caller;
            if (!is_caller) others = true;
            try {
                while (!is_caller || !others) its.report(0.5);
            } catch (const Cancelled&) {
                ++cancelled;
                throw;
            }
        });
    };
    EXPECT_THROW(run(), Cancelled);
    EXPECT_GE(cancelled, 1);
    EXPECT_EQ(asked, 5);
}

TEST_P(ParallelFor, WhatACallbackThrowsEndsAllThatRunsNextToOneAnother) {
    for (int threads = 1; threads <= 3; ++threads) {
        const ThreadCount scope(threads);
        int asked = 0;
        Progress progress(
            [&](std::string_view, double) {
                if (++asked > 4) throw std::domain_error("asked");
                return true;
            },
            0ms);
        const auto run = [&] {
            parallel_invoke(3, progress, [](int, Progress& its) {
                while (true) its.report(0.0);
            });
        };
        EXPECT_THROW(run(), std::domain_error);
        EXPECT_EQ(asked, 5);
    }
}

TEST_P(ParallelFor, RoundsFollowOneAnotherQuickly) {
    const ThreadCount scope(3);
    Progress progress;
    std::vector<int> visits(9);
    for (int round = 0; round < 5000; ++round)
        parallel_for(
            9, progress,
            [&](Index begin, Index end) {
                for (Index i = begin; i < end; ++i) ++visits[to_size(i)];
            },
            0.0, 1.0, 1);
    for (const int count : visits) EXPECT_EQ(count, 5000);
}

TEST_P(ParallelFor, SeveralThreadsRunLoopsAtTheSameTime) {
    const std::vector<double> expected = slow_sums(3000);
    std::vector<std::vector<double>> sums(3);
    std::vector<std::thread> threads;
    for (auto& own : sums)
        threads.emplace_back([&own] {
            const ThreadCount scope(2);
            for (int round = 0; round < 20; ++round) own = slow_sums(3000);
        });
    for (auto& thread : threads) thread.join();
    for (const auto& own : sums) EXPECT_EQ(own, expected);
}

TEST_P(ParallelFor, AThreadThatHasRunLoopsCanEnd) {
    const std::vector<double> expected = slow_sums(1000);
    for (int round = 0; round < 20; ++round)
        std::thread([&] {
            const ThreadCount scope(3);
            EXPECT_EQ(slow_sums(1000), expected);
        }).join();
}

#ifndef _WIN32
TEST_P(ParallelFor, DeepRecursionFitsOnEveryThread) {
    const ThreadCount scope(2);
    Progress progress;
    std::atomic<int> sum{0};
    parallel_for(
        50, progress,
        [&](Index, Index) {
            volatile char large[1 << 20];  // twice what macOS gives a thread by itself
            for (std::size_t i = 0; i < sizeof large; i += 4096) large[i] = 1;
            sum = sum + large[4096];
            std::this_thread::sleep_for(1ms);
        },
        0.0, 1.0, 1);
    EXPECT_GT(sum, 0);
}

TEST_P(ParallelFor, AForkedChildRunsLoops) {
    SKIP_WHERE_THREADS_ARE_WATCHED();
    const ThreadCount scope(3);
    const std::vector<double> expected = slow_sums(20000);
    for (int generation = 0; generation < 2; ++generation) {  // once more with the pool in use
        std::fflush(nullptr);                                 // the child would say it again
        const pid_t child = fork();
        if (child == 0) {
            alarm(30);  // a child that waits for ever ends
            bool good = slow_sums(20000) == expected && threads_used() == 3;
            std::thread([&] { good = good && slow_sums(20000) == expected; }).join();
            _exit(good ? 0 : 1);
        }
        int status = 0;
        ASSERT_EQ(waitpid(child, &status, 0), child);
        EXPECT_EQ(status, 0);
        EXPECT_EQ(slow_sums(20000), expected);
    }
}

TEST_P(ParallelFor, AForkedChildThatRunsNoLoopCanEnd) {
    SKIP_WHERE_THREADS_ARE_WATCHED();
    SKIP_WHERE_WATCHED();  // memory of its parent's threads would be taken for lost
    int status = 1;
    std::thread([&] {
        const ThreadCount scope(3);
        const auto sums = slow_sums(20000);
        std::fflush(nullptr);  // the child would say it again
        const pid_t child = fork();
        if (child == 0) {
            alarm(30);
            std::exit(0);  // runs what is left for this thread's end
        }
        waitpid(child, &status, 0);
    }).join();
    EXPECT_EQ(status, 0);
}
#else
TEST_P(ParallelFor, DeepRecursionFitsOnEveryThread) {
    GTEST_SKIP() << "the program says how large a thread's stack is";
}

TEST_P(ParallelFor, AForkedChildRunsLoops) {
    GTEST_SKIP() << "Windows forks no process";
}

TEST_P(ParallelFor, AForkedChildThatRunsNoLoopCanEnd) {
    GTEST_SKIP() << "Windows forks no process";
}
#endif

TEST(ParallelInvoke, CallsEachOnceAndRethrowsTheFirst) {
    for (const ThreadEngine* engine : thread_engines()) {
        const EngineScope scope(*engine);
        for (const int threads : {1, 2, 7}) {
            const ThreadCount count(threads);
            std::vector<std::atomic<int>> calls(5);
            std::atomic<int> owned{0};
            const auto caller = std::this_thread::get_id();
            const auto run = [&] {
                parallel_invoke(5, [&](int i, bool owner) {
                    ++calls[to_size(i)];
                    EXPECT_EQ(owner, std::this_thread::get_id() == caller);
                    owned += owner;
                    if (i > 1) throw std::out_of_range(std::to_string(i));
                });
            };
            try {
                run();
                ADD_FAILURE() << "nothing thrown";
            } catch (const std::out_of_range& error) {
                EXPECT_STREQ(error.what(), "2");
            }
            for (const auto& c : calls) EXPECT_EQ(c, 1);
        }
    }
}

TEST(ThreadEngines, TheEnvironmentMayAskForThePool) {
    EXPECT_EQ(&engine_named("pool"), &kPoolEngine);
    for (const char* name : {"openmp", "other", "", static_cast<const char*>(nullptr)})
        EXPECT_EQ(&engine_named(name), thread_engines().front());
}

TEST(ThreadEngines, APoolIsAlwaysThere) {
    ASSERT_FALSE(thread_engines().empty());
    EXPECT_EQ(thread_engines().back(), &kPoolEngine);
    for (const ThreadEngine* engine : thread_engines()) EXPECT_GE(engine->default_threads(), 1);
}

}  // namespace
}  // namespace pointmorph

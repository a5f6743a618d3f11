// Work that fills an idle thread.
#include "base/work_aside.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string_view>
#include <thread>

#ifndef _WIN32
#include <sys/wait.h>
#include <unistd.h>
#endif

#ifdef __linux__
#include <sys/resource.h>
#endif

#include "base/thread_checks.hpp"
#include "base/thread_engine.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {
namespace {

using namespace std::chrono_literals;

/// Takes steps until it is ended.
class Steps {
public:
    void operator()(Progress& progress) {
        begun = true;
        try {
            for (;; ++taken) progress.report(0.5);
        } catch (const Cancelled&) {
            was_ended = true;
        }
    }
    /// Waits for more of them.
    void wait_for_more() const {
        for (const int before = taken; taken < before + 100;) std::this_thread::sleep_for(1ms);
    }

    std::atomic<bool> begun{false}, was_ended{false};
    std::atomic<int> taken{0};
};

/// How many are taken in 20 ms in which so many threads are at work: one, on a busy machine, that
/// had been begun before.
int steps_while_all_work(int threads, const Steps& steps) {
    std::atomic<int> there{0};
    std::atomic<bool> seen{false};
    int moved = 0;
    parallel_invoke(threads, [&](int, bool owner) {
        ++there;
        while (there < threads) std::this_thread::yield();
        if (owner) {
            std::this_thread::sleep_for(20ms);
            const int before = steps.taken;
            std::this_thread::sleep_for(20ms);
            moved = steps.taken - before;
            seen = true;
        }
        while (!seen) std::this_thread::yield();
    });
    return moved;
}

TEST(WorkAside, GoesOnWhileAThreadIsIdleAndStandsStillWhileNoneIs) {
    for (const ThreadEngine* engine : thread_engines()) {
        const EngineScope scope(*engine);
        const ThreadCount count(2);
        Steps steps;
        {
            const WorkAside aside([&](Progress& progress) { steps(progress); });
            steps.wait_for_more();
            EXPECT_LE(steps_while_all_work(2, steps), 1) << engine->name;
            steps.wait_for_more();
            // One of two that has nothing to do any more is idle, the caller or the other.
            Progress progress;
            for (const bool caller_works : {true, false}) {
                std::atomic<int> there{0};
                parallel_invoke(2, progress, [&](int, Progress& its) {
                    ++there;
                    while (there < 2) std::this_thread::yield();
                    if ((&its == &progress) == caller_works) steps.wait_for_more();
                });
            }
            steps.wait_for_more();
        }
        EXPECT_TRUE(steps.was_ended);
        EXPECT_EQ(checks::threads_used(), 2);  // as before
    }
}

TEST(WorkAside, RunsItsLoopsAlone) {
    const ThreadCount count(2);
    std::atomic<int> most{0};
    std::atomic<bool> done{false};
    const WorkAside aside([&](Progress&) {
        most = checks::threads_used();
        done = true;
    });
    while (!done) std::this_thread::sleep_for(1ms);
    EXPECT_EQ(most, 1);
}

TEST(WorkAside, DoesNotBeginOnOneThread) {
    const ThreadCount count(1);
    Steps steps;
    {
        const WorkAside aside([&](Progress& progress) { steps(progress); });
        std::this_thread::sleep_for(5ms);
    }
    EXPECT_FALSE(steps.begun);
}

TEST(WorkAside, WhatItThrowsEndsItAlone) {
    const ThreadCount count(2);
    std::atomic<bool> begun{false};
    {
        const WorkAside aside([&](Progress&) {
            begun = true;
            throw std::out_of_range("aside");
        });
        while (!begun) std::this_thread::sleep_for(1ms);
    }
    EXPECT_EQ(checks::threads_used(), 2);
}

TEST(WorkAside, EndsWithAnOwnerThatIsCanceledWhileItStandsStill) {
    for (const ThreadEngine* engine : thread_engines()) {
        const EngineScope scope(*engine);
        const ThreadCount count(2);
        Steps steps;
        std::atomic<int> there{0};
        std::atomic<bool> cancel{false};
        Progress progress([&](std::string_view, double) { return !cancel; }, 0ms);
        const auto run = [&] {
            const WorkAside aside([&](Progress& its) { steps(its); });
            steps.wait_for_more();
            parallel_invoke(2, progress, [&](int, Progress& its) {
                ++there;
                while (there < 2) std::this_thread::yield();
                std::this_thread::sleep_for(20ms);
                cancel = true;
                while (true) its.report(0.5);
            });
        };
        EXPECT_THROW(run(), Cancelled);
        EXPECT_TRUE(steps.was_ended);
        EXPECT_EQ(checks::threads_used(), 2);
    }
}

TEST(WorkAside, GoesOnInATeamForWhichTheSystemHasOneThreadAlone) {
    const ThreadEngine alone{"alone", [] { return 2; },
                             [](int, const TeamWork& work) { work(true); }};
    const EngineScope scope(alone);
    Steps steps;
    {
        const WorkAside aside([&](Progress& progress) { steps(progress); });
        Progress progress;
        parallel_invoke(2, progress, [&](int, Progress&) { steps.wait_for_more(); });
    }
    EXPECT_TRUE(steps.was_ended);
}

TEST(WorkAside, DoesNotBeginBesideOther) {
    const ThreadCount count(3);
    Steps steps, others;
    {
        const WorkAside aside([&](Progress& progress) { steps(progress); });
        steps.wait_for_more();
        const WorkAside other([&](Progress& progress) { others(progress); });
        std::this_thread::sleep_for(100ms);
        // The one that has begun learns that all three are at work.
        EXPECT_LE(steps_while_all_work(3, steps), 1);
    }
    EXPECT_FALSE(others.begun);
    const WorkAside again([&](Progress& progress) { others(progress); });
    others.wait_for_more();
}

#ifdef __linux__
/// How often threads of this process have slept.
long times_asleep() {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_nvcsw;
}

TEST(WorkAside, SeldomLooksWhileItStandsStillForLong) {
    const ThreadCount count(2);
    Steps steps;
    const WorkAside aside([&](Progress& progress) { steps(progress); });
    steps.wait_for_more();
    std::atomic<int> there{0};
    std::atomic<long> looks{0};
    parallel_invoke(2, [&](int, bool owner) {
        ++there;
        while (there < 2) {
        }
        const long before = times_asleep();
        const auto start = std::chrono::steady_clock::now();
        while (std::chrono::steady_clock::now() - start < 300ms) {
        }
        if (owner) looks = times_asleep() - before;
    });
    EXPECT_LT(looks, 600);
}
#endif

#ifndef _WIN32
TEST(WorkAside, AForkedChildDoesNotWaitForItsParents) {
    SKIP_WHERE_THREADS_ARE_WATCHED();
    const ThreadCount count(2);
    Steps steps;
    {
        auto aside =
            std::make_unique<const WorkAside>([&](Progress& progress) { steps(progress); });
        steps.wait_for_more();
        std::fflush(nullptr);  // the child would say it again
        const pid_t child = fork();
        if (child == 0) {
            alarm(30);  // a child that waits for ever ends
            aside.reset();
            const bool good = checks::threads_used() == 2;
            Steps own;
            {
                const WorkAside its([&](Progress& progress) { own(progress); });
                own.wait_for_more();
            }
            _exit(good && own.was_ended ? 0 : 1);
        }
        int status = 0;
        ASSERT_EQ(waitpid(child, &status, 0), child);
        EXPECT_EQ(status, 0);
        steps.wait_for_more();
    }
    EXPECT_TRUE(steps.was_ended);
}
#else
TEST(WorkAside, AForkedChildDoesNotWaitForItsParents) {
    GTEST_SKIP() << "Windows forks no process";
}
#endif

}  // namespace
}  // namespace pointmorph

// What tests of threads ask.
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "pointmorph/base/parallel.hpp"

/// The thread sanitizer allows no threads after a fork.
#ifdef __SANITIZE_THREAD__
#define SKIP_WHERE_THREADS_ARE_WATCHED() GTEST_SKIP() << "no fork with the thread sanitizer"
#else
#define SKIP_WHERE_THREADS_ARE_WATCHED() static_cast<void>(0)
#endif

namespace pointmorph::checks {

/// How many threads are inside at once, at most.
class Crowd {
public:
    void pass_through() {
        const int now = ++inside_;
        int before = most_;
        while (before < now && !most_.compare_exchange_weak(before, now)) {
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        --inside_;
    }
    int most() const { return most_; }

private:
    std::atomic<int> inside_{0}, most_{0};
};

/// How many threads a loop has.
inline int threads_used() {
    Progress progress;
    Crowd crowd;
    parallel_for(
        100, progress, [&](Index, Index) { crowd.pass_through(); }, 0.0, 1.0, 1);
    return crowd.most();
}

}  // namespace pointmorph::checks

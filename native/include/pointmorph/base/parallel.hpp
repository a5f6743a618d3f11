// The one parallel loop of the library.
#pragma once

#include <atomic>
#include <chrono>
#include <concepts>
#include <exception>
#include <limits>
#include <mutex>
#include <string_view>
#include <thread>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Limits the number of threads for the calling thread until the end of the scope. 0 leaves it as
/// it is. Without a limit there is one for each processor, or as many as OMP_NUM_THREADS says.
class ThreadCount {
public:
    explicit ThreadCount(int threads);
    ~ThreadCount();
    ThreadCount(const ThreadCount&) = delete;
    ThreadCount& operator=(const ThreadCount&) = delete;

private:
    int before_;
};

/// What each thread of a team does; `owner` is true on the thread that called `run_team`. Refers to
/// the callable, which must outlive it and must not throw.
class TeamWork {
public:
    template <std::invocable<bool> Work>
    explicit TeamWork(Work& work)
        : work_(&work), call_([](void* it, bool owner) { (*static_cast<Work*>(it))(owner); }) {}

    void operator()(bool owner) const { call_(work_, owner); }

private:
    void* work_;
    void (*call_)(void*, bool);
};

/// Calls `work` on the calling thread and on others, at most `most` at the same time, and returns
/// when all have ended. How many take part is open: one alone must be able to do it all. Inside of
/// `work`, the calling thread is the only one.
void run_team(int most, const TeamWork& work);

/// Calls `body(begin, end)` on consecutive chunks of [0, count), on all threads. `body` may write
/// only the slots of its own rows, so that the result doesn't depend on the number of threads;
/// scratch memory belongs inside it. Progress runs from `first` to `last` (fractions of the
/// stage). The first exception of a body is rethrown; throws Cancelled.
template <std::invocable<Index, Index> Body>
void parallel_for(Index count, Progress& progress, Body&& body, double first = 0.0,
                  double last = 1.0, Index chunk = 512) {
    progress.report(first);
    std::atomic<Index> next{0};
    std::atomic<bool> failed{false};
    std::mutex failing;
    std::exception_ptr failure;
    auto work = [&](bool owner) {
        while (!failed.load(std::memory_order_relaxed) && !progress.cancelled()) {
            const Index begin = next.fetch_add(chunk, std::memory_order_relaxed);
            if (begin >= count || begin < 0) break;
            const Index end = count - begin < chunk ? count : begin + chunk;
            try {
                body(begin, end);
            } catch (...) {
                const std::scoped_lock lock(failing);
                if (!failure) failure = std::current_exception();
                failed = true;
            }
            if (owner && !progress.poll(first + (last - first) * end / count)) break;
        }
    };
    run_team(count > chunk ? std::numeric_limits<int>::max() : 1, TeamWork(work));
    if (failure) std::rethrow_exception(failure);
    progress.throw_if_cancelled();
}

/// Calls `body(i, owner)` for i = 0 … count − 1 (a few), next to each other where there are
/// threads, and `wait(owner)` once a thread has none left to begin. `owner` is true on the calling
/// thread. Returns the exception of the lowest i, or null.
template <std::invocable<int, bool> Body, std::invocable<bool> Wait>
std::exception_ptr invoke_all(int count, Body&& body, Wait&& wait) {
    std::vector<std::exception_ptr> failures(to_size(count));
    std::atomic<int> next{0};
    auto work = [&](bool owner) {
        for (int i = next++; i < count; i = next++) {
            try {
                body(i, owner);
            } catch (...) {
                failures[to_size(i)] = std::current_exception();
            }
        }
        wait(owner);
    };
    run_team(count, TeamWork(work));
    for (const auto& failure : failures)
        if (failure) return failure;
    return nullptr;
}

/// Calls `body(i, owner)` for i = 0 … count − 1 (a few), next to each other where there are
/// threads. `owner` is true on the calling thread, the only one that may poll a Progress. The
/// exception of the lowest i is rethrown.
template <std::invocable<int, bool> Body>
void parallel_invoke(int count, Body&& body) {
    if (const auto failure = invoke_all(count, body, [](bool) {})) std::rethrow_exception(failure);
}

/// Calls `body(i, its)` for i = 0 … count − 1 (a few), next to each other where there are threads.
/// On the calling thread, `its` is `progress`; on others it says nothing, and is cancelled when
/// `progress` is, whose callback is asked until all have ended. Throws Cancelled, else the
/// exception of the lowest i.
template <std::invocable<int, Progress&> Body>
void parallel_invoke(int count, Progress& progress, Body&& body) {
    std::exception_ptr callers;
    std::atomic<int> ended{0};
    const auto failure = invoke_all(
        count,
        [&](int i, bool owner) {
            Progress silent([&](std::string_view, double) { return !progress.cancelled(); });
            try {
                body(i, owner ? progress : silent);
            } catch (...) {
                if (owner && !callers) callers = std::current_exception();
                ++ended;
                throw;
            }
            ++ended;
        },
        [&](bool owner) {
            while (owner && ended < count) {
                progress.poll();
                std::this_thread::sleep_for(std::chrono::microseconds(200));
            }
        });
    if (progress.cancelled()) {
        if (callers) std::rethrow_exception(callers);  // perhaps what the callback threw
        progress.throw_if_cancelled();
    }
    if (failure) std::rethrow_exception(failure);
}

/// Calls `work(is_source, its)` for both clouds as parallel_invoke() does.
template <std::invocable<bool, Progress&> Work>
void on_both(Progress& progress, Work&& work) {
    parallel_invoke(2, progress, [&](int k, Progress& its) { work(k == 0, its); });
}

}  // namespace pointmorph

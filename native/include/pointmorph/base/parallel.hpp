// The one parallel loop of the library.
#pragma once

#include <atomic>
#include <concepts>
#include <exception>
#include <functional>
#include <limits>
#include <mutex>

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
/// threads. `owner` is true on the calling thread, the only one that may poll a Progress. The
/// exception of the lowest i is rethrown.
void parallel_invoke(int count, const std::function<void(int, bool)>& body);

/// Calls `body(i, its)` for i = 0 … count − 1 (each takes long), next to each other where there are
/// threads. On the calling thread, which may do several, `its` is `progress`, of which each has a
/// share; on others it says nothing, and is cancelled when `progress` is, whose callback is asked
/// until all have ended. Throws Cancelled, else the exception of the lowest i.
void parallel_invoke(int count, Progress& progress,
                     const std::function<void(int, Progress&)>& body);

/// Calls `work(is_source, its)` for both clouds as parallel_invoke() does.
void on_both(Progress& progress, const std::function<void(bool, Progress&)>& work);

}  // namespace pointmorph

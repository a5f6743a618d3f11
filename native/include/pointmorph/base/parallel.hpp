// The one parallel loop of the library.
#pragma once

#include <algorithm>
#include <atomic>
#include <concepts>
#include <exception>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Sets the number of OpenMP threads for the calling thread and restores it at the end of the
/// scope. 0 leaves it as it is.
class ThreadCount {
public:
    explicit ThreadCount(int threads);
    ~ThreadCount();
    ThreadCount(const ThreadCount&) = delete;
    ThreadCount& operator=(const ThreadCount&) = delete;

private:
    int before_;
};

/// Threads to start for `tasks` tasks of which each keeps one busy.
int threads_for(int tasks);

/// True on the thread that opened the innermost parallel region, and outside of any.
bool is_calling_thread();

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
    std::exception_ptr failure;
#pragma omp parallel if (count > chunk)
    {
        const bool owner = is_calling_thread();
        while (!failed.load(std::memory_order_relaxed) && !progress.cancelled()) {
            const Index begin = next.fetch_add(chunk, std::memory_order_relaxed);
            if (begin >= count || begin < 0) break;
            const Index end = count - begin < chunk ? count : begin + chunk;
            try {
                body(begin, end);
            } catch (...) {
#pragma omp critical(pointmorph_parallel_for)
                if (!failure) failure = std::current_exception();
                failed = true;
            }
            if (owner && !progress.poll(first + (last - first) * end / count)) break;
        }
    }
    if (failure) std::rethrow_exception(failure);
    progress.throw_if_cancelled();
}

/// Calls `body(i, owner)` for i = 0 … count − 1 (a few), each on a thread of its own where there
/// are so many. `owner` is true on the calling thread, the only one that may poll a Progress. The
/// exception of the lowest i is rethrown.
template <std::invocable<int, bool> Body>
void parallel_invoke(int count, Body&& body) {
    std::vector<std::exception_ptr> failures(to_size(count));
#pragma omp parallel for num_threads(threads_for(count)) schedule(static, 1)
    for (int i = 0; i < count; ++i) {
        try {
            body(i, is_calling_thread());
        } catch (...) {
            failures[to_size(i)] = std::current_exception();
        }
    }
    for (const auto& failure : failures)
        if (failure) std::rethrow_exception(failure);
}

/// Calls `work(is_source, progress)` for both clouds, next to each other where there are threads;
/// the one on the calling thread gets `progress`, the other one that says and asks nothing.
template <std::invocable<bool, Progress&> Work>
void on_both(Progress& progress, Work&& work) {
    Progress silent;
    parallel_invoke(2, [&](int k, bool owner) { work(k == 0, owner ? progress : silent); });
}

}  // namespace pointmorph

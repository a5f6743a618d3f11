#include "pointmorph/base/parallel.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <string_view>
#include <thread>
#include <vector>

#include "base/crew.hpp"
#include "base/thread_engine.hpp"

namespace pointmorph {

namespace {

constexpr std::array kEngines{
#ifdef POINTMORPH_OPENMP
    &kOpenMpEngine,
#endif
    &kPoolEngine,
};
std::atomic<const ThreadEngine*>& engine_in_use() {
    static std::atomic<const ThreadEngine*> engine{
        &engine_named(std::getenv("POINTMORPH_THREADS"))};
    return engine;
}

thread_local int limit = 0;  // threads of a team; 0 leaves it to the engine
thread_local bool in_team = false;

int most_threads() {
    return limit > 0 ? limit : engine_in_use().load()->default_threads();
}

}  // namespace

std::span<const ThreadEngine* const> thread_engines() {
    return kEngines;
}

const ThreadEngine& engine_named(const char* name) {
    const bool is_pool = name != nullptr && std::strcmp(name, "pool") == 0;
    return is_pool ? kPoolEngine : *kEngines.front();
}

EngineScope::EngineScope(const ThreadEngine& engine) : before_(engine_in_use().exchange(&engine)) {}

EngineScope::~EngineScope() {
    engine_in_use() = before_;
}

ThreadCount::ThreadCount(int threads) : before_(limit) {
    if (threads > 0) limit = threads;
}

ThreadCount::~ThreadCount() {
    limit = before_;
}

int threads_for_a_team() {
    return in_team ? 1 : most_threads();
}

void stay_alone() {
    in_team = true;
}

void run_team(int most, const TeamWork& work) {
    const int threads = most < 2 ? 1 : std::min(most, threads_for_a_team());
    if (threads < 2) {
        work(true);
        return;
    }
    Crew* const crew = own_crew();
    auto as_member = [&](bool owner) {
        in_team = true;
        if (crew) ++crew->busy;
        work(owner);
        if (crew) --crew->busy;
        in_team = false;
    };
    const Waiting waiting;
    engine_in_use().load()->run(threads, TeamWork(as_member));
}

namespace {

/// Calls `body(i, owner)` for each i, and `wait(owner)` once a thread has none left to begin.
/// Returns the exception of the lowest i, or null.
std::exception_ptr invoke_all(int count, const std::function<void(int, bool)>& body,
                              const std::function<void(bool)>& wait) {
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

}  // namespace

void parallel_invoke(int count, const std::function<void(int, bool)>& body) {
    if (const auto failure = invoke_all(count, body, [](bool) {})) std::rethrow_exception(failure);
}

void parallel_invoke(int count, Progress& progress,
                     const std::function<void(int, Progress&)>& body) {
    std::exception_ptr callers;
    std::atomic<int> ended{0};
    const auto failure = invoke_all(
        count,
        [&](int i, bool owner) {
            Progress silent([&](std::string_view, double) { return !progress.cancelled(); });
            try {
                if (owner) {
                    const double all = count;
                    const Progress::Part part(progress, i / all, (i + 1) / all);
                    body(i, progress);
                } else {
                    body(i, silent);
                }
            } catch (...) {
                if (owner && !callers) callers = std::current_exception();
                ++ended;
                throw;
            }
            ++ended;
        },
        [&](bool owner) {
            if (!owner) return;
            const Waiting waiting;
            while (ended < count) {
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

void on_both(Progress& progress, const std::function<void(bool, Progress&)>& work) {
    parallel_invoke(2, progress, [&](int k, Progress& its) { work(k == 0, its); });
}

}  // namespace pointmorph

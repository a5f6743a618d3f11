#include "pointmorph/base/parallel.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <optional>
#include <string_view>
#include <system_error>
#include <thread>
#include <vector>

#include "base/own_thread.hpp"
#include "base/thread_engine.hpp"
#include "base/work_aside.hpp"

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

/// The calling thread and those of its team, while there is work aside.
struct Crew {
    int most;                  ///< threads
    std::atomic<int> busy{1};  ///< of them
};
thread_local Crew* own_crew = nullptr;

/// While the calling thread waits for others.
class Waiting {
public:
    Waiting() {
        if (own_crew) --own_crew->busy;
    }
    ~Waiting() {
        if (own_crew) ++own_crew->busy;
    }
    Waiting(const Waiting&) = delete;
    Waiting& operator=(const Waiting&) = delete;
};

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

void run_team(int most, const TeamWork& work) {
    const int threads = in_team || most < 2 ? 1 : std::min(most, most_threads());
    if (threads < 2) {
        work(true);
        return;
    }
    Crew* const crew = own_crew;
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

struct WorkAside::Shared {
    Shared(std::function<void(Progress&)> its, int most) : work(std::move(its)), crew{most} {}

    std::function<void(Progress&)> work;
    Crew crew;
    Crew* before = own_crew;  ///< of the thread that made it
    std::atomic<bool> ending{false}, ended{false};
    std::optional<OwnThread> thread;

    /// Stands still while no thread is idle. Returns whether to go on.
    bool may_go_on() const {
        while (!ending && crew.busy >= crew.most)
            std::this_thread::sleep_for(std::chrono::microseconds(100));
        return !ending;
    }

    void run() {
        in_team = true;  // it runs alone
        Progress progress([this](std::string_view, double) { return may_go_on(); },
                          std::chrono::milliseconds(0));
        try {
            progress.report(0.0);
            work(progress);
        } catch (...) {
        }
        ended = true;
        ended.notify_one();
    }
};

WorkAside::WorkAside(std::function<void(Progress&)> work) {
    const int most = in_team ? 1 : most_threads();
    if (most < 2) return;
    shared_ = std::make_shared<Shared>(std::move(work), most);
    try {
        shared_->thread.emplace([its = shared_] { its->run(); });
    } catch (const std::system_error&) {
        shared_.reset();  // the system allows no more threads
        return;
    }
    own_crew = &shared_->crew;
}

WorkAside::~WorkAside() {
    if (!shared_) return;
    own_crew = shared_->before;
    shared_->ending = true;
    shared_->ended.wait(false);
    shared_->thread->end();
}

void on_both(Progress& progress, const std::function<void(bool, Progress&)>& work) {
    parallel_invoke(2, progress, [&](int k, Progress& its) { work(k == 0, its); });
}

}  // namespace pointmorph

#include "pointmorph/base/parallel.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>

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

void run_team(int most, const TeamWork& work) {
    const int threads = in_team || most < 2 ? 1 : std::min(most, most_threads());
    if (threads < 2) {
        work(true);
        return;
    }
    auto as_member = [&](bool owner) {
        in_team = true;
        work(owner);
        in_team = false;
    };
    engine_in_use().load()->run(threads, TeamWork(as_member));
}

}  // namespace pointmorph

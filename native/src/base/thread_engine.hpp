// What starts the threads of a team: OpenMP, or threads of our own where no OpenMP runtime can live
// beside the program's (Blender on macOS ends when a second one is loaded).
#pragma once

#include <span>
#include <string_view>

#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

struct ThreadEngine {
    std::string_view name;
    /// Threads of a team that nobody limits.
    int (*default_threads)();
    /// `run_team` for two threads or more, outside of any other team's work.
    void (*run)(int threads, const TeamWork& work);
};

/// A pool for each thread that runs teams. Everywhere.
extern const ThreadEngine kPoolEngine;
/// Where the library is built with OpenMP. In a forked child whose parent has used it, it hands
/// over to the pool: the parent's threads are gone, and GNU's runtime would wait for them.
extern const ThreadEngine kOpenMpEngine;

/// Those that the library is built with.
std::span<const ThreadEngine* const> thread_engines();

/// The one that the environment asks for: POINTMORPH_THREADS is `pool` or `openmp`. The first one
/// where it says nothing, or what there isn't.
const ThreadEngine& engine_named(const char* name);

/// Another one until the end of the scope, while nothing else runs: for tests and benchmarks.
class EngineScope {
public:
    explicit EngineScope(const ThreadEngine& engine);
    ~EngineScope();
    EngineScope(const EngineScope&) = delete;
    EngineScope& operator=(const EngineScope&) = delete;

private:
    const ThreadEngine* before_;
};

/// Tells a forked child from its parent. The same for all where there is no fork.
long process_id();

}  // namespace pointmorph

// Memory that was freed but not given back. Not for callers of the library.
#pragma once

#include <atomic>
#include <concepts>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// From so many points on, of both shapes together, memory counts: what is made of each of them
/// takes a hundred bytes and more.
inline constexpr Index kManyPoints = 300'000;

/// Has the C library keep memory that was freed, to be used again, where it can be told to: pages
/// from the system are new ones, which have to be filled with zeros. Does nothing for many
/// `points`.
void keep_unused_memory(Index points) noexcept;

/// Gives the system what the C library keeps of freed memory, where it can be told to, before a
/// stage whose arrays are as large as the clouds. Does nothing for fewer than many `points`, whose
/// arrays are used again sooner than that pays.
void give_back_unused_memory(Index points) noexcept;

/// Calls `free(is_source)`, which doesn't throw, for both sides: next to each other where that is
/// many `points`' memory, which the system takes a while to take back, and there are threads.
template <std::invocable<bool> Free>
void free_both(Index points, Free&& free) noexcept {
    std::atomic<int> next{0};
    auto work = [&](bool) {
        for (int k = next++; k < 2; k = next++) free(k == 0);
    };
    try {
        run_team(points >= kManyPoints ? 2 : 1, TeamWork(work));
    } catch (...) {
        work(true);  // a team takes memory itself
    }
}

}  // namespace pointmorph

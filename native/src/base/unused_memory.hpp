// Memory that was freed but not given back. Not for callers of the library.
#pragma once

#include <atomic>
#include <concepts>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Has the C library keep memory that was freed, to be used again, where it can be told to: pages
/// from the system are new ones, which have to be filled with zeros. Does nothing for a few hundred
/// thousand `points` or more.
void keep_unused_memory(Index points) noexcept;

/// Gives the system what the C library keeps of freed memory, where it can be told to, before a
/// stage whose arrays are as large as the clouds. Does nothing for less than a few hundred thousand
/// `points`, whose arrays are used again sooner than that pays.
void give_back_unused_memory(Index points) noexcept;

/// Whether memory that goes with so many `points` takes the system a while.
bool takes_long_to_free(Index points) noexcept;

/// Calls `free(is_source)` for both sides, next to each other where that is many `points`' memory.
template <std::invocable<bool> Free>
void free_both(Index points, Free&& free) noexcept {
    std::atomic<int> next{0};
    auto work = [&](bool) {
        for (int k = next++; k < 2; k = next++) free(k == 0);
    };
    run_team(takes_long_to_free(points) ? 2 : 1, TeamWork(work));
}

}  // namespace pointmorph

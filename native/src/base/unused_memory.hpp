// Memory that was freed but not given back. Not for callers of the library.
#pragma once

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

}  // namespace pointmorph

// Counts what the whole test program allocates with `new`, for tests of code that must not.
#pragma once

namespace pointmorph {

/// Calls of `operator new` so far, by all threads.
long allocations();

}  // namespace pointmorph

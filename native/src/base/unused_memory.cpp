#include "base/unused_memory.hpp"

#if __has_include(<malloc.h>)
#include <malloc.h>
#endif

namespace pointmorph {

void give_back_unused_memory([[maybe_unused]] Index points) noexcept {
#ifdef __GLIBC__
    constexpr Index kWorthIt = 300'000;
    if (points >= kWorthIt) malloc_trim(0);
#endif
}

}  // namespace pointmorph

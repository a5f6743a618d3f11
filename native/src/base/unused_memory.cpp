#include "base/unused_memory.hpp"

#if __has_include(<malloc.h>)
#include <malloc.h>
#endif

namespace pointmorph {

void keep_unused_memory([[maybe_unused]] Index points) noexcept {
#ifdef __GLIBC__
    // Where its own rule leads, too, once a block of 32 MB was freed.
    constexpr int kLargest = 32 << 20;
    if (points >= kManyPoints) return;
    mallopt(M_MMAP_THRESHOLD, kLargest);
    mallopt(M_TRIM_THRESHOLD, 2 * kLargest);
#endif
}

void give_back_unused_memory([[maybe_unused]] Index points) noexcept {
#ifdef __GLIBC__
    if (points >= kManyPoints) malloc_trim(0);
#endif
}

}  // namespace pointmorph

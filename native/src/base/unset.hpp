// Arrays that nothing sets to 0 before they are filled. Not for callers of the library.
#pragma once

#include <memory>
#include <new>
#include <utility>
#include <vector>

namespace pointmorph {

/// Leaves numbers unset where std::allocator's would be 0.
template <class T>
class UnsetAllocator : public std::allocator<T> {
public:
    template <class U>
    struct rebind {
        using other = UnsetAllocator<U>;
    };

    UnsetAllocator() = default;
    template <class U>
    explicit UnsetAllocator(const UnsetAllocator<U>&) noexcept {}

    template <class U>
    void construct(U* at) noexcept(noexcept(U())) {
        ::new (static_cast<void*>(at)) U;
    }
    template <class U, class... Arguments>
    void construct(U* at, Arguments&&... arguments) {
        std::construct_at(at, std::forward<Arguments>(arguments)...);
    }
};

/// A vector that grows by numbers that aren't set. One thread alone would touch all of its memory
/// otherwise, which for large arrays takes as long as filling them.
template <class T>
using UnsetVector = std::vector<T, UnsetAllocator<T>>;

}  // namespace pointmorph

// What compilers don't agree on. No other file asks for one.
#pragma once

#include <array>
#include <cstddef>

/// The pointer is the only way to what it points to, so that loops can be vectorized.
#define POINTMORPH_RESTRICT __restrict  // of GCC, Clang and MSVC alike

namespace pointmorph {

/// Two numbers side by side, for any compiler.
struct alignas(16) PlainTwo {
    std::array<double, 2> values;

    double& operator[](std::size_t k) { return values[k]; }
    double operator[](std::size_t k) const { return values[k]; }
    friend PlainTwo operator-(const PlainTwo& a, const PlainTwo& b) {
        return {{a[0] - b[0], a[1] - b[1]}};
    }
    friend PlainTwo operator*(const PlainTwo& a, const PlainTwo& b) {
        return {{a[0] * b[0], a[1] * b[1]}};
    }
    PlainTwo& operator+=(const PlainTwo& b) {
        values[0] += b[0];
        values[1] += b[1];
        return *this;
    }
};

/// Two numbers in one register.
#if defined(__GNUC__)  // Clang as well
using Two = double __attribute__((vector_size(16)));
#else
using Two = PlainTwo;
#endif

}  // namespace pointmorph

// The exponential of many numbers side by side; elementary.hpp has that of one, which is closer.
// Not a part of the library.
#pragma once

#include <bit>
#include <cstdint>

#include "base/compiler.hpp"

namespace pointmorph {

/// e^x for |x| < 700: Cody and Waite's remainder and the Cephes library's quotient of polynomials,
/// as Eigen's packets have them, to the bit. Without a branch, so that the compiler vectorizes
/// loops around it.
POINTMORPH_INLINE double branchless_exponential(double x) {
    constexpr double kLog2E = 1.4426950408889634073599;
    constexpr double kLn2 = 0.693145751953125, kLn2Rest = 1.42860682030941723212e-6;
    constexpr double kShift = 0x1.8p52;  // numbers added to it are rounded to whole ones
    constexpr int kMantissaBits = 52, kSignBit = 63;
    constexpr double kBias = 1023.0;
    const auto bits_of = [](double number) { return std::bit_cast<std::uint64_t>(number); };

    const double scaled = kLog2E * x + 0.5;
    double whole = (scaled + kShift) - kShift;
    const std::uint64_t is_above = bits_of(scaled - whole) >> kSignBit;
    whole -= std::bit_cast<double>((0 - is_above) & bits_of(1.0));
    const double rest = (x - whole * kLn2) - whole * kLn2Rest;
    const double square = rest * rest;
    double above = 1.26177193074810590878e-4;
    above = above * square + 3.02994407707441961300e-2;
    above = above * square + 9.99999999999999999910e-1;
    above *= rest;
    double below = 3.00198505138664455042e-6;
    below = below * square + 2.52448340349684104192e-3;
    below = below * square + 2.27265548208155028766e-1;
    below = below * square + 2.00000000000000000009;
    const double fraction = 2.0 * (above / (below - above)) + 1.0;
    return fraction * std::bit_cast<double>(bits_of(whole + (kShift + kBias)) << kMantissaBits);
}

}  // namespace pointmorph

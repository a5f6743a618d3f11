// The nearest points both ways between two small arrays of the product space, all of one compared
// with all of the other. Not for callers of the library.
#pragma once

#include <utility>

#include "pointmorph/registration/product_space.hpp"

namespace pointmorph {

/// Most rows of either array for which it pays.
constexpr Eigen::Index kFewPoints = 1500;

/// How many floats are compared at once, which changes how long it takes and nothing else.
enum class FloatRegisters { kOfFour, kOfEight, kOfSixteen };

/// Whether all coordinates are of a size at which floats tell points apart.
bool fits_floats(const ProductPoints& points);

/// Matches of the source's rows, and of the target's: the same as two trees' nearest_matches(), to
/// the bit; of equally far rows, the first. Both have a row or more, and fits_floats(). `guess`,
/// what the target's rows may match, makes it quicker where it is good. Registers are as wide as
/// the processor has them, up to `most`.
std::pair<Matches, Matches> matches_both_ways_of_few(
    const ProductPoints& source, const ProductPoints& target, const Matches* guess = nullptr,
    FloatRegisters most = FloatRegisters::kOfSixteen);

/// Those of the source's rows alone.
Matches matches_of_few(const ProductPoints& source, const ProductPoints& target,
                       FloatRegisters most = FloatRegisters::kOfSixteen);

}  // namespace pointmorph

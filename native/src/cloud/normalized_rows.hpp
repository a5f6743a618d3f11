// Unit vectors, many at a time: roots and quotients are slow one by one.
#pragma once

#include <Eigen/Core>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

constexpr Index kNormalizedAtOnce = 128;

/// Normalizes at most kNormalizedAtOnce rows of three. One that isn't longer than `least` becomes
/// what `otherwise` gives for its number.
template <class Rows, class Otherwise>
void normalize_rows(Rows&& rows, double least, Otherwise&& otherwise) {
    using Lengths = Eigen::Array<double, Eigen::Dynamic, 1, 0, kNormalizedAtOnce, 1>;
    Lengths lengths = rows.rowwise().squaredNorm();
    lengths = lengths.sqrt();
    const Lengths factors = lengths.inverse();
    for (Index i = 0; i < to_index(rows.rows()); ++i) {
        if (lengths[i] > least)
            rows.row(i) *= factors[i];
        else
            rows.row(i) = otherwise(i);
    }
}

}  // namespace pointmorph

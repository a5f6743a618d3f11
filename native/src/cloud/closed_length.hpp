// How long a closed line through points is. Not a part of the library.
#pragma once

#include <cstddef>
#include <span>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// `loop`: rows of `positions`, in order; the last is joined to the first.
inline double closed_length(const Positions& positions, std::span<const Index> loop) {
    double length = 0.0;
    for (std::size_t k = 0; k < loop.size(); ++k)
        length +=
            (positions.row(loop[k + 1 < loop.size() ? k + 1 : 0]) - positions.row(loop[k])).norm();
    return length;
}

}  // namespace pointmorph

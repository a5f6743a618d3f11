// The middle of some numbers. Not a part of the library.
#pragma once

#include <algorithm>
#include <span>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Of one number or more, which are reordered; of an even count the upper one of both in the
/// middle.
inline double median(std::span<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::ranges::nth_element(values, middle);
    return *middle;
}

/// The same, without the reordering.
inline double median(Values values) {
    return median(std::span(values.data(), to_size(values.size())));
}

}  // namespace pointmorph

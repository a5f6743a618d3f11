// The middle of some numbers. Not a part of the library.
#pragma once

#include <algorithm>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Of one number or more; of an even count the upper one of both in the middle.
inline double median(Values values) {
    const auto middle = values.begin() + values.size() / 2;
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace pointmorph

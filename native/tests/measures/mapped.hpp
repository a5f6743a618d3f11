// Every position of a shape under a function.
#pragma once

#include <functional>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

using Function = std::function<Vector3(const Vector3&)>;

/// #V×3 positions → the function of each.
inline Positions mapped(const Positions& positions, const Function& function) {
    Positions result(positions.rows(), 3);
    for (Eigen::Index v = 0; v < positions.rows(); ++v)
        result.row(v) = function(positions.row(v).transpose()).transpose();
    return result;
}

}  // namespace pointmorph

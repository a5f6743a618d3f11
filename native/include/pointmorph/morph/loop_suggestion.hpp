// The loop that domain cut takes where none is given.
#pragma once

#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/morph/morph_input.hpp"
#include "pointmorph/morph/morph_options.hpp"

namespace pointmorph {

/// Names of point features, in order. Loops of the input are ignored. Throws FeatureError where
/// fewer than three points are among the features, or a cloud is an open patch.
std::vector<std::string> suggest_loop(const MorphInput& input, const MorphOptions& options,
                                      Progress& progress);

}  // namespace pointmorph

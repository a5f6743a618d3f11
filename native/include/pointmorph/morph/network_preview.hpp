// The network of curves along which domain network cuts both shapes, to look at before it is used.
#pragma once

#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/disk/network.hpp"
#include "pointmorph/morph/morph_input.hpp"
#include "pointmorph/morph/morph_options.hpp"

namespace pointmorph {

/// Given rows and lengths, and the names of the network's corners.
struct NamedNetwork {
    Network network;
    std::vector<std::string> corners;
};

/// Throws what Morph throws.
NamedNetwork preview_network(const MorphInput& input, const MorphOptions& options,
                             Progress& progress);

}  // namespace pointmorph

// A part of stage `mesh`: the handles and borders of its parts, counted from the faces.
#pragma once

#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

struct PartCounts {
    /// Whether all edges have one or two faces that agree, and the faces around each place make one
    /// fan. Else nothing else is known.
    bool is_surface = false;
    Index genus = 0;
    Index borders = 0;
    double longest_border = 0.0;  ///< length
    double area = 0.0;
};

/// Of each part.
std::vector<PartCounts> count_parts(const Mesh& mesh);

}  // namespace pointmorph

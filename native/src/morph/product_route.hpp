// The route of method auto from two clouds to maps and pairs: refined in the product space, with
// components brought onto their counterparts where there are several. Not for callers of the
// library.
#pragma once

#include <optional>

#include "morph/route_result.hpp"
#include "pointmorph/registration/components.hpp"
#include "pointmorph/registration/refinement.hpp"

namespace pointmorph {

struct ProductRouteOptions {
    RefinementOptions refinement;
    PieceOptions pieces;
    /// Use the shapes' neighborhoods rather than look neighbors up where they are needed. Equally
    /// near points then come in another order: the map is the same but for rounding.
    bool reuse_neighborhoods = true;
};

/// `start`, where there is one, is in sorted rows. Estimated normals count as turned where they
/// face the other way than those of the other shape. Throws the errors of the stages.
RouteResult match_in_product_space(const RouteInput& input,
                                   const std::optional<RefinementStart>& start,
                                   const ProductRouteOptions& options, Progress& progress);

}  // namespace pointmorph

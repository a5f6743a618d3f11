// The route of method auto from two clouds to maps and pairs: refined in the product space, with
// components brought onto their counterparts where there are several. Not for callers of the
// library.
#pragma once

#include <optional>

#include "morph/route_result.hpp"
#include "pointmorph/morph/morph_options.hpp"
#include "pointmorph/registration/components.hpp"
#include "pointmorph/registration/refinement.hpp"

namespace pointmorph {

/// Where the refinement takes neighbors from. kPrepared: those of the prepared shapes. kSearched:
/// it looks for them itself, at the scale it works at. Equally near points then come in another
/// order, so that the two results differ by rounding: each domain keeps to one of them.
enum class NeighborSource { kPrepared, kSearched };

struct ProductRouteOptions {
    RefinementOptions refinement;
    ComponentOptions components;
    NeighborSource neighbors = NeighborSource::kPrepared;
    /// Whether what lies beyond the end of one shape pulls at it; see MissingParts.
    bool leave_missing = true;
};

/// Whether what is missing of one shape is left where it is: so the options say, unless one shape
/// is flat and the other isn't. What is flat fits any flat place of the other, and would shrink
/// into one.
bool leaves_missing(const MorphOptions& options, const Positions& source, const Positions& target);

/// `start`, where there is one, is in sorted rows. A shape with estimated normals counts as inside
/// out where they face the other way than those of the other shape. Throws the errors of the
/// stages.
RouteResult match_in_product_space(const RouteInput& input,
                                   const std::optional<RefinementStart>& start,
                                   const ProductRouteOptions& options, Progress& progress);

/// Has `result` say what follows for the normals, where the map shows the `inside_out` of one
/// shape: estimated ones are to be reversed, given ones are told of, once.
void judge_normals(bool inside_out, const PreparedShape& source, const PreparedShape& target,
                   RouteResult& result);

}  // namespace pointmorph

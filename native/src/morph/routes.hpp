// Which route a morph takes, and what comes of it. Not for callers of the library.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "morph/cut_route.hpp"
#include "morph/input_checks.hpp"
#include "morph/network_route.hpp"
#include "morph/route_result.hpp"
#include "pointmorph/morph/morph_input.hpp"

namespace pointmorph {

/// The shapes as the last stage left them, and the result in their rows.
struct Correspondence {
    PreparedShapes shapes;
    RouteResult result;
};

/// Takes the route that the options, the loops and the shapes ask for; with method auto, goes on to
/// the product space from there. Of the input everything but the clouds is used. `features` are
/// those of the input in canonical() order and sorted rows. Throws the errors of the stages.
Correspondence find_correspondence(PreparedShapes shapes, MorphInput input,
                                   std::span<const Feature> features, const MorphOptions& options,
                                   Progress& progress);

/// The maps of an earlier morph in sorted rows; none where there is none.
std::optional<RefinementStart> earlier_map(const PreparedShapes& shapes, const MorphInput& input);

/// How both shapes are prepared before a route is chosen, for a morph and for its previews.
PreparationOptions preparation(const MorphOptions& options);

/// Both, by the boundaries of the input. Throws what require_closed() of a shape throws.
void require_closed(Closed purpose, const PreparedShapes& shapes, const MorphInput& input,
                    const MorphOptions& options, Progress& progress);

/// All loops of the input.
Loops loops_of(const MorphInput& input);

/// Names of point features that a suggested loop passes, three or more, on the grounds of all of
/// them. Throws FeatureError.
std::vector<std::string> loop_through(const RouteInput& input, const CutGrounds& grounds);

/// The rows of the point features.
std::vector<IndexPair> single_points(std::span<const Feature> features);

/// Reverses the normals that a route found to point inward.
void reverse_normals(PreparedShapes& shapes, const RouteResult& route);

}  // namespace pointmorph

// What every route from two prepared shapes to pairs of points takes and returns. Not for callers
// of the library.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "morph/prepared_shape.hpp"
#include "pointmorph/morph/morph_options.hpp"
#include "pointmorph/morph/report.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

/// `features` are in canonical() order and in sorted rows.
struct RouteInput {
    const PreparedShape& source;
    const PreparedShape& target;
    std::span<const Feature> features;
};

/// Rows are sorted rows, positions those of the prepared shapes.
struct RouteResult {
    std::string domain;
    DomainPoints source_domain, target_domain;
    Pairing pairs;
    RefinementStart images;  ///< smooth maps; empty where the domain gives them
    BoundaryLoop source_boundary, target_boundary;
    /// Estimated normals of this shape proved to point inward; see with_normals_reversed().
    bool source_is_inside_out = false, target_is_inside_out = false;
    std::optional<Index> genus;  ///< handles of both shapes, where the route found out
    std::vector<std::string> warnings;
    RouteFacts facts;
};

}  // namespace pointmorph

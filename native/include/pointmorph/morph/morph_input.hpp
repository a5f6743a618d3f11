// What is to be morphed.
#pragma once

#include <string>
#include <vector>

#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "pointmorph/surface/boundary.hpp"
#include "pointmorph/surface/features.hpp"
#include "pointmorph/surface/topology.hpp"

namespace pointmorph {

/// What vertices with faces keep when their mesh is wrapped, 0 to 1, one a vertex, or none.
struct VertexHolds {
    Values rigid{};  ///< the shape of the rigid vertices around
    Values fixed{};  ///< its place
};

/// All rows are given rows: those of the clouds as they stand here.
struct MorphInput {
    Cloud source;
    Cloud target;
    std::vector<Feature> features{};
    std::vector<std::string> loop{};  ///< features, in order, along which closed shapes are cut
    /// Boundaries of open patches, in order, in either direction; empty: found.
    BoundaryLoop source_boundary{};
    BoundaryLoop target_boundary{};
    /// Smooth maps of an earlier morph of these clouds to start from; empty: none. Only method auto
    /// uses them; see refine().
    RefinementStart start{};
    Parts source_parts{}, target_parts{};  ///< what is connected, from the faces; empty: found
    /// What is known of each part, from the faces; empty: found.
    std::vector<PartCounts> source_counts{}, target_counts{};
    VertexHolds source_holds{}, target_holds{};
    /// When the source's points go, 0 to 1, one a point, or none; see StaggerKind::kDelay.
    Values delays{};
    std::vector<std::vector<std::string>> more_loops{};  ///< like `loop`, for a network of curves
};

}  // namespace pointmorph

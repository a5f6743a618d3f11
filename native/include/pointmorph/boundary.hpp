// Stage `boundary`: the ordered boundary of an open patch (paper: "by the methods proposed by
// Floater or by user interaction").
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/neighborhoods.hpp"
#include "pointmorph/progress.hpp"
#include "pointmorph/types.hpp"

namespace pointmorph {

struct BoundaryOptions {
    /// Largest angle between successive neighbours, seen in the tangent plane, that an interior
    /// point may have; degrees, 60 to 180.
    double max_gap = 100.0;
    /// Loops shorter than this many local spacings are taken for gaps in the sampling; 4 or more.
    double min_loop = 16.0;
};

/// A closed sequence of rows: each point once, the first follows the last. Anticlockwise seen
/// from outside: the surface lies on the left when one walks along it with the normal up.
using BoundaryLoop = std::vector<Index>;

/// All boundary loops of the cloud, longest first; none on a closed surface.
std::vector<BoundaryLoop> find_boundary_loops(const Positions& positions, const Normals& normals,
                                              const Neighborhoods& nearest,
                                              const BoundaryOptions& options, Progress& progress);

/// Checks a loop that the caller gave (rows in range, at least three, none twice) and turns it
/// anticlockwise. `name` is the cloud's, for errors. Throws FeatureError.
BoundaryLoop oriented_loop(const Positions& positions, const Normals& normals,
                           const Neighborhoods& nearest, BoundaryLoop loop,
                           const std::string& name);

/// Length of the closed polygon.
double loop_length(const Positions& positions, std::span<const Index> loop);

}  // namespace pointmorph

// A patch of a shape with the curves around it, on its way to the disk; not for callers of the
// library.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "morph/prepared_shape.hpp"
#include "pointmorph/morph/morph.hpp"
#include "pointmorph/surface/geodesics.hpp"

namespace pointmorph {

/// The patch's points, then its boundary.
struct PatchCloud {
    std::vector<Index> rows;  ///< of the side, ascending, without the boundary's
    Positions positions;
    Normals normals;
    BoundaryLoop loop;  ///< rows of `positions`

    /// `boundary` is closed: its first point follows the last.
    PatchCloud(const Side& side, std::vector<Index> inside, const SurfaceCurve& boundary);

    /// Row here of a row of the side.
    Index place(Index row) const;
};

/// Where the points of two closed curves lie on the circle, the corners (rows, the first with the
/// first and so on) at the same angles on both.
std::array<std::vector<double>, 2> rim_angles(const SurfaceCurve& source,
                                              std::span<const Index> source_corners,
                                              const SurfaceCurve& target,
                                              std::span<const Index> target_corners,
                                              BoundarySpacing spacing);

/// Onto the disk with the boundary at `angles`. Adds to what is said of the side's
/// parameterization.
DiskPoints on_disk(const Side& side, const PatchCloud& patch, std::span<const double> angles,
                   const MorphOptions& options, ParameterizationReport& said, MorphReport& report,
                   Progress& progress);

}  // namespace pointmorph

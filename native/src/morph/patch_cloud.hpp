// A patch of a shape with the curves around it, on its way to the disk. Not for callers of the
// library.
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "morph/prepared_shape.hpp"
#include "pointmorph/disk/alignment.hpp"
#include "pointmorph/disk/parameterization.hpp"
#include "pointmorph/morph/report.hpp"
#include "pointmorph/surface/geodesics.hpp"

namespace pointmorph {

/// How patches are laid over each other on the disk.
struct PatchOptions {
    Index neighbors = 16;  ///< nearest points that are looked up for a full solve
    ParameterizationOptions parameterization;
    AlignmentOptions alignment;
    PairingOptions pairing;
};

/// The patch's points, then its boundary.
struct PatchCloud {
    std::vector<Index> rows;  ///< sorted rows, ascending, without the boundary's points
    Positions positions;
    Normals normals;
    BoundaryLoop loop;  ///< rows of `positions`

    /// `boundary` is closed: its first point follows the last.
    PatchCloud(const PreparedShape& shape, std::vector<Index> inside, const SurfaceCurve& boundary);

    /// The patch's row of a sorted row.
    Index patch_row(Index sorted) const;
};

/// Where the points of two closed curves lie on the circle, with the corners (rows, the first with
/// the first and so on) at the same angles on both.
std::array<std::vector<double>, 2> rim_angles(const SurfaceCurve& source,
                                              std::span<const Index> source_corners,
                                              const SurfaceCurve& target,
                                              std::span<const Index> target_corners,
                                              BoundarySpacing spacing);

/// A patch on the disk.
struct PatchOnDisk {
    DiskPoints points;             ///< rows of the patch
    ParameterizationReport facts;  ///< without the boundary points
    Index joined = 0;              ///< points in separate parts that were tied to the largest
};

/// With the boundary at `angles`.
PatchOnDisk on_disk(const PreparedShape& shape, const PatchCloud& patch,
                    std::span<const double> angles, const PatchOptions& options,
                    Progress& progress);

/// Adds a warning where points were joined.
void warn_of_joined(const PatchOnDisk& disk, const PreparedShape& shape,
                    std::vector<std::string>& warnings);

}  // namespace pointmorph

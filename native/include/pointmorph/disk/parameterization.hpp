// Stage `parameterization`: an open patch onto the unit disk (paper, eqs. (1)-(3), Fast
// Parameterization steps 2 and 3; Floater, Meshless parameterization).
#pragma once

#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/lod.hpp"
#include "pointmorph/surface/boundary.hpp"
#include "pointmorph/surface/sampled_surface.hpp"

namespace pointmorph {

/// How the boundary points are spread over the circle between pinned points.
enum class BoundarySpacing { kUniform, kChordLength };

/// Which system is solved: that of all points (the paper's baseline), or that of the simplified
/// cloud, into which all points are then embedded (the paper's method).
enum class SolveMode { kFull, kLod };

struct ParameterizationOptions {
    BoundarySpacing boundary_spacing = BoundarySpacing::kChordLength;
    SolveMode solve = SolveMode::kLod;
    LodOptions lod;
    /// Neighbors of a point in eq. (2), made mutual; 6 to 64. Unused if `radius` is set.
    Index neighbors = 10;
    /// Radius r of the paper's ball neighborhoods, in spacings of the cloud that is solved for;
    /// 1 to 20. None: nearest neighbors.
    std::optional<double> radius;
    /// Whether parts that aren't connected to the boundary are tied to the rest by an edge, and
    /// counted; else they are an error.
    bool join_parts = false;
    /// Relative residual at which the iterative solver stops; 1e-14 to 1e-3.
    double tolerance = 1e-8;
    /// Iterations after which it gives up; 1 or more.
    Index max_iterations = 10000;
};

/// A boundary point with a given angle on the circle.
struct BoundaryPin {
    Index position;  ///< in the loop, 0-based
    double angle;    ///< radians
};

/// Angles on the unit circle, radians, anticlockwise in the order of the loop, that start at
/// `pins[0]` (or at 0 for the loop's first point without a pin). Pins are in the loop's order, and
/// their angles ascend over less than a turn. Throws FeatureError.
std::vector<double> boundary_angles(const Positions& positions, std::span<const Index> loop,
                                    BoundarySpacing spacing, std::span<const BoundaryPin> pins);

/// The pins of features on both boundaries, given as pairs of positions in the two loops: each pair
/// gets the same angle, the mean of its angles by each loop's own spacing, after the rotation that
/// fits best. Sorted by position. Throws FeatureError where the cyclic orders differ.
struct MatchedPins {
    std::vector<BoundaryPin> source;
    std::vector<BoundaryPin> target;
};
MatchedPins match_pins(const Positions& source_positions, std::span<const Index> source_loop,
                       const Positions& target_positions, std::span<const Index> target_loop,
                       BoundarySpacing spacing, std::span<const IndexPair> features);

/// The boundary of a patch, placed on the unit circle.
struct CircleBoundary {
    std::span<const Index> loop;     ///< rows, anticlockwise
    std::span<const double> angles;  ///< radians, one a row; see boundary_angles()
};

/// A patch on the unit disk.
struct Parameterization {
    DiskPoints points;             ///< #points by 2, in the closed unit disk
    Index unknowns = 0;            ///< interior points of the system that was solved
    Index iterations = 0;          ///< of the solver, the larger of both coordinates
    double relative_residual = 0;  ///< ‖Au − b‖ / ‖b‖ reached
    Index joined = 0;              ///< points in parts that were tied to the rest
    double solve_seconds = 0;      ///< assembly and solution of the system alone
};

/// Boundary points go onto the circle; interior points become convex combinations of their
/// neighbors with reciprocal-distance weights, strictly positive and of sum 1. With kFull,
/// `patch.nearest` has at least `neighbors` a point; with kLod it isn't used. Throws TopologyError
/// where the graph falls apart or parts don't reach the boundary, ConvergenceError.
Parameterization parameterize(const SampledSurface& patch, const CircleBoundary& boundary,
                              const ParameterizationOptions& options, Progress& progress);

}  // namespace pointmorph

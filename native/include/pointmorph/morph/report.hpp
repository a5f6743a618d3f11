// What a morph says of itself.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/diagnostics.hpp"
#include "pointmorph/surface/pairing.hpp"
#include "pointmorph/surface/topology.hpp"

namespace pointmorph {

/// What the parameterization of one shape took (the paper's Table I); of several patches: the sum
/// of unknowns and seconds, the largest of the others.
struct ParameterizationReport {
    Index unknowns = 0;
    Index iterations = 0;
    double relative_residual = 0.0;
    double solve_seconds = 0.0;
    Index boundary_points = 0;

    void add(const ParameterizationReport& patch);
};

/// What the route from two shapes to their pairs found out. A new fact is a field here, set by its
/// route, and an entry in the report of the bindings.
struct RouteFacts {
    /// Largest distance between hard point features in spacings of the points around them: in the
    /// disk, or of the smooth maps on the other surface. Quality::features has each one's.
    double feature_residual = 0.0;
    /// With the paper's method as they are by default.
    Diagnostics diagnostics;
    double alignment_rotation = 0.0;
    Index alignment_sweeps = 0;
    ParameterizationReport source_parameterization;
    ParameterizationReport target_parameterization;
    /// The loop that was given, or suggested where domain cut got none; see suggest_loop().
    std::vector<std::string> loop;
    /// Ends of the curves of a network, in the order in which they were traced, and the number of
    /// patches between them; see Network.
    std::vector<std::array<std::string, 2>> curves;
    Index patches = 0;
    /// Unmarked extremities that were paired; see Decomposition.
    Pairing extremities;
};

/// Rows are given rows.
struct MorphReport : RouteFacts {
    std::string method;
    std::string domain;
    Topology source_topology, target_topology;  ///< without labels
    /// The domain, and what the shapes are: "product space: closed surfaces of genus 1 and 0".
    std::string choice;
    std::vector<StageTime> stages;
    double seconds = 0.0;
    Index pairs = 0;
    /// Of a map that was to be updated: "updated", or why it was looked for from scratch; else
    /// empty. See LiveMorph.
    std::string update;
    std::vector<std::string> warnings;
};

}  // namespace pointmorph

// Stage `network`: two closed shapes of the same genus cut alike into patches, each a disk, by a
// network of curves between features (paper, Morphing of Complex Models, for more than one curve
// and for shapes that are not of genus 0).
//
// Both shapes are cut at the same time: a curve is taken only where it leaves and arrives between
// the same other curves on both. So the patches are the same by construction, however the shapes
// look (Praun, Sweldens, Schroeder 2001; Kraevoy and Sheffer 2004; Schreiner et al. 2004).
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/disk/decomposition.hpp"
#include "pointmorph/surface/geodesics.hpp"

namespace pointmorph {

/// One of the two shapes. `features` are rows, none twice, in the order of their names.
struct NetworkSide {
    const KdTree<3>& tree;
    const Normals& normals;        ///< unit length, outwards
    const Neighborhoods& nearest;  ///< joins the cloud
    std::vector<Index> features;
    std::string name;
    /// Handles, where that is known.
    std::optional<Index> genus;
};

/// From one feature to another, on the source and on the target; about as dense as the clouds. New
/// points on the surface, but for both ends.
struct NetworkCurve {
    Index from, to;
    std::array<SurfaceCurve, 2> on;
};

/// A curve walked one way: 2 × its place, forwards; one more, backwards.
using Dart = Index;

struct Network {
    std::vector<NetworkCurve> curves;
    /// The boundary of each patch, anticlockwise seen from outside: no curve twice.
    std::vector<std::vector<Dart>> patches;
    /// Which patch each point of the source and of the target lies in, −1 for features.
    std::array<std::vector<Index>, 2> labels;
    Index genus = 0;
    /// How much longer the curves are than the shortest ways between their ends, in √area, mean of
    /// the sum over both shapes.
    double detour = 0.0;
    /// See Decomposition::unmarked.
    std::array<UnmarkedExtremities, 2> unmarked;
};

/// Curves of the `loops`, closed sequences of features, are traced first, then as many as it takes:
/// the shortest on both shapes together first, all features joined, all handles opened, no patch
/// meeting itself. Throws FeatureError, TopologyError.
Network trace_network(const std::array<NetworkSide, 2>& sides, std::span<const std::string> names,
                      std::span<const std::vector<Index>> loops,
                      const DecompositionOptions& options, Progress& progress);

}  // namespace pointmorph

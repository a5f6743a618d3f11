// Stage `network`: two closed shapes of the same genus cut alike into patches, each a disk, by a
// network of curves between features (paper, Morphing of Complex Models, for more than one curve
// and for shapes that are not of genus 0).
//
// Both shapes are cut at the same time: a curve is added only where it leaves and arrives between
// the same other curves on both. So both get the same patches by construction, however different
// they look (Praun, Sweldens, Schroeder 2001; Kraevoy and Sheffer 2004; Schreiner et al. 2004).
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/disk/decomposition.hpp"
#include "pointmorph/surface/geodesics.hpp"
#include "pointmorph/surface/sampled_surface.hpp"

namespace pointmorph {

/// One of the two shapes.
struct NetworkShape {
    SampledSurface surface;
    const KdTree<3>& tree;        ///< over its positions
    std::vector<Index> features;  ///< rows, none twice, in the order of their names
    std::optional<Index> genus;   ///< handles, if known
};

/// From one feature to another, on the source and on the target; about as dense as the clouds. Its
/// points are new, on the surface, except for both ends.
struct NetworkCurve {
    Index from, to;
    std::array<SurfaceCurve, 2> on;
};

/// A curve in one direction: 2 × its index forward, one more backward.
using Dart = Index;

struct Network {
    std::vector<NetworkCurve> curves;
    /// The boundary of each patch, anticlockwise seen from outside; no curve twice.
    std::vector<std::vector<Dart>> patches;
    /// Which patch each point of the source and of the target lies in, −1 for features.
    std::array<std::vector<Index>, 2> labels;
    Index genus = 0;
    /// How much longer the curves are than the shortest paths between their ends, in √area: the
    /// mean over the curves of the sum over both shapes.
    double detour = 0.0;
    /// See Decomposition::unmarked.
    std::array<UnmarkedExtremities, 2> unmarked;
};

/// Traces the curves of the `loops` first (closed sequences of features), then as many as it takes
/// to join all features, open all handles and leave no patch that meets itself, those that are
/// shortest on both shapes together first. Throws FeatureError, TopologyError.
Network trace_network(const std::array<NetworkShape, 2>& shapes, std::span<const std::string> names,
                      std::span<const std::vector<Index>> loops,
                      const DecompositionOptions& options, Progress& progress);

}  // namespace pointmorph

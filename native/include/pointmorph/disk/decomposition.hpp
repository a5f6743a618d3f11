// Stage `decomposition`: a closed shape cut into two patches along a closed curve through features
// (paper, Morphing of Complex Models).
//
// The curve runs from feature to feature along the surface. At a feature on a limb it arrives on
// the side that faces the previous feature and leaves on the side that faces the next one, and its
// parts keep away from each other, so that each patch gets half of the limb. The patches are what
// lies to the left and to the right of the directed curve.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/surface/extremity_pairing.hpp"
#include "pointmorph/surface/geodesics.hpp"
#include "pointmorph/surface/sampled_surface.hpp"

namespace pointmorph {

struct DecompositionOptions {
    /// How many of the points the curve is searched among, about; 100 or more.
    Index points = 3000;
    /// What a path costs, per length, on the wrong side of a limb and away from both features'
    /// limbs, besides 1; 0 or more.
    double guide = 4.0, elsewhere = 2.0;
    /// What it costs next to parts of the curve that have been found already; 0 or more.
    double repulsion = 12.0;
    /// Rounds of straightening: more make the curve shorter, fewer keep it closer to the guide.
    Index straightening = 12;
    /// Unmarked extremities to look for at the most; 0 for none.
    Index extremities = 12;
    /// The smallest share of the points that a patch may have; 0 to 0.5.
    double smallest_share = 0.02;
};

/// Where a point lies: on one of the patches, or on the curve (its features).
enum class Patch : std::uint8_t { kLeft, kRight, kCurve };

/// Unmarked extremities that differ by more than this, along the surface and on the disk, don't
/// belong together; see paired_extremities().
inline constexpr double kLargestDifference = 0.35;

struct Decomposition {
    /// Closed: the first point follows the last. About as dense as the cloud; its points are new,
    /// on the surface, except for the features.
    SurfaceCurve curve;
    std::vector<Index> corners;  ///< where each feature is in the curve, ascending from 0
    std::vector<Patch> patches;  ///< #points

    /// Extremities away from the features (ears, a tail) and on none of the curve's points; rows of
    /// the cloud.
    UnmarkedExtremities unmarked;
};

/// The cut that is asked for.
struct CutRequest {
    std::span<const Index> features;    ///< rows, none twice; those of the loop first, in its order
    std::span<const std::string> loop;  ///< names of the loop's features, three or more
    /// For each feature beyond the loop the patch that it should lie on, kCurve for either one;
    /// empty: no wish. The curve is led round features on the wrong patch, where that is possible.
    std::span<const Patch> wanted{};
};

/// The surface is closed and its normals point outward; `tree` holds its positions. Left is
/// anticlockwise seen from outside: your left hand as you walk along the curve, head up along the
/// normal. Throws FeatureError where the curve can't be kept from crossing itself, TopologyError
/// where it doesn't divide the surface in two.
Decomposition decompose(const SampledSurface& surface, const KdTree<3>& tree,
                        const CutRequest& request, const DecompositionOptions& options,
                        Progress& progress);

/// What a loop is proposed from.
struct FeatureReach {
    Eigen::MatrixXd distances;       ///< between features along the surface, in √area
    std::vector<char> at_extremity;  ///< whether a feature sits at an extremity
};
FeatureReach feature_reach(const SampledSurface& surface, const KdTree<3>& tree,
                           std::span<const Index> features, const DecompositionOptions& options,
                           Progress& progress);

/// Indices of the features at extremities of both shapes (of either, or all features, where that
/// leaves fewer than three), in the order of a short closed tour on both together, the lowest
/// first. Fewer than three only where there are fewer features.
std::vector<Index> propose_loop(const FeatureReach& source, const FeatureReach& target);

}  // namespace pointmorph

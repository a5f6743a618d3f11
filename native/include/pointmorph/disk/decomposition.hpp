// Stage `decomposition`: a closed shape cut into two patches along a closed curve through features
// (paper, Morphing of Complex Models).
//
// The curve runs from feature to feature along the surface. Where features sit on limbs, it comes
// in on the side of a limb that faces the feature before and leaves on the side that faces the next
// one, and its parts keep away from each other, so that each patch gets its half of the limb. What
// lies left and right of the directed curve are the patches: nothing to vote about.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/surface/extremity_pairing.hpp"
#include "pointmorph/surface/geodesics.hpp"

namespace pointmorph {

struct DecompositionOptions {
    /// The curve is searched for among about so many of the points; 100 or more.
    Index points = 3000;
    /// How much dearer a way is on the wrong side of a limb, and off the limbs of both features.
    double guide = 4.0, elsewhere = 2.0;
    /// How much dearer it is next to parts of the curve that are there already.
    double repulsion = 12.0;
    /// Rounds of straightening: more is shorter, fewer keeps to the guided way.
    Index straightening = 12;
    /// Tips of the shape that are looked for, besides the features; 0 for none.
    Index tips = 12;
    /// A patch with less than this share of the points isn't one.
    double smallest_share = 0.02;
};

/// Where a point lies: on one of the patches, or on the curve (its features).
enum class Patch : std::uint8_t { kLeft, kRight, kCurve };

/// Unmarked extremities that differ by more than this, along the surface and on the disk, don't
/// belong together; see paired_extremities().
inline constexpr double kLargestDifference = 0.35;

struct Decomposition {
    /// Closed: the first point follows the last. About as dense as the cloud. New points on the
    /// surface, but for the features.
    SurfaceCurve curve;
    std::vector<Index> corners;  ///< place of each feature in the curve, ascending from 0
    std::vector<Patch> patches;  ///< #points

    /// Extremities away from the features (ears, a tail) and on none of the curve's points; rows of
    /// the cloud.
    UnmarkedExtremities unmarked;
};

/// `features`: rows, none twice; the first `names.size()` of them, three or more, are the loop, in
/// order, called `names`. `normals` are unit length and point outwards; `nearest` joins the cloud.
/// Left is anticlockwise seen from outside: on the left hand when one walks along the curve with
/// the normal up. `name` is the cloud's, for errors. `wanted`, where it isn't empty, has for each
/// feature beyond the loop the patch that it should lie on, kCurve for either: the curve is led
/// round those that it leaves on the other one, where it can be. Throws FeatureError where the
/// curve can't be kept from crossing itself, TopologyError where it doesn't divide the surface in
/// two.
Decomposition decompose(const KdTree<3>& tree, const Normals& normals, const Neighborhoods& nearest,
                        std::span<const Index> features, std::span<const std::string> names,
                        const DecompositionOptions& options, const std::string& name,
                        Progress& progress, std::span<const Patch> wanted = {});

/// What a loop is proposed from.
struct FeatureReach {
    Eigen::MatrixXd distances;  ///< between features along the surface, in √area
    std::vector<char> on_tip;   ///< whether a feature sits on a tip of the shape
};
FeatureReach feature_reach(const KdTree<3>& tree, const Normals& normals,
                           const Neighborhoods& nearest, std::span<const Index> features,
                           const DecompositionOptions& options, Progress& progress);

/// Places of the features that sit on tips of both shapes (of either, or all of them, where that
/// leaves fewer than three), in the order of a short closed tour on both together; the lowest comes
/// first. Fewer than three where there are no more features.
std::vector<Index> propose_loop(const FeatureReach& source, const FeatureReach& target);

}  // namespace pointmorph

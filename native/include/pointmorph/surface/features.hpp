// Stage `features`: what the user marks on both shapes (points, curves, regions), checked and
// prepared for the other stages. The paper has points only.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

/// kPoint: one point matches one point. kCurve: a curve, given by points in order, matches a curve
/// by share of the length. kRegion: weighted points match weighted points.
enum class FeatureKind { kPoint, kCurve, kRegion };

/// The points of one cloud that a feature marks.
struct Marked {
    std::vector<Index> rows;  ///< one; a curve's in order; a region's in any order
    /// Regions only: how much each row belongs to it, 0 to 1. Empty: all rows in full.
    std::vector<double> weights;

    double weight(std::size_t i) const { return weights.empty() ? 1.0 : weights[i]; }
};

/// A place on the source and the same place on the target. Curves and regions need not have the
/// same number of rows on both.
struct Feature {
    std::string name;
    FeatureKind kind = FeatureKind::kPoint;
    Marked source, target;
    bool closed = false;  ///< curves: the first row follows the last, on both shapes
    bool hard = true;     ///< met exactly; else it pulls with its weight
    double weight = 1.0;  ///< > 0; only soft features have an effect from it
};

/// A hard point feature.
Feature point_feature(std::string name, Index source, Index target);

std::string name_of(FeatureKind kind);

/// As many regions as can be told apart.
constexpr Index kMostRegions = 16;

/// Throws FeatureError unless
/// - every row is in its cloud, at most once in a feature, and in at most one point feature;
/// - points have one row, curves two or more (three if closed), regions one or more;
/// - weights are in range, regions weigh something, and there are at most `kMostRegions` of them;
/// - names differ, and hard features don't contradict one another.
void validate(std::span<const Feature> features, const Cloud& source, const Cloud& target);

/// The same features for clouds whose row i has become row `source_rank[i]` or `target_rank[i]`.
/// Their order, and the direction of curves, depend on the marked rows alone: not on names, the
/// order given, or which end of a curve comes first on both shapes.
std::vector<Feature> canonical(std::span<const Feature> features,
                               std::span<const Index> source_rank,
                               std::span<const Index> target_rank);

/// Rows that must meet exactly, each pair once: hard points, and the ends of hard curves (of a
/// closed one the first point).
std::vector<IndexPair> pinned_pairs(std::span<const Feature> features);

/// A polygon on a surface.
struct TracedCurve {
    Positions places;             ///< #places by 3; consecutive places differ
    Normals normals;              ///< of the surface there
    std::vector<double> lengths;  ///< from the first place; #places, one more if closed
    std::vector<Index> marks;     ///< the place of each marked row
    bool closed = false;

    double length() const { return lengths.back(); }
    /// The point at a share of the length, 0 to 1.
    Vector3 at(double share) const;
    /// The place at or before a share of the length.
    Index before(double share) const;
    /// The share of the length at the i-th marked row.
    double share(std::size_t i) const { return lengths[to_size(marks[i])] / length(); }
};

/// The curve through the marked rows in order: straight between rows a few samples apart, else
/// along the surface, by a shortest path from sample to sample that is then pulled straight.
/// Straight, too, where there is no path. `normals` have unit length.
TracedCurve trace_curve(const KdTree<3>& surface, const Normals& normals,
                        std::span<const Index> rows, bool closed, Progress& progress);

/// How well a map keeps one feature.
struct FeatureResidual {
    std::string name;
    FeatureKind kind;
    bool hard;
    double weight;
    /// In spacings of the samples there, the worse of both directions. Points: the distance between
    /// image and partner. Curves: root mean square, over the marked points, of the distance to the
    /// same share of the other curve. Regions: mean, over their points, of the distance outside the
    /// partner.
    double residual;
    /// Regions: the share of points whose image is in the partner, the worse of both directions. 1
    /// for the others.
    double inside = 1.0;
};

/// One shape and where a map takes its points.
struct MappedSurface {
    const KdTree<3>& tree;    ///< over its positions
    const Normals& normals;   ///< unit length
    const Positions& images;  ///< of every point, in the other shape's coordinates
};

/// One for each of the `features`, whose rows are those of the trees.
std::vector<FeatureResidual> feature_residuals(std::span<const Feature> features,
                                               const MappedSurface& source,
                                               const MappedSurface& target, Progress& progress);

}  // namespace pointmorph

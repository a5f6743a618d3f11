// Stage `features`: what the user marks on both shapes (points, curves, regions), checked and
// brought into the form in which the other stages use it. Past the paper, which knows points only.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

/// kPoint: one point that belongs to one point. kCurve: points in order along a curve that belongs
/// to a curve, by share of the length. kRegion: weighted points that belong to weighted points.
enum class FeatureKind { kPoint, kCurve, kRegion };

/// The points of one cloud that a feature marks.
struct Marked {
    std::vector<Index> rows;  ///< one; a curve's in order; a region's in any order
    /// Regions: how much each row belongs to it, 0 to 1; empty where all do in full. Else empty.
    std::vector<double> weights;

    double weight(std::size_t i) const { return weights.empty() ? 1.0 : weights[i]; }
};

/// A place of the source and the place of the target that belongs to it. Both sides of a curve or
/// region have as many rows as they like.
struct Feature {
    std::string name;
    FeatureKind kind = FeatureKind::kPoint;
    Marked source, target;
    bool closed = false;  ///< curves: the last row is followed by the first, on both sides
    bool hard = true;     ///< holds exactly; else pulls with its weight
    double weight = 1.0;  ///< of a soft feature, > 0; hard ones hold whatever it is
};

/// A hard point feature.
Feature point_feature(std::string name, Index source, Index target);

std::string name_of(FeatureKind kind);

/// So many regions can be told apart.
constexpr Index kMostRegions = 16;

/// Throws FeatureError for rows that aren't in the clouds, marked twice in a feature, or that are
/// two point features on one side; for other numbers of rows than 1 for a point, 2 or more (3 where
/// closed) for a curve and 1 or more for a region; for weights out of their range, regions that
/// weigh nothing, more than `kMostRegions` of them; for two features of one name; and for hard
/// features whose points or ends contradict one another.
void validate(std::span<const Feature> features, const Cloud& source, const Cloud& target);

/// The same features for clouds whose row i has become row `source_rank[i]` and `target_rank[i]`,
/// in an order, and curves in a sense, that depend on the marked rows alone: neither on names nor
/// on the order in which they were given, nor on which end of a curve comes first on both sides.
std::vector<Feature> canonical(std::span<const Feature> features,
                               std::span<const Index> source_rank,
                               std::span<const Index> target_rank);

/// Rows that must meet exactly, each pair once: hard points, and the ends of hard curves (of a
/// closed one the first point).
std::vector<IndexPair> pinned_pairs(std::span<const Feature> features);

/// A curve on a surface, from place to place in a straight line.
struct TracedCurve {
    Positions places;             ///< #places by 3, no two neighbours coincident
    Normals normals;              ///< of the surface there
    std::vector<double> lengths;  ///< from the first place; #places, one more where it's closed
    std::vector<Index> marks;     ///< the places of the marked rows, one a row
    bool closed = false;

    double length() const { return lengths.back(); }
    /// `share` of the length from the first place, 0 to 1.
    Vector3 at(double share) const;
    /// The place at or before `share` of the length.
    Index before(double share) const;
    /// Share of the length at which the i-th marked row lies.
    double share(std::size_t i) const { return lengths[to_size(marks[i])] / length(); }
};

/// Through the marked rows in their order: straight between those that lie a few samples apart,
/// else along the surface, by a shortest path from sample to sample that is then pulled straight.
/// `normals` has unit rows. Where no path is found within the surface, straight.
TracedCurve trace_curve(const KdTree<3>& surface, const Normals& normals,
                        std::span<const Index> rows, bool closed, Progress& progress);

/// How well a map keeps one feature.
struct FeatureResidual {
    std::string name;
    FeatureKind kind;
    bool hard;
    double weight;
    /// In spacings of the samples there, the worse of both ways. Points: the distance between image
    /// and partner. Curves: root mean square, over the marked points, of the distance to the place
    /// at the same share of the other's length. Regions: mean over its points of how far they land
    /// outside of the partner.
    double residual;
    /// Share of the feature's points that land in the partner, the worse of both ways: regions. 1
    /// for the others.
    double inside = 1.0;
};

/// `features` are rows of the clouds, whose positions the trees hold; normals have unit length.
/// Images have a row for each point, in the coordinates of the other cloud.
std::vector<FeatureResidual> feature_residuals(
    std::span<const Feature> features, const KdTree<3>& source, const Normals& source_normals,
    const KdTree<3>& target, const Normals& target_normals, const Positions& source_images,
    const Positions& target_images, Progress& progress);

}  // namespace pointmorph

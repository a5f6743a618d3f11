// What the features mark on both shapes, prepared for a registration. Not for callers of the
// library.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/product_space.hpp"
#include "pointmorph/registration/registration.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

/// A curve on both shapes.
struct MarkedCurve {
    TracedCurve source, target;
    bool hard;
    double weight;
};

/// A region on both shapes.
struct MarkedRegion {
    const Feature* feature;
    IndexPair centers;  ///< a row in the middle of either
};

/// Rows are cloud rows. Refers to the features, which must outlive it.
struct Marks {
    std::vector<IndexPair> pinned;            ///< must meet exactly
    std::vector<const Feature*> soft_points;  ///< points that pull
    std::vector<MarkedCurve> curves;
    std::vector<MarkedRegion> regions;
    /// How far every point belongs to each region, a column for each; no rows without regions.
    Labels source_members, target_members;
    /// Rows that belong together, roughly, which show the pose: points, some of each curve, and the
    /// middles of regions.
    std::vector<IndexPair> pose_pairs;
    Index pose_points = 0;  ///< how many of these are points
};

/// `features` are in canonical() order.
Marks marks_of(std::span<const Feature> features, const OrientedView& source,
               const OrientedView& target, Progress& progress);

/// The curves, those on the target moved along with it.
std::vector<MarkedCurve> with_target_moved(std::vector<MarkedCurve> curves, const Similarity& move);

/// A curve on both shapes: as many places on either, at the same shares of the length.
struct CurvePlaces {
    Positions source, target;                ///< #places by 3
    Normals source_normals, target_normals;  ///< of the surfaces there
};

/// Evenly spaced, no further apart than `spacing` on the longer side.
CurvePlaces places_along(const MarkedCurve& curve, double spacing);

/// Guides of the source and the target from soft points, curves, and the centers of regions, which
/// only show the pose. All marked rows are among those of the coarse shapes. `node_spacing` is
/// about how far apart the nodes of the finest level are.
std::array<Guides, 2> guides_of(const CoarsePair& shapes, const Marks& marks, double node_spacing,
                                const RegistrationOptions& options);

/// The labels of coarse points, and how much their matches pull.
struct RegionLabels {
    Labels labels;  ///< see CoarseShape
    Values pulls;
};

/// `members` says how far the coarse points belong to each of the regions; no rows without.
RegionLabels region_labels(Labels members, std::span<const MarkedRegion> regions,
                           const RegistrationOptions& options);

/// The row that is nearest to the weighted mean of those marked, among those of half the largest
/// weight.
Index central_row(const Marked& marked, const Positions& positions);

/// #points by one column for each hard region: how far each point belongs to it. Nothing where
/// there are none.
DynamicRows hard_region_members(std::span<const Feature> features, Marked Feature::*side,
                                Eigen::Index points);

/// Points of a shape in the product space, and hard_region_members() of them.
struct RegionPoints {
    ProductPoints points;
    DynamicRows members;
};

/// mutual_pairs() that keep to the hard regions.
Pairing pairs_within_regions(const RegionPoints& source, const RegionPoints& target,
                             std::span<const IndexPair> pinned, Progress& progress);

}  // namespace pointmorph

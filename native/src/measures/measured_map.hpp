// The maps between two clouds, measured point by point. Internal.
#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/measures/quality.hpp"

namespace pointmorph {

/// Distortion above this is bad.
inline constexpr double kBad = 1.0;
/// A round trip of this length, in √area, is bad.
inline constexpr double kBadRoundTrip = 0.05;
/// As many of a point's nearest say how the map stretches there.
inline constexpr Index kMeasuredNeighbors = 16;
/// An image this near to an end of the other cloud, in √area, lies there.
inline constexpr double kEndNear = 0.02;
/// Larger stretch counts as this much.
inline constexpr double kStrongest = 20.0;

/// One cloud, in the unit ball and in spatial order, with what is measured on it.
struct MeasuredCloud {
    /// `neighbors` must outlive it: kMeasuredNeighbors or more a point, where there are that many.
    MeasuredCloud(const Cloud& cloud, const OrderedNeighbors& neighbors);
    MeasuredCloud(MeasuredCloud&&) = delete;  // the tree refers to the positions

    Index size() const { return to_index(positions.rows()); }
    Vector3 position(Index i) const { return positions.row(i); }
    Vector3 normal(Index i) const { return normals.row(i); }
    /// The nearest points, ascending by distance.
    std::span<const Index> near(Index i) const {
        const auto all = neighbors.nearest[i];
        return all.first(std::min(all.size(), to_size(kMeasuredNeighbors)));
    }
    /// Whether two points lie on the same side of the surface, by their normals.
    bool same_side(Index i, Index j) const;
    /// Where rows of the cloud lie here.
    Positions places_of(std::span<const Index> rows) const;
    /// The row of the cloud.
    Index given(Index i) const { return neighbors.order[to_size(i)]; }

    const OrderedNeighbors& neighbors;
    std::vector<Index> sorted;  ///< where each row of the cloud is here
    Normalization unit;
    Positions positions;
    Normals normals;
    double root_area;  ///< √area, of what isn't beyond_part()
    Values spacing;
    KdTree<3> tree;
};

/// The map from one cloud to the other, in spatial order.
struct MeasuredMap {
    /// Where a map's Jacobian takes two orthonormal tangents at a point.
    using Slopes = std::array<Vector3, 2>;

    Positions images;
    std::vector<Slopes> slopes;  ///< until round trips are measured
    std::vector<Index> foot;     ///< row of the other cloud nearest to the image, on its side
    std::vector<double> edges;   ///< stretch of some edges
    Values energy;               ///< mean squared stretch of each point's edges; < 0: none
    PointQuality points;
    MapFigures figures;
    std::vector<char> beyond;  ///< beyond_part(), which doesn't count in the figures
};

/// The maps in both directions.
struct MeasuredMaps {
    MeasuredMap there, back;
};
/// Has the clouds' `root_area` be that of what isn't beyond_part().
MeasuredMaps measure_maps(MeasuredCloud& source, MeasuredCloud& target, const TwoWayMap& map,
                          Progress& progress);

/// Of images, whether they lie within `near` of `ends`, where the other cloud stops: 1 for what has
/// no counterpart. Without ends no elements.
std::vector<char> lie_at_ends(const Positions& images, const Positions& ends, double near,
                              Progress& progress);

/// lie_at_ends() of all of a cloud, where so much of it does that the other one is a part of it:
/// sizes are then compared as the part has them.
struct BeyondPart {
    std::vector<char> rows;  ///< none where the other is no part
    double left = 1.0;       ///< share of the area that isn't beyond
};
BeyondPart beyond_part(const Positions& images, const Positions& ends, double near,
                       const Values& spacing, Progress& progress);

/// √((ln² s₁ + ln² s₂) / 2), bounded.
double strain(double larger, double smaller);

/// Whether most of the map is flipped.
bool is_mirrored(const MapFigures& figures);

/// The value that `share` of the values are below; 0 where there are none.
double quantile(std::span<const double> values, double share);

}  // namespace pointmorph

// The maps between two clouds, measured point by point. Internal.
#pragma once

#include <array>
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
/// Larger stretch counts as this much.
inline constexpr double kStrongest = 20.0;

/// One cloud, in the unit ball, with what is measured on it.
struct MeasuredCloud {
    MeasuredCloud(const Cloud& cloud, Progress& progress);
    MeasuredCloud(MeasuredCloud&&) = delete;  // the tree refers to the positions

    Index size() const { return static_cast<Index>(positions.rows()); }
    Vector3 position(Index i) const { return positions.row(i); }
    Vector3 normal(Index i) const { return normals.row(i); }
    /// Whether two points lie on the same side of the surface, by their normals.
    bool same_side(Index i, Index j) const;

    Normalization unit;
    Positions positions;
    Normals normals;
    KdTree<3> tree;
    double root_area;  ///< √area
    Neighborhoods nearest;
    Values spacing;
};

/// The map from one cloud to the other.
struct MeasuredMap {
    Positions images;
    std::vector<Matrix3> jacobian;  ///< takes displacements in the tangent plane to the image's
    std::vector<Index> foot;        ///< row of the other cloud nearest to the image, on its side
    std::vector<double> edges;      ///< stretch of some edges
    Values energy;                  ///< mean squared stretch of each point's edges; < 0: none
    PointQuality points;
    MapFigures figures;
};

/// The maps in both directions.
struct MeasuredMaps {
    MeasuredMap there, back;
};
MeasuredMaps measure_maps(const MeasuredCloud& source, const MeasuredCloud& target,
                          const TwoWayMap& map, Progress& progress);

/// √((ln² s₁ + ln² s₂) / 2), bounded.
double strain(double larger, double smaller);

/// Whether most of the map is flipped.
bool is_mirrored(const MapFigures& figures);

/// The value that `share` of the values are below; 0 where there are none. Reorders them.
double quantile(std::vector<double>& values, double share);

}  // namespace pointmorph

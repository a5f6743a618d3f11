// Stage `quality`: how good the maps between two clouds are, point by point and in figures, and
// what would help where they are worst. Not in the paper, which shows pictures.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/surface/features.hpp"
#include "pointmorph/surface/pairing.hpp"

namespace pointmorph {

/// #points by 2: the larger and the smaller singular value of a Jacobian, both ≥ 0.
using SingularValues = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;

/// What the map from one cloud to the other does at every point of that cloud.
struct PointQuality {
    /// Of the Jacobian, which is fitted to the images of the 16 nearest points on the same side of
    /// the surface, with both surfaces scaled to unit area. 1 and 1 where only the size differs,
    /// and where it couldn't be measured. Their product is the ratio of areas.
    SingularValues stretch;
    /// 0 where too few neighbors lie on the same side of the surface, or all on a line.
    std::vector<std::uint8_t> measured;
    /// 1 where the map turns the surface over: the image shows its back face. Everywhere, if one
    /// cloud's normals point inward.
    std::vector<std::uint8_t> flipped;
    /// 1 where the image of some point of the other cloud lies within two spacings.
    std::vector<std::uint8_t> reached;
    /// How far from itself a point ends after the round trip, in √area of its own surface.
    Values round_trip;
    /// All of it in one number, ≥ 0; over 1 is bad. The largest of √((ln² s₁ + ln² s₂) / 2), with
    /// both singular values clamped to 1/20 … 20; the round trip over 0.05 √area; 1 where not
    /// reached; 2 where flipped while most of the cloud isn't, or the reverse.
    Values distortion;
};

/// A map in figures. Shares, 0 to 1, are of the points, or of those measured where that applies.
struct MapFigures {
    double dirichlet = 0.0;         ///< mean squared stretch of edges; 1 or more for a bijection
    double stretch_p99 = 0.0;       ///< 99th percentile of the stretch of edges; 1: none
    double conformal_median = 0.0;  ///< median of (s₁/s₂ + s₂/s₁) / 2; 1: angles are kept
    double flipped = 0.0;           ///< share
    double collapsed = 0.0;         ///< share with s₂ < 0.05 s₁
    double round_trip_mean = 0.0;   ///< in √area of the surface where the map starts
    double round_trip_p99 = 0.0;
    double coverage = 0.0;  ///< share of the other cloud's points that are `reached`
};

enum class Flaw {
    kMirrored,   ///< nearly all flipped: left and right are swapped, or normals point inward
    kFolded,     ///< flipped, unlike the rest
    kLost,       ///< doesn't come back, or isn't reached
    kStretched,  ///< from the source to the target; kSqueezed likewise
    kSqueezed
};
/// "mirrored", "folded" …
std::string name_of(Flaw flaw);

/// A place where many bad points lie together.
struct Place {
    Index source;       ///< row
    Index target;       ///< row nearest to its image
    Flaw flaw;          ///< of most bad points there; kFolded if a fifth of them are folded
    double distortion;  ///< mean over the point and its neighbors
    double share;       ///< of the surface covered by its bad points, 0 to 1
    bool on_source;     ///< the model that the bad points are of
    std::string where;  ///< "toward +X of Fox", "near \"nose\""; empty where it is everywhere
    std::string advice;
};

struct Quality {
    PointQuality source, target;
    MapFigures source_to_target, target_to_source;
    /// At most five, far apart, the worst first; empty where the map is good.
    std::vector<Place> worst;
    std::vector<FeatureResidual> features;  ///< one a feature, in their order
};

/// The sides of the bounding box that a point is near: "toward +X, -Z", or "in the middle".
/// `positions` lie in the unit ball around the origin.
std::string direction_in_words(const Positions& positions, Index row);

/// Maps in both directions between two clouds that have normals.
struct TwoWayMap {
    const Cloud& source;
    const Cloud& target;
    const Positions& source_images;    ///< #source by 3, in the target's coordinates
    const Positions& target_images;    ///< #target by 3, in the source's coordinates
    std::span<const IndexPair> pairs;  ///< tell both sides of a thin part apart
    /// 16 or more a point, where they are known.
    const OrderedNeighbors* source_neighbors = nullptr;
    const OrderedNeighbors* target_neighbors = nullptr;
    /// Rows along borders where a cloud ends while the other goes on, as Diagnostics has them: what
    /// lies there of the other has no counterpart, and is none of the worst places.
    std::span<const Index> source_ends = {}, target_ends = {};
};

/// `features` are measured, and give the advice its words. The result doesn't depend on the scale,
/// position or orientation of the clouds.
Quality measure_quality(const TwoWayMap& map, std::span<const Feature> features,
                        Progress& progress);

}  // namespace pointmorph

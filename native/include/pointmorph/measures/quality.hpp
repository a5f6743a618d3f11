// Stage `quality`: how good the maps between two clouds are, point by point and in figures, and
// what would help where they are worst. Past the paper, which shows pictures instead.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/surface/features.hpp"
#include "pointmorph/surface/pairing.hpp"

namespace pointmorph {

/// #points by 2: the larger and the smaller singular value of a Jacobian, both ≥ 0.
using SingularValues = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;

/// What the map from one cloud to the other does at every point of that cloud.
struct PointQuality {
    /// The Jacobian is fitted to the images of those of the 16 nearest points that lie on the same
    /// sheet, with both surfaces scaled to unit area: 1 and 1 where only the size differs. Their
    /// product is the ratio of areas. 1 and 1 where it couldn't be measured.
    SingularValues stretch;
    /// 0 where too few neighbours lie on the same sheet, or all on a line.
    std::vector<std::uint8_t> measured;
    /// 1 where the image shows its back: its side that faces out isn't the one of the surface that
    /// it lies on. All of them where one cloud's normals point inwards.
    std::vector<std::uint8_t> flipped;
    /// 1 where some point of the other cloud lands within two spacings.
    std::vector<std::uint8_t> reached;
    /// How far from itself a point ends up there and back, in √area of its own surface.
    Values round_trip;
    /// One number for all of it, ≥ 0; over 1 is bad. The largest of √((ln² s₁ + ln² s₂) / 2) with
    /// both singular values kept between 1/20 and 20; the round trip over 0.05 √area; 1 where no
    /// point of the other cloud lands; 2 where flipped and most of the cloud isn't, or the reverse.
    Values distortion;
};

/// A map in figures. Shares, 0 to 1, are those of the points; of those measured where it matters.
struct MapFigures {
    double dirichlet = 0.0;         ///< mean squared stretch of edges; 1 or more for a bijection
    double stretch_p99 = 0.0;       ///< 99th percentile of the stretch of edges; 1 = none
    double conformal_median = 0.0;  ///< median of (s₁/s₂ + s₂/s₁) / 2; 1 = angles are kept
    double flipped = 0.0;           ///< share
    double collapsed = 0.0;         ///< share with s₂ < 0.05 s₁
    double round_trip_mean = 0.0;   ///< in √area of the surface from which the map starts
    double round_trip_p99 = 0.0;
    double coverage = 0.0;  ///< share of the other cloud's points that are `reached`
};

enum class Flaw {
    kMirrored,   ///< nearly all is flipped: left and right are swapped, or normals point inwards
    kFolded,     ///< flipped, unlike the rest
    kLost,       ///< doesn't come back, or isn't reached
    kStretched,  ///< from the source to the target, as is kSqueezed
    kSqueezed
};
/// "mirrored", "folded" …
std::string name_of(Flaw flaw);

/// Where many bad points lie together.
struct Place {
    Index source;       ///< row
    Index target;       ///< row, where that point lands
    Flaw flaw;          ///< that of most bad points there; a fold where a fifth of them show one
    double distortion;  ///< mean over the point and its neighbours
    double share;       ///< bad points' share of the surface, 0 to 1
    std::string advice;
};

struct Quality {
    PointQuality source, target;
    MapFigures source_to_target, target_to_source;
    /// At most five, far apart, the worst first; empty where the map is good.
    std::vector<Place> worst;
    std::vector<FeatureResidual> features;  ///< one for each feature, in their order
};

/// The sides of the bounding box towards which a point lies: "towards +X, -Z", or "in the middle".
/// `positions` have area 1 and lie around the origin.
std::string direction_in_words(const Positions& positions, Index row);

/// Both clouds have normals. `source_images` (#source by 3) says where source points lie on the
/// target, in its coordinates, `target_images` (#target by 3) the reverse. `pairs` tell both sides
/// of a thin sheet apart; `features` give the advice its words and are measured. Rows as in the
/// clouds. The result doesn't depend on the scale, place or orientation of the clouds.
Quality measure_quality(const Cloud& source, const Cloud& target, const Positions& source_images,
                        const Positions& target_images, std::span<const IndexPair> pairs,
                        std::span<const Feature> features, Progress& progress);

}  // namespace pointmorph

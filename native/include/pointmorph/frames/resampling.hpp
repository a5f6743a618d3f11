// Stage `resampling`: points that close the cracks of the in-between clouds (paper, Dynamic
// Re-sampling).
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/surface/local_triangles.hpp"
#include "pointmorph/surface/mls.hpp"

namespace pointmorph {

struct ResamplingOptions {
    /// The paper's Ω: points are missing where the density is below this share of that of both
    /// ends; 0 to 2. 0 inserts nothing.
    double omega = 0.8;
    /// How far apart new points lie, in the spacing of both ends; 0.25 to 4.
    double spacing = 1.0;
    MlsOptions mls;
    /// Points hide where the density is more than this many times that of either end, 1.5 to 100;
    /// none: never.
    std::optional<double> crowding{};
};

/// From when to when something is there, at its full size between `full` and `fading`.
struct Life {
    double born = 0.0, full = 0.0, fading = 1.0, gone = 1.0;

    /// 0 to 1, the share of its size at t: smooth, so that nothing pops.
    double share(double t) const;
};

/// A new point: a place on the surface that three pairs span, all the way from source to target.
struct InsertedPoint {
    std::array<Index, 3> pairs;     ///< rows of the pairing
    std::array<double, 3> weights;  ///< ≥ 0, of sum 1
    Life life;
};

/// A pair that is hidden where points crowd, and when.
struct HiddenPair {
    Index pair;
    Life life;
};

/// Which points are inserted, once for the whole morph; then where they are at any t.
///
/// At a number of times, the same for every morph, the cloud is compared with what both ends would
/// have there (wanted_density()), and where points are missing, places between pairs that are
/// neighbours on the source or on the target get a new point, unless one lies close by. So a
/// new point has one identity from its birth to its end, its place at t depends on t alone, and no
/// point comes to be where neither model has a surface.
class Resampling {
public:
    /// Places and unit normals of all pairs at t, 0 < t < 1.
    using FrameAt = std::function<OrientedPoints(double t)>;

    /// `source` and `target` have three points or more, and normals. `pairs` are their rows; every
    /// row is in at least one. Throws OptionError, and Cancelled.
    Resampling(const Cloud& source, const Cloud& target, std::span<const IndexPair> pairs,
               const FrameAt& frame_at, const ResamplingOptions& options, Progress& progress);

    const ResamplingOptions& options() const noexcept { return options_; }

    /// All that ever live, in the order of their ids.
    const std::vector<InsertedPoint>& points() const noexcept { return points_; }
    const std::vector<HiddenPair>& hidden() const noexcept { return hidden_; }

    /// Those with a share of more than 0.
    struct Alive {
        std::vector<Index> ids;  ///< rows of points()
        Values share;            ///< of the full size
        Positions positions;     ///< on the MLS surface of the pairs
        Normals normals;         ///< unit length
    };
    /// `frame`: all pairs at t, with unit normals. Nothing at t = 0 and t = 1. The same bits for
    /// any number of threads, whatever was asked before.
    Alive at(double t, const OrientedPoints& frame, Progress& progress) const;

    /// The pairs' share of their full size at t: 1 unless hidden.
    Values pair_shares(double t) const;

    /// How far apart samples lie at t where both ends have their way: the paper blends densities;
    /// this blends their spacings, as radii are.
    double spacing(Index pair, double t) const {
        return (1.0 - t) * source_spacing_[pair] + t * target_spacing_[pair];
    }

    static constexpr Index kDensityNeighbors = 8;

    /// The paper's test ρ < ((1 − t) ρ' + t ρ'') Ω, with ρ = k/r², r the distance to the k-th
    /// nearest point. Densities count per share of the surface, so that a shape that grows doesn't
    /// become sparse by that: ρ' and ρ'' times the area of source and target, ρ times the area at
    /// t, whose root is taken to change evenly.
    double wanted_density(Index pair, double t) const {
        return (1.0 - t) * source_density_[pair] + t * target_density_[pair];
    }
    double unit_area(double t) const;

private:
    ResamplingOptions options_;
    Values source_spacing_, target_spacing_;        ///< by pair
    Values source_density_, target_density_;        ///< by pair, per share of the surface
    double source_size_ = 1.0, target_size_ = 1.0;  ///< √area
    std::vector<InsertedPoint> points_;
    std::vector<HiddenPair> hidden_;
};

}  // namespace pointmorph

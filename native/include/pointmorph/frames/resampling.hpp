// Stage `resampling`: points that close the cracks of in-between clouds (paper, Dynamic
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
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/surface/local_triangles.hpp"
#include "pointmorph/surface/mls.hpp"

namespace pointmorph {

struct ResamplingOptions {
    /// The paper's Ω: points are missing where the density is below this share of that at both
    /// ends; 0 to 2. 0 inserts nothing.
    double omega = 0.8;
    /// How far apart new points lie, in the spacing of both ends; 0.25 to 4.
    double spacing = 1.0;
    MlsOptions mls;
    /// Pairs are hidden where the density is more than this many times that at either end; 1.5 to
    /// 100. None: never.
    std::optional<double> crowding{};
};

/// When something is there. It has its full size between `complete` and `fades`.
struct Lifetime {
    double appears = 0.0, complete = 0.0, fades = 1.0, vanishes = 1.0;

    /// The share of its size at t, 0 to 1: smooth, so that nothing pops.
    double share(double t) const;
};

/// A new point: a place on the surface between three pairs, all the way from source to target.
struct InsertedPoint {
    std::array<Index, 3> pairs;     ///< rows of the pairing
    std::array<double, 3> weights;  ///< ≥ 0, of sum 1
    Lifetime lifetime;
};

/// A pair that is hidden where points crowd. Its lifetime is that of its being hidden.
struct HiddenPair {
    Index pair;
    Lifetime lifetime;
};

/// What is decided once for the whole morph.
struct ResamplingPlan {
    /// All points that are ever inserted; ids are their indices.
    std::vector<InsertedPoint> points;
    std::vector<HiddenPair> hidden;
    /// At both ends, by pair; densities per share of the surface.
    Values source_spacing{}, target_spacing{}, source_density{}, target_density{};
    double source_size = 1.0, target_size = 1.0;  ///< √area
};

/// Decides once for the whole morph which points are inserted; then says where they are at any t.
///
/// At fixed times the cloud is compared with the density that both ends ask for (wanted_density()).
/// Where points are missing, places between pairs that are neighbors on the source or on the target
/// get a new point, unless one lies close by. So a new point keeps its identity, its place at t
/// depends on t alone, and no point appears where neither model has a surface.
class Resampling {
public:
    /// Places and unit normals of all pairs at t, 0 < t < 1.
    using FrameAt = std::function<OrientedPoints(double t)>;

    /// One of both clouds: three or more points, and normals.
    struct End {
        const Cloud& cloud;
        const OrderedNeighbors* neighbors;  ///< kNeighbors of each point or more; null: to be found

        End(const Cloud& its_cloud, const OrderedNeighbors* known = nullptr)
            : cloud(its_cloud), neighbors(known) {}
    };

    /// Every row of both ends is in at least one of the `pairs`. Throws OptionError, Cancelled.
    Resampling(End source, End target, std::span<const IndexPair> pairs, const FrameAt& frame_at,
               const ResamplingOptions& options, Progress& progress);
    /// From the plan of an earlier one for as many pairs. Throws CloudError if it doesn't fit them.
    Resampling(ResamplingPlan plan, Index pairs, const ResamplingOptions& options);

    const ResamplingOptions& options() const noexcept { return options_; }

    const ResamplingPlan& plan() const noexcept { return plan_; }
    const std::vector<InsertedPoint>& points() const noexcept { return plan_.points; }
    const std::vector<HiddenPair>& hidden() const noexcept { return plan_.hidden; }

    /// The points that are there at some t.
    struct Alive {
        std::vector<Index> ids;  ///< rows of points()
        Values share;            ///< of the full size
        Positions positions;     ///< on the MLS surface of the pairs
        Normals normals;         ///< unit length
    };
    /// `frame` has all pairs at t, with unit normals. No points at t = 0 and t = 1. The same bits
    /// for any number of threads and any order of calls. `meanwhile`, unless it is empty, is called
    /// once, next to what one thread does alone.
    Alive at(double t, const OrientedPoints& frame, Progress& progress,
             const std::function<void()>& meanwhile = {}) const;

    /// The pairs' share of their full size at t: 1 unless hidden.
    Values pair_shares(double t) const;

    /// The distance of samples at t, blended from both ends like radii. (The paper blends
    /// densities.)
    double spacing(Index pair, double t) const {
        return (1.0 - t) * plan_.source_spacing[pair] + t * plan_.target_spacing[pair];
    }

    static constexpr Index kNeighbors = 16, kDensityNeighbors = 8;

    /// The paper's test ρ < ((1 − t) ρ' + t ρ'') Ω, with ρ = k/r², r the distance to the k-th
    /// nearest point. Densities count per share of the surface, so that a shape that grows doesn't
    /// become sparse by that: ρ' and ρ'' times the area of source and target, ρ times the area at
    /// t, whose root is taken to change evenly.
    double wanted_density(Index pair, double t) const {
        return (1.0 - t) * plan_.source_density[pair] + t * plan_.target_density[pair];
    }
    double unit_area(double t) const;

private:
    ResamplingOptions options_;
    ResamplingPlan plan_;
};

}  // namespace pointmorph

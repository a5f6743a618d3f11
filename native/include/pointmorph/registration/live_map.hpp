// Stage `live_map`: a map that was found, kept with all that it takes to bend it to changed
// features in a moment, instead of looking for it again.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/prolongation.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "pointmorph/registration/registration.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

/// The feature that a map leaves farthest from its partner; of a curve its ends, of a region its
/// middle.
struct FarFeature {
    std::string name;
    double distance = 0.0;  ///< in √area; the larger of both directions
};

/// Points on or near the source that are to follow a map, and where the coarsest level takes them
/// before anything changes.
struct FollowingPoints {
    Positions positions;  ///< where the source is registered
    Normals normals;
    Prolongation prolongation;
    Positions before;
};

struct LiveUpdate {
    Refinement refinement;
    /// Share of the surface's edges that the new features tear and the old ones didn't; where it is
    /// above `most_torn` of the registration, the map should be looked for from scratch.
    double newly_torn = 0.0;
};

/// Two clouds, features and a map that keeps to them. An update starts from that map, never from
/// another update: it depends on the features alone, and the way there and back ends where it
/// began. What the features change is the difference between two registrations from the same start,
/// with the new features and with the old ones; all else stays as the map has it. All queries are
/// const and may come from several threads.
class LiveMap {
public:
    /// `features` are valid and in canonical() order, `map` is in the clouds' coordinates; what the
    /// clouds refer to outlives this. Throws Cancelled.
    LiveMap(const RefinementCloud& source, const RefinementCloud& target,
            std::span<const Feature> features, RefinementStart map,
            const RefinementOptions& options, Progress& progress);
    ~LiveMap();
    LiveMap(LiveMap&&) noexcept;

    const RefinementStart& map() const noexcept;
    /// Takes the target to where the source is.
    Similarity alignment() const;

    /// An update is no better than a guess for a feature farther than
    /// `RefinementOptions::trusted_distance`. Nameless where there are no features.
    FarFeature farthest(std::span<const Feature> features) const;

    /// `positions` and `normals` (unit length) in the source's coordinates, #points by 3.
    FollowingPoints follow(const Positions& positions, const Normals& normals,
                           Progress& progress) const;

    /// How far the features take the points from where the map does, #points by 3, in the target's
    /// coordinates: by the coarsest level alone. All 0 for the features as they were.
    Positions shifts(const FollowingPoints& points, std::span<const Feature> features,
                     Progress& progress) const;

    /// The whole map for the features, as refine() gives it.
    LiveUpdate updated(std::span<const Feature> features, Progress& progress) const;

private:
    struct State;
    std::unique_ptr<const State> state_;
};

}  // namespace pointmorph

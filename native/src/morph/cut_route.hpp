// The paper's route from two closed shapes to pairs of points: each cut into two patches, patches
// onto disks, disks aligned, merged and paired. Not for callers of the library.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "disk/cut_ground.hpp"
#include "morph/patch_cloud.hpp"
#include "morph/route_result.hpp"
#include "pointmorph/disk/decomposition.hpp"

namespace pointmorph {

/// Both shapes with the same features, as a loop is looked for on them and they are cut.
class CutGrounds {
public:
    /// Next to each other, a core each. Keeps references to the shapes.
    CutGrounds(const RouteInput& input, std::span<const IndexPair> features,
               const DecompositionOptions& options, Progress& progress);
    CutGrounds(const CutGrounds&) = delete;
    CutGrounds& operator=(const CutGrounds&) = delete;

    const CutGround& operator[](bool is_source) const { return *sides_[is_source ? 0 : 1].ground; }
    /// Whether these are their features, in any order.
    bool have(std::span<const IndexPair> features) const;

private:
    struct Side {
        std::optional<KdTree<3>> tree;
        std::optional<CutGround> ground;
    };
    std::array<Side, 2> sides_;
};

struct CutRouteOptions {
    DecompositionOptions decomposition;
    PatchOptions patches;
};

/// Along the features called `loop`, in this order. The common domain is the unit sphere, to which
/// both disks are glued along their rims: the left patch above, the right one below, the curve on
/// the equator (inverse stereographic projection). `known_grounds`: those from which the loop was
/// suggested, or null. Throws FeatureError for a loop that can't cut, TopologyError, and the errors
/// of the stages.
RouteResult match_in_patches(const RouteInput& input, std::span<const std::string> loop,
                             const CutGrounds* known_grounds, const CutRouteOptions& options,
                             Progress& progress);

}  // namespace pointmorph

// Two clouds on their way through a refinement: where they lie to each other, what is marked on
// them, and their coarse shapes. Rows are cloud rows but for those that are called coarse. Not for
// callers of the library.
#pragma once

#include <cmath>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "pointmorph/registration/registration.hpp"
#include "registration/marks.hpp"

namespace pointmorph {

/// As refine() got them.
struct GivenClouds {
    const RefinementCloud& source;
    const RefinementCloud& target;
};

/// A cloud moved so that it has area 1 and its mean at the origin.
struct UnitCloud {
    Similarity placement;  ///< takes given positions to those here
    Positions positions;
};

struct UnitClouds {
    UnitCloud source, target;
};

UnitClouds at_unit_area(const GivenClouds& given, Progress& progress);

/// A cloud where it is registered, with a tree over its points.
struct PlacedCloud {
    Similarity placement;                     ///< takes given positions to those here
    std::unique_ptr<const Positions> places;  ///< which the tree refers to
    KdTree<3> tree;
    Normals normals;
    const Neighborhoods* nearest;

    PlacedCloud(const Similarity& move, Positions positions, Normals its_normals,
                const Neighborhoods* known)
        : placement(move),
          places(std::make_unique<const Positions>(std::move(positions))),
          tree(*places),
          normals(std::move(its_normals)),
          nearest(known) {}

    const Positions& positions() const { return *places; }
    double spacing() const { return 1.0 / std::sqrt(static_cast<double>(tree.size())); }
    PlacedCloud moved(const Similarity& move) const {
        return {composed(move, placement), move.apply(*places), move.rotated(normals), nearest};
    }
};

/// Both clouds where they lie to each other, what is marked on them, and their coarse shapes.
struct Scene {
    PlacedCloud source, target;
    Marks marks;
    CoarseShape coarse_source, coarse_target;
    std::vector<IndexPair> coarse_features;

    CoarsePair coarse() const { return {coarse_source, coarse_target, coarse_features}; }
};

/// The scene with the target moved by `alignment` from where it is at unit area.
Scene scene_of(const GivenClouds& given, const UnitClouds& unit, Marks marks,
               const Similarity& alignment, const RefinementOptions& options, Progress& progress);

Scene with_target_normals_reversed(Scene scene);
/// Moves what is coarse or marked of the target, but not its points, which wait for
/// PlacedCloud::moved().
Scene with_coarse_target_moved(Scene scene, const Similarity& move);

/// How the target lies to the source at unit area, as far as marks or an earlier map say.
struct FirstAlignment {
    Similarity alignment;
    bool fixes_the_pose = false;  ///< else other poses are to be tried
};

/// By `start`, an earlier map, where there is one.
FirstAlignment first_alignment(const UnitClouds& unit, const Marks& marks,
                               const RefinementStart* start, Index features_that_fix_the_pose);

/// Whether an earlier map leaves no mark farther than `trusted_distance` from its partner.
bool is_trusted(const RefinementStart& start, const GivenClouds& given, const UnitClouds& unit,
                const Marks& marks, double trusted_distance);

/// An earlier map's images of the coarse points, pulled to the marks.
RegistrationStart start_from(const RefinementStart& earlier, const Scene& scene);

}  // namespace pointmorph

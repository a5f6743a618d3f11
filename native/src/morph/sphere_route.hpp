// From two closed shapes of genus 0 to pairs of points, without a cut (the paper's future work):
// both onto the unit sphere, aligned there, merged and paired.
#pragma once

#include <span>

#include "morph/prepared_shape.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/morph/morph.hpp"

namespace pointmorph {

struct SphereRoute {
    KdTree<3>::Points source, target;  ///< on the unit sphere, rows of the sides
    Pairing pairs;
};

/// `features`, in canonical order, are rows of the sides; see point_features(). Fills in what the
/// report says of parameterization and alignment. Throws TopologyError for open surfaces, and the
/// errors of the stages.
SphereRoute match_on_sphere(Side& source, Side& target, const MorphInput& input,
                            std::span<const Feature> features, const MorphOptions& options,
                            MorphReport& report, Progress& progress);

}  // namespace pointmorph

// The paper's way from two open patches to pairs of points: both onto the unit disk, aligned there,
// merged and paired.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "morph/prepared_shape.hpp"
#include "pointmorph/morph/morph.hpp"

namespace pointmorph {

struct DiskRoute {
    DiskPoints source, target;  ///< rows of the sides
    Pairing pairs;
};

/// Fills in what the report says of parameterization and alignment. Estimated normals are turned
/// where the features show that they pointed inwards. Throws TopologyError for closed surfaces,
/// and the errors of the stages.
/// `features`, in canonical order, are rows of the sides. The disks know points only: of curves
/// some are taken; with method paper, regions throw FeatureError.
DiskRoute match_in_disk(Side& source, Side& target, const MorphInput& input,
                        std::span<const Feature> features, const MorphOptions& options,
                        MorphReport& report, Progress& progress);

}  // namespace pointmorph

// From images of all points near the other surface to smooth maps on it and pairs: how every
// refinement ends. Rows are cloud rows. Not for callers of the library.
#pragma once

#include <functional>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/registration/prolongation.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "registration/marks.hpp"
#include "registration/scene.hpp"

namespace pointmorph {

/// Both clouds where they lie to each other, and what is to meet. Refers to all of it.
struct MarkedClouds {
    const PlacedCloud& source;
    const PlacedCloud& target;
    const Marks& marks;
};

/// Images of all points of both clouds, where the scene has the other one.
struct SceneImages {
    OrientedPoints source, target;
};

/// How the surroundings of a row have rotated and grown.
struct LinearMaps {
    std::function<Matrix3(Index)> source, target;
};

/// How all points of a cloud follow its coarse ones.
Prolongation prolongation(const PlacedCloud& cloud, const CoarseShape& coarse, Progress& progress);

/// Where all points go when the coarse ones go to `images`.
OrientedPoints prolonged(const PlacedCloud& cloud, const CoarseShape& coarse,
                         const Prolongation& prolongation, const DeformedCloud& images,
                         Progress& progress);

/// So moved that hard marks meet, and what is around them smoothly with them.
SceneImages with_marks_met(SceneImages images, const MarkedClouds& scene, const LinearMaps& linear,
                           Progress& progress);

/// Enters "product space" and "landing". Diagnostics and `inside_out` are left for the caller.
Refinement on_surfaces(SceneImages images, const MarkedClouds& scene, const GivenClouds& given,
                       double normal_weight, Progress& progress);

}  // namespace pointmorph

// What other maps say of the one that the search for the pose chose. Not for callers of the
// library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/registration/alternatives.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/pose.hpp"
#include "registration/pose_trials.hpp"

namespace pointmorph {

/// How much a competitor speaks against a map.
double doubt_from(const Competitor& other);

/// How all other maps differ from the first of `maps`. What was tried is sorted.
Alternatives alternatives_to_first(const CoarsePair& shapes, std::span<const Candidate> maps,
                                   std::span<const NodeImages> tried);

/// The first of the maps, with its rivals, margin and confidence.
Pose rated(const CoarsePair& shapes, std::vector<Candidate> maps,
           std::span<const NodeImages> tried);

}  // namespace pointmorph

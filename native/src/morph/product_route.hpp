// The way of method auto from two clouds to maps and pairs: refined in the product space, piece by
// piece where there are several.
#pragma once

#include <optional>
#include <span>

#include "morph/prepared_shape.hpp"
#include "pointmorph/morph/morph.hpp"

namespace pointmorph {

/// `features`, in canonical order, and `start`, where there is one, are in rows and coordinates of
/// the sides. Warnings about pieces go into the report. Throws the errors of the stages.
Refinement match_in_product_space(const Side& source, const Side& target,
                                  std::span<const Feature> features,
                                  const std::optional<RefinementStart>& start,
                                  const MorphOptions& options, MorphReport& report,
                                  Progress& progress);

}  // namespace pointmorph

// What is refused before or between the stages of a morph. Not for callers of the library.
#pragma once

#include <span>
#include <string>

#include "morph/prepared_shape.hpp"
#include "pointmorph/morph/morph_input.hpp"
#include "pointmorph/morph/morph_options.hpp"

namespace pointmorph {

/// Clouds and features. Where the faces are sampled, a few vertices are enough. Throws CloudError,
/// FeatureError.
void check_shapes(const MorphInput& input, const MorphOptions& options);

/// Names of point features, three or more, each once; none is fine. Throws FeatureError.
void check_loop(std::span<const std::string> loop, std::span<const Feature> features);

/// All loops, and that several are asked for where they can be used. Throws FeatureError,
/// OptionError.
void check_loops(const MorphInput& input, const MorphOptions& options);

/// Throws FeatureError for regions, which method paper can't use.
void check_for_paper(std::span<const Feature> features);

/// Two point features may not share a place, even where it has several given rows: throws
/// FeatureError. `features` in sorted rows.
void check_places(std::span<const Feature> features, const PreparedShape& source,
                  const PreparedShape& target);

/// An image for every point, on or around the other cloud, or none at all. Throws CloudError.
void check_start(const RefinementStart& start, const Cloud& source, const Cloud& target);

/// Whether all places are so near to a cloud that they can be images on it: what is too far to be
/// one is too large to be computed with.
bool lie_around(const Positions& places, const Cloud& cloud);

/// What needs a closed surface.
enum class Closed { kLoop, kNetwork, kSphere };

/// Throws FeatureError for a loop, else TopologyError, where the boundary (`given`, in given rows,
/// or found) is the rim of an open patch. Holes are fine.
void require_closed(Closed purpose, const PreparedShape& shape, std::span<const Index> given,
                    const BoundaryOptions& options, Progress& progress);

/// The given pairs of a morph that was found earlier: rows of the clouds, each row in one. Throws
/// CloudError.
void check_pairs(const Pairing& pairs, const Cloud& source, const Cloud& target);

}  // namespace pointmorph

// Stage `components`: which components of two shapes that have several belong together: a body and
// its two eyes, a table and its plates.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "pointmorph/surface/features.hpp"
#include "pointmorph/surface/topology.hpp"

namespace pointmorph {

struct ComponentOptions {
    /// Components don't belong together whose sizes (root mean square distance to the middle)
    /// differ by a larger factor, once the shapes have the same size …
    double size_ratio = 3.0;
    /// … or that a map of the whole shapes takes further apart than this many times their sizes.
    double distance = 2.0;
    /// Components of a larger share of the points start from that map, smaller ones from their
    /// places and sizes alone.
    double small_share = 0.1;
};

/// One of the two shapes, and where a map of the whole takes its points. Refers to all of it: the
/// caller keeps it alive.
struct ComponentView {
    const Topology& topology;
    const Positions& positions;  ///< #points by 3
    const Normals& normals;      ///< #points by 3
    const Positions& images;     ///< #points by 3, in the other's coordinates
};

struct ComponentMatching {
    /// Components that belong together, those of the most points first; the first are the main
    /// ones.
    std::vector<IndexPair> matched;
    std::vector<Index> source_alone, target_alone;  ///< main() components without a counterpart
};

/// By the least sum of differences in place and size; `alignment` takes the target to the source.
/// Strays stay out of it.
ComponentMatching match_components(const ComponentView& source, const ComponentView& target,
                                   const Similarity& alignment, const ComponentOptions& options);

/// A hard region for each match but the main one, `most` at the most, in their order: what isn't
/// in any belongs to the main components. Rows are those of the clouds.
std::vector<Feature> component_regions(const Topology& source, const Topology& target,
                                       std::span<const IndexPair> matched, Index most);

/// The images, but those of small components in `regions` rotated and scaled onto their
/// counterparts as wholes.
RefinementStart component_start(const ComponentView& source, const ComponentView& target,
                                std::span<const Feature> regions, const Similarity& alignment,
                                const ComponentOptions& options);

/// Whether none of the regions is larger than what goes as a whole.
bool are_small(std::span<const Feature> regions, Index source_size, Index target_size,
               const ComponentOptions& options);

/// What kept_apart() keeps to. Rows are those of the clouds.
struct ComponentMarks {
    std::span<const Feature> regions;   ///< component_regions()
    std::span<const IndexPair> pinned;  ///< stay where they are
};

/// The map with every point of a region taken into its counterpart, as a whole, and all others out
/// of it: they keep where the map took them, if that isn't in it. Nothing is bent again. The views
/// are of what refine() got, with the images of `map`.
Refinement kept_apart(const Refinement& map, const ComponentView& source,
                      const ComponentView& target, const ComponentMarks& marks,
                      const ComponentOptions& options, Progress& progress);

/// A shape's components and what the user calls it.
struct NamedTopology {
    const Topology& topology;
    const std::string& name;
};

/// What was done about the components, for the user; empty where there is one of each.
std::vector<std::string> components_in_words(const ComponentMatching& matching,
                                             const NamedTopology& source,
                                             const NamedTopology& target);

}  // namespace pointmorph

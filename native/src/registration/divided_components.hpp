// Components that take the place of several of the other shape's: the panel of a chair's back, and
// the rods of another's. Not for callers of the library.
#pragma once

#include <string>
#include <vector>

#include "pointmorph/registration/components.hpp"

namespace pointmorph {

/// A matching where some components are divided among several of the other shape's. Every share is
/// a component by itself, matched with the one that it is for.
struct DividedComponents {
    Topology source, target;  ///< with the shares in front of the strays
    ComponentMatching matching;
    std::vector<GroupKind> kinds;  ///< of each match; empty where nothing is divided
    /// How many each divided component is divided among.
    std::vector<Index> among_target, among_source;
};

/// What a matching was made by: see match_components().
struct MatchedBy {
    std::span<const IndexPair> marks;
    const Similarity& alignment;
    const ComponentOptions& options;
};

/// Divides each component that has no counterpart, or a worse one, where several of the other shape
/// lie together in its place and are as large and as long as it is. A point belongs to the one that
/// is nearest when they are laid over the component as a whole. What loses its counterpart by that
/// is matched once more with what has none. What marks join stays as it is. Throws Cancelled.
DividedComponents divide_components(const ComponentView& source, const ComponentView& target,
                                    const ComponentMatching& matching, const MatchedBy& by,
                                    Progress& progress);

/// What was divided, for the user; empty where nothing was.
std::vector<std::string> divisions_in_words(const DividedComponents& divided,
                                            const std::string& source, const std::string& target);

}  // namespace pointmorph

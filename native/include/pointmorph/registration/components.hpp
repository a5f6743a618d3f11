// Stage `components`: which components of two shapes that have several belong together, and a map
// that takes each to its counterpart: a body and its two eyes, a tree and its leaves.
#pragma once

#include <cstdint>
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
    /// The largest component keeps the map of the whole where the others have no larger share of
    /// the points than this, together.
    double small_share = 0.1;
    /// Components of fewer points on either shape go as wholes, moved and stretched; others are
    /// mapped by themselves.
    Index fewest_points = 60;
    /// A component without a counterpart keeps the map of the whole, unless more than this share of
    /// its images lies where others' images lie as well: then it has no room.
    double crowded = 0.5;
    /// What has no counterpart on either side is one another's all together, where it is this share
    /// of the points or more on both …
    double rest_share = 0.1;
    /// … and costs no more than this as one component on each side (a component may cost 0.75).
    double rest_cost = 1.0;
};

/// One of the two shapes, and where a map of the whole takes its points. Refers to all of it: the
/// caller keeps it alive.
struct ComponentView {
    const Topology& topology;
    const Positions& positions;     ///< #points by 3
    const Normals& normals;         ///< #points by 3
    const Positions& images;        ///< #points by 3, in the other's coordinates
    std::span<const Index> ends{};  ///< see RefinementCloud; ascending
};

struct ComponentMatching {
    /// Components that belong together, those of the most points first; the first are the main
    /// ones.
    std::vector<IndexPair> matched;
    std::vector<Index> source_alone, target_alone;  ///< main() components without a counterpart
    /// Components that a mark joins, of which the one that isn't larger is among these: it is a
    /// part of the other one, as a shoe is of a figure of one piece. Those that most marks join
    /// come first.
    std::vector<IndexPair> on_others;
    /// Of those that are alone, what is one another's counterpart all together: see match_rest().
    /// Ascending; or none. Their match is the last one, of the largest of both.
    std::vector<Index> source_rest, target_rest;
};

/// By the least sum of differences in place, size and proportions; `alignment` takes the target to
/// the source. Components that `marks` join (rows of both shapes) belong together before others do,
/// unless one is much larger and has a counterpart: then the other is on it. Strays stay out of it.
/// Throws Cancelled.
ComponentMatching match_components(const ComponentView& source, const ComponentView& target,
                                   std::span<const IndexPair> marks, const Similarity& alignment,
                                   const ComponentOptions& options, Progress& progress);

/// Makes what is alone on both sides one another's counterpart, all together, where it may be that:
/// the body of a car and a truck's chassis with its cab. Throws Cancelled.
void match_rest(ComponentMatching& matching, const ComponentView& source,
                const ComponentView& target, const Similarity& alignment,
                const ComponentOptions& options, Progress& progress);

/// A pair of rows for each feature, from the middle of curves and regions.
std::vector<IndexPair> joining_marks(std::span<const Feature> features);

/// The points of one shape, by the matches that they belong to.
struct GroupedPoints {
    std::vector<Index> groups;  ///< a place in ComponentMatching::matched
    /// −1, or for what has no counterpart and no room: the point of the same shape that it goes
    /// with, and whose group it has.
    std::vector<Index> anchors;
    /// Rows with an anchor, but for strays: those that components_in_words() tells of.
    std::vector<Index> loose;
};

/// Whether a group has a share of a component that is divided among several. It goes as a whole.
enum class GroupKind : std::uint8_t { kPlain, kShareOfSource, kShareOfTarget };

struct ComponentGroups {
    GroupedPoints source, target;
    Index count = 0;
    std::vector<char> joined;  ///< of each group: whether there are more than the two matched ones
    std::vector<GroupKind> kinds;    ///< of the first groups; all others are plain
    std::vector<IndexPair> matched;  ///< the components that each group is of
    /// Components that go with others, out of those that are alone.
    std::vector<Index> source_vanishing, target_appearing;

    GroupKind kind(std::size_t group) const {
        return group < kinds.size() ? kinds[group] : GroupKind::kPlain;
    }
};

/// Everything in the group of its match. A component without one has room, and is in the group of
/// what the map of the whole takes it to; or others have that already, and it has an anchor.
/// Throws Cancelled.
ComponentGroups group_components(const ComponentView& source, const ComponentView& target,
                                 const ComponentMatching& matching, const ComponentOptions& options,
                                 Progress& progress);

/// What the maps of groups keep to. Rows are those of the clouds.
struct ComponentMarks {
    const ComponentGroups& groups;
    std::span<const Feature> features;
};

/// How groups are told apart, and how each is mapped.
struct GroupMapping {
    const ComponentOptions& components;
    const RefinementOptions& refinement;
    Matrix3 target_turn;  ///< takes the target's axes to the source's
};

/// The map of the whole with every group mapped by itself: from where its components lie and how
/// large they are, and bent from there as refine() does. Groups that others have joined keep the
/// map of the whole, and so does what features don't allow to part: curves and regions that reach
/// over several groups.
Refinement mapped_by_group(const Refinement& whole, const ComponentView& source,
                           const ComponentView& target, const ComponentMarks& marks,
                           const GroupMapping& options, Progress& progress);

/// The map with points paired within their groups, those that were not put beside the nearest of
/// their partners, and all that has an anchor there. Nothing is bent again. The views are of what
/// refine() got, with the images of `map`.
Refinement kept_apart(Refinement map, const ComponentView& source, const ComponentView& target,
                      const ComponentMarks& marks, Progress& progress);

/// A shape's components and what the user calls it.
struct NamedTopology {
    const Topology& topology;
    const std::string& name;
};

/// What was done about the components, for the user, but for shares of them; empty where there is
/// one of each.
std::vector<std::string> components_in_words(const ComponentMatching& matching,
                                             const ComponentGroups& groups,
                                             const NamedTopology& source,
                                             const NamedTopology& target);

}  // namespace pointmorph

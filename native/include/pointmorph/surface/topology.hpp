// Stage `topology`: the components of the surface that a cloud samples, their borders and handles.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/part_counts.hpp"
#include "pointmorph/surface/boundary.hpp"
#include "pointmorph/surface/sampled_surface.hpp"

namespace pointmorph {

struct TopologyOptions {
    /// Cells of a component's surface among which its handles are counted: this many, then fewer.
    Index cells = 1000;
    /// Points of a component that are looked at; larger components are thinned to this many.
    Index points = 12000;
    /// Components with a smaller share of the points are strays; 0 to 1.
    double smallest_share = 0.002;
};

/// A connected part of the surface.
struct Component {
    Index points = 0;
    Index borders = 0;     ///< boundary loops, those around holes included
    bool is_open = false;  ///< one of the loops is long enough to be the rim of a patch
    /// Handles; none where the points don't say for sure.
    std::optional<Index> genus;
};

struct Topology {
    std::vector<Index> labels;          ///< #points: the component of each
    std::vector<Component> components;  ///< the one with the most points first, strays last
    /// How many of the last components are strays: too small to say more about, or scattered
    /// points.
    Index strays = 0;

    /// All but the strays.
    std::span<const Component> main() const {
        return std::span(components).first(components.size() - to_size(strays));
    }
};

/// A label for each point, from the faces. Two labels may be one component where points coincide.
using Parts = std::vector<Index>;

/// What faces say; all empty where there are none.
struct KnownParts {
    std::span<const Index> labels{};       ///< #points: which are connected
    std::span<const PartCounts> counts{};  ///< of each label, from 0; or none
};

/// `loops` are those of find_boundary_loops(). What `parts` don't say is found from the points.
/// Coincident points count once.
Topology find_topology(const SampledSurface& surface, std::span<const BoundaryLoop> loops,
                       const KnownParts& parts, const TopologyOptions& options, Progress& progress);

/// Whether a loop is long enough, for the surface's area, to be the rim of a patch rather than that
/// of a hole.
bool is_rim(double length, double area);

/// "a closed surface of genus 1", "3 pieces: an open patch and 2 closed surfaces of genus 0".
std::string in_words(const Topology& topology);

/// Whether a component doesn't go onto another without tears or folds, as far as is known: they
/// differ in handles, or only one is open.
bool differ(const Component& source, const Component& target);

/// "an open patch", "a closed surface of genus 1 with 2 holes".
std::string in_words(const Component& component, bool plural = false);

/// Why the morph must tear or fold, from the largest components. Empty where they don't differ.
std::string difference_in_words(const Topology& source, const std::string& source_name,
                                const Topology& target, const std::string& target_name);

/// Both clouds in one phrase: "closed surfaces of genus 1 and 0" where both have one component of
/// the same kind, else the source's words, "to", and the target's.
std::string in_words(const Topology& source, const Topology& target);

}  // namespace pointmorph

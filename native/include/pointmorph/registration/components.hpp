// Stage `pieces`: which pieces of two shapes in several pieces belong together: a body and its two
// eyes, a table and its plates.
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

struct PieceOptions {
    /// Pieces don't belong together whose sizes (root mean square distance to the middle) differ by
    /// a larger factor, once the shapes have the same size …
    double size_ratio = 3.0;
    /// … or that a map of the whole shapes takes further apart than this many times their sizes.
    double distance = 2.0;
    /// Pieces of a larger share of the points start from that map, smaller ones from their places
    /// and sizes alone.
    double carries_itself = 0.1;
};

/// One of the two shapes, and where a map of the whole takes its points.
struct PieceView {
    const Topology& topology;
    const Positions& positions;
    const Positions& images;  ///< #points by 3, in the other's coordinates
};

struct PieceMatching {
    /// Pieces that belong together, those of the most points first; the first are the main ones.
    std::vector<IndexPair> matched;
    std::vector<Index> source_alone, target_alone;  ///< main() pieces without a counterpart
};

/// By the least sum of differences in place and size; `alignment` takes the target to the source.
/// Specks stay out of it.
PieceMatching match_pieces(const PieceView& source, const PieceView& target,
                           const Similarity& alignment, const PieceOptions& options);

/// A hard region for each match but the main one, `most` at the most, in their order: what isn't
/// in any belongs to the main pieces.
std::vector<Feature> piece_regions(const Topology& source, const Topology& target,
                                   std::span<const IndexPair> matched, Index most);

/// The images, but those of small pieces in `regions` turned and scaled onto their counterparts as
/// wholes.
RefinementStart piece_start(const PieceView& source, const PieceView& target,
                            std::span<const Feature> regions, const Similarity& alignment,
                            const PieceOptions& options);

/// Whether none of the regions is larger than what goes as a whole.
bool are_small(std::span<const Feature> regions, Index source_size, Index target_size,
               const PieceOptions& options);

/// The map with every point of a region taken into its counterpart, as a whole, and all others out
/// of it: they keep where the map took them, if that isn't in it. Nothing is bent again.
/// `positions` and `normals` are those that refine() got; `pinned` stay where they are.
void keep_apart(Refinement& map, const PieceView& source, const Normals& source_normals,
                const PieceView& target, const Normals& target_normals,
                std::span<const Feature> regions, std::span<const IndexPair> pinned,
                const PieceOptions& options, Progress& progress);

/// What was done about the pieces, for the user; empty where there is one of each.
std::vector<std::string> pieces_in_words(const PieceMatching& matching, const Topology& source,
                                         const std::string& source_name, const Topology& target,
                                         const std::string& target_name);

}  // namespace pointmorph

// Stage `topology`: what a cloud tells about the surface that it was taken from: its pieces, their
// borders, and how many handles they have.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/surface/boundary.hpp"

namespace pointmorph {

struct TopologyOptions {
    /// A piece's handles are counted among so many cells of its surface, and among fewer.
    Index cells = 1000;
    /// Points of a piece that are looked at; of larger ones every so many.
    Index points = 12000;
    /// Pieces of a smaller share of the points than this are specks.
    double speck = 0.002;
};

/// A part of the surface that hangs together.
struct Piece {
    Index points = 0;
    Index borders = 0;     ///< loops of its boundary: those of holes as well
    bool is_open = false;  ///< one of them is long enough to be the rim of a patch
    /// Handles; nothing where the points don't say for sure.
    std::optional<Index> genus;
};

struct Topology {
    std::vector<Index> labels;  ///< #points: the piece that each belongs to
    std::vector<Piece> pieces;  ///< the one with the most points first, specks last
    /// So many of the last pieces are too small to say more of them, or scattered points.
    Index specks = 0;

    std::span<const Piece> main() const {
        return std::span(pieces).first(pieces.size() - to_size(specks));
    }
};

/// A label for each point, as faces have it; two of them may be one piece where points coincide.
using Parts = std::vector<Index>;

/// `normals` are unit length and agree in sign; `nearest` is ascending by distance, 12 or more;
/// `loops` are those of find_boundary_loops(). `parts`, where there are some, are the pieces: else
/// those are found. Coincident points count once.
Topology find_topology(const Positions& positions, const Normals& normals,
                       const Neighborhoods& nearest, std::span<const BoundaryLoop> loops,
                       std::span<const Index> parts, const TopologyOptions& options,
                       Progress& progress);

/// Whether a loop is long enough, for the surface's area, to be the rim of a patch and not that of
/// a hole.
bool is_rim(double length, double area);

/// "a closed surface of genus 1", "3 pieces: an open patch and 2 closed surfaces of genus 0".
std::string in_words(const Topology& topology);

/// What can't be morphed without a tear or a fold, since the largest pieces differ in borders or
/// handles; empty where nothing is known to.
std::string difference_in_words(const Topology& source, const std::string& source_name,
                                const Topology& target, const std::string& target_name);

/// Of two clouds: "closed surfaces of genus 1 and 0" where both have one piece of the same kind,
/// else the one's words, "to", and the other's.
std::string in_words(const Topology& source, const Topology& target);

}  // namespace pointmorph

// Maps that a search came upon and didn't choose, as far as they say where the chosen one may be
// wrong.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Other maps, as far as they differ from the chosen one at some places.
struct OtherMaps {
    Values ratios;  ///< of each: its cost over the least one's
    /// Distances between the images of a place, #maps by #places, in √area.
    Eigen::MatrixXd source, target;
    /// The map that is the chosen one rolled about the length of long thin shapes: where it differs
    /// it is as likely, however little of the shape that is.
    std::optional<Index> rolled = {};
};

/// What else a search for the pose came upon.
struct Alternatives {
    std::vector<Index> source_rows, target_rows;  ///< the places
    OtherMaps finished;                           ///< those continued to the finest level
    OtherMaps trials;                             ///< the best of those tried on the coarsest

    bool searched() const { return finished.ratios.size() + trials.ratios.size() > 0; }

    /// The same for clouds in which row i is now `source_rank[i]`, or `target_rank[i]`.
    Alternatives with_rows(std::span<const Index> source_rank,
                           std::span<const Index> target_rank) const;
};

}  // namespace pointmorph

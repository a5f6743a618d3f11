// One of the two shapes of a morph on its way through the stages; not for callers of the library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/boundary.hpp"
#include "pointmorph/cloud.hpp"
#include "pointmorph/neighborhoods.hpp"
#include "pointmorph/progress.hpp"
#include "pointmorph/types.hpp"

namespace pointmorph {

/// Normalised and in spatial order, so that the order given doesn't matter.
struct Side {
    explicit Side(Cloud& as_given) : cloud(as_given) {}

    Cloud& cloud;              ///< as given; missing normals and radii are filled in
    std::vector<Index> order;  ///< row here → row as given
    std::vector<Index> rank;   ///< the inverse
    Normalization unit;        ///< takes positions as given to those here
    Positions positions;
    Normals normals;
    bool normals_given = false;
    Neighborhoods nearest;
    BoundaryLoop loop;

    void order_points();

    /// Estimates normals where none were given, oriented alike; radii from the spacing.
    void find_normals(Progress& progress);

    /// Sets `loop` to the boundary given, or to the longest that is found; returns how many there
    /// are, 0 for a closed surface.
    Index find_boundary(const BoundaryLoop& given, const BoundaryOptions& options,
                        Progress& progress);

    /// Whether `loop` is long enough, for the surface's area, to be the rim of a patch and not that
    /// of a hole.
    bool is_open() const;

    /// Turns a surface whose estimated normals pointed inwards.
    void flip();

    /// Rows as given of rows here.
    std::vector<Index> as_given(std::span<const Index> rows) const;

    /// Puts normals that were estimated into the cloud.
    void hand_over_normals();
};

}  // namespace pointmorph

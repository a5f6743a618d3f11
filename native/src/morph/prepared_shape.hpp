// One of the two shapes of a morph on its way through the stages; not for callers of the library.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/surface/boundary.hpp"
#include "pointmorph/surface/pairing.hpp"
#include "pointmorph/surface/topology.hpp"

namespace pointmorph {

/// Normalised and in spatial order, so that the order given doesn't matter. Only one of the points
/// at the same place takes part, and no speck; the others have a row here that stands for them.
struct Side {
    explicit Side(Cloud& as_given) : cloud(as_given) {}

    Cloud& cloud;              ///< as given; missing normals and radii are filled in
    std::vector<Index> order;  ///< row here → row as given, the lowest that it stands for
    std::vector<Index> rank;   ///< row as given → row here
    Normalization unit;        ///< takes positions as given to those here
    Positions positions;
    Normals normals;
    bool normals_given = false;
    Neighborhoods nearest;
    BoundaryLoop loop;
    Topology topology;

    /// Throws CloudError where fewer than `minimum_points` places are left.
    void order_points(Index minimum_points);

    /// Estimates normals where none were given, oriented alike; radii from the spacing.
    void find_normals(Progress& progress);

    /// Sets `topology`. `parts`, where there are some, say what hangs together, rows as given.
    void find_topology(std::span<const Index> parts, const BoundaryOptions& boundary,
                       const TopologyOptions& options, Progress& progress);

    /// Takes out what is too small a piece to follow: the nearest point of the others stands for
    /// it. Nothing where that would be much. Wants `topology`; returns how many points.
    Index leave_out_specks(Index neighbors, Progress& progress);

    /// Sets `loop` to the boundary given, or to the longest that is found; returns how many there
    /// are, 0 for a closed surface.
    Index find_boundary(std::span<const Index> given, const BoundaryOptions& options,
                        Progress& progress);

    /// Whether `loop` is long enough, for the surface's area, to be the rim of a patch and not that
    /// of a hole.
    bool is_open() const;

    /// Turns a surface whose estimated normals pointed inwards.
    void flip();

    /// Turns given normals, the cloud's as well, where the largest piece is closed and they face
    /// its inside; says whether it did. Wants `topology`.
    bool turn_outwards();

    /// Rows as given of rows here.
    std::vector<Index> as_given(std::span<const Index> rows) const;

    /// Puts normals that were estimated into the cloud.
    void hand_over_normals();

private:
    /// All boundary loops, longest first; looked for when first asked for.
    const std::vector<BoundaryLoop>& loops(const BoundaryOptions& options, Progress& progress);

    std::optional<std::vector<BoundaryLoop>> loops_;
};

/// Pairs of all rows as given, also of those for which another row stands. Sorted, none twice.
Pairing as_given(std::span<const IndexPair> pairs, const Side& source, const Side& target);

}  // namespace pointmorph

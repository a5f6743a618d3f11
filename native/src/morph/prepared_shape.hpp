// One of the two shapes of a morph as the routes see it: computed once, const afterward. Not for
// callers of the library.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/morph/morph_input.hpp"
#include "pointmorph/surface/boundary.hpp"
#include "pointmorph/surface/pairing.hpp"
#include "pointmorph/surface/sampled_surface.hpp"
#include "pointmorph/surface/topology.hpp"

namespace pointmorph {

/// Fewer points can't have an inside, a boundary and neighborhoods.
inline constexpr Index kMinimumPoints = 16;

struct PreparationOptions {
    Index neighbors = 16;  ///< nearest points that are looked up; 8 to 64
    BoundaryOptions boundary{};
    TopologyOptions topology{};
    bool keep_trees = false;  ///< for PreparedShape::tree(), which otherwise builds one
};

/// The cloud is valid; see validate(). `parts` say which of its points are connected, and
/// `counts` what is known of each part; empty: found. Rows that are `marked` aren't left out.
struct ShapeInput {
    const Cloud& cloud;
    std::span<const Index> parts{};
    std::span<const PartCounts> counts{};
    std::vector<Index> marked{};
};

/// Normalized and in spatial order, so that the order of the given rows doesn't matter. A *given
/// row* is one of the cloud, a *sorted row* one of this shape. Points at one place share a sorted
/// row; points that are left out have that of their nearest neighbor.
struct PreparedShape {
    std::string name;
    std::vector<Index> given_rows;   ///< of each sorted row: the lowest that it stands for
    std::vector<Index> sorted_rows;  ///< of each given row
    Normalization unit;              ///< takes given positions to those here
    Positions positions;
    /// Unit length: the given ones, or estimated and made to agree in sign.
    Normals normals;
    bool normals_given = false;
    bool normals_reversed = false;  ///< given normals pointed inward, and were reversed
    Neighborhoods nearest;          ///< ascending by distance
    Values radii;  ///< of given rows, in given lengths: those given, or the spacing
    Topology topology;
    Index left_out = 0;  ///< points in strays that were left out
    /// All boundary loops, longest first; none where find_boundary() has to look for them.
    std::optional<std::vector<BoundaryLoop>> loops;

    /// Of the positions, where it was kept; their place in memory may have changed since.
    std::shared_ptr<const KdTree<3>> kept_tree;

    Index size() const { return to_index(given_rows.size()); }
    KdTree<3> tree() const {
        return kept_tree ? KdTree<3>(*kept_tree, positions) : KdTree<3>(positions);
    }
    SampledSurface surface() const { return {positions, normals, nearest, name}; }
};

/// Components that are too small to follow are left out. Throws CloudError where fewer than
/// kMinimumPoints places are left, or for another number of `parts` than points.
PreparedShape prepare(const ShapeInput& input, const PreparationOptions& options,
                      Progress& progress);

struct PreparedShapes {
    PreparedShape source, target;
};

/// Both, stage by stage.
PreparedShapes prepare_both(const MorphInput& input, const PreparationOptions& options,
                            Progress& progress);

/// The shape with its topology looked at again. `parts` of given rows.
PreparedShape with_topology(PreparedShape shape, const KnownParts& parts,
                            const BoundaryOptions& boundary, const TopologyOptions& options,
                            Progress& progress);

/// The shape with its normals reversed, and its loops with them.
PreparedShape with_normals_reversed(PreparedShape shape);

/// A boundary in sorted rows, anticlockwise.
struct Boundary {
    BoundaryLoop loop;  ///< empty on a closed surface
    Index found = 0;    ///< how many loops there are; 1 where it was given
};

/// The boundary that was `given` (given rows), or where there is none the longest that is found.
/// Throws FeatureError for rows that make no loop.
Boundary find_boundary(const PreparedShape& shape, std::span<const Index> given,
                       const BoundaryOptions& options, Progress& progress);

/// Whether the loop is long enough, for the surface's area, to be the rim of an open patch rather
/// than that of a hole.
bool is_rim(const PreparedShape& shape, const BoundaryLoop& loop);

/// The given rows of sorted rows.
std::vector<Index> to_given(std::span<const Index> sorted, const PreparedShape& shape);

/// Pairs of given rows from pairs of sorted rows; rows that share a sorted row are all paired.
/// Sorted, none twice.
Pairing to_given(std::span<const IndexPair> sorted, const PreparedShape& source,
                 const PreparedShape& target);

/// The normals of the cloud from which the shape was prepared: `given`, or the shape's; reversed
/// where the shape's were.
Normals completed_normals(Normals given, const PreparedShape& shape);

/// The cloud from which the shape was prepared, with the normals and radii that it lacked, and with
/// given normals reversed where the shape's were.
Cloud completed(Cloud cloud, const PreparedShape& shape);

}  // namespace pointmorph

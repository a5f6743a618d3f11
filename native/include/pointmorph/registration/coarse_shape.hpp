// Stage `coarse_shape`: a cloud of any size as the few thousand points, with a node graph among
// them, that the registration works on.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/deformation.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

struct CoarseShapeOptions {
    Index points = 5000;  ///< about so many of the cloud's; 100 or more
    /// About so many of those carry the deformation, at each of the levels; 20 or more.
    std::vector<Index> nodes{250, 1000};
    SurfaceGraphOptions graph;
};

/// Places on the surface, or off it, that the guide of the same number on the other shape is to
/// meet.
struct Guides {
    Positions places;                ///< #guides by 3
    std::vector<Index> coarse_rows;  ///< the coarse points that carry them
    Values weights;  ///< how much they pull, the same on both shapes; 0 to show the pose

    Index size() const { return to_index(coarse_rows.size()); }
};

/// How far each point belongs to the regions: close in the product space are only points of like
/// labels.
using Labels = Eigen::Matrix<double, Eigen::Dynamic, 16, Eigen::RowMajor>;

/// Three kinds of rows meet here. A *cloud row* is one of the whole cloud, a *coarse row* one of
/// the arrays of a CoarseShape, a *node* a place in the list of a level's nodes. Features and
/// guides of a registration are coarse rows.
struct CoarseShape {
    /// Of each coarse row. First those of the required ones, in their order.
    std::vector<Index> cloud_rows;
    Positions positions;  ///< #points by 3
    Normals normals;
    Values areas;  ///< surface that each point stands for
    SurfaceGraph graph;
    std::vector<DeformationGraph> levels;  ///< coarsest first; required rows are the first nodes

    Guides guides;
    Labels labels;  ///< #points by 16, in √area; no rows where there are no regions
    Values pulls;   ///< by how much a point's match counts for more; as many

    /// #points: whether the surface ends there while the other's goes on, so that what matches it
    /// says nothing; empty where it doesn't.
    std::vector<char> ends;

    Index size() const { return to_index(positions.rows()); }
};

/// Two shapes that are registered, and which of their points belong together. Refers to all of it:
/// the caller keeps it alive.
struct CoarsePair {
    const CoarseShape& source;
    const CoarseShape& target;                 ///< where it lies to the source
    std::span<const IndexPair> features = {};  ///< coarse rows
};

/// `required` cloud rows (features), none twice, are among the points and the nodes. `nearest`,
/// where they are known, are the neighborhoods of the cloud's points, ascending by distance.
CoarseShape coarse_shape(const KdTree<3>& tree, const Normals& normals,
                         std::span<const Index> required, const CoarseShapeOptions& options,
                         Progress& progress, const Neighborhoods* nearest = nullptr);

/// #points by 4: log(area of the geodesic ball / r²) for the radii r of .1, .15, .2 and .3 √area,
/// from the finest level's nodes: log π in a plane, less on a limb, however the shape is posed.
using LocalAreas = Eigen::Matrix<double, Eigen::Dynamic, 4, Eigen::RowMajor>;
LocalAreas local_areas(const CoarseShape& shape, Progress& progress);

/// Distances along the node graph of the coarsest level, #nodes by #nodes, in √area.
Eigen::MatrixXd node_distances(const CoarseShape& shape);

/// node_distances() of the source and of the target.
using NodeDistances = std::array<Eigen::MatrixXd, 2>;
NodeDistances node_distances(const CoarseShape& source, const CoarseShape& target);

/// A coarse shape rotated and moved; `move.scale` is 1.
CoarseShape moved(const CoarseShape& shape, const Similarity& move);

}  // namespace pointmorph

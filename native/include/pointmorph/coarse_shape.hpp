// Stage `coarse_shape`: a cloud of any size as the few thousand points, with a node graph among
// them, that the registration works on.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "pointmorph/deformation.hpp"
#include "pointmorph/kd_tree.hpp"
#include "pointmorph/progress.hpp"
#include "pointmorph/surface_graph.hpp"
#include "pointmorph/types.hpp"

namespace pointmorph {

struct CoarseShapeOptions {
    Index points = 5000;  ///< about so many of the cloud's; 100 or more
    /// About so many of those carry the deformation, at each of the levels; 20 or more.
    std::vector<Index> nodes{250, 1000};
    SurfaceGraphOptions graph;
};

struct CoarseShape {
    std::vector<Index> rows;  ///< of the cloud; first the required ones, in their order
    Positions positions;
    Normals normals;
    Values areas;  ///< surface that each point stands for
    SurfaceGraph graph;
    std::vector<DeformationGraph> levels;  ///< required rows are each one's first nodes

    Index size() const { return static_cast<Index>(rows.size()); }
};

/// `required` rows (features), none twice, are among the points and the nodes.
CoarseShape coarse_shape(const KdTree<3>& tree, const Normals& normals,
                         std::span<const Index> required, const CoarseShapeOptions& options,
                         Progress& progress);

/// #points by 4: log(area of the geodesic ball / r²) for the radii r of .1, .15, .2 and .3 √area,
/// from the finest level's nodes: log π in a plane, less on a limb, however the shape is posed.
using LocalAreas = Eigen::Matrix<double, Eigen::Dynamic, 4, Eigen::RowMajor>;
LocalAreas local_areas(const CoarseShape& shape, Progress& progress);

}  // namespace pointmorph

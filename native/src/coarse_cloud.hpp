// The few thousand points of a cloud among which curves are searched for; not for callers of the
// library.
#pragma once

#include <vector>

#include "pointmorph/kd_tree.hpp"
#include "pointmorph/neighborhoods.hpp"
#include "pointmorph/progress.hpp"
#include "pointmorph/surface_graph.hpp"
#include "pointmorph/types.hpp"

namespace pointmorph {

struct CoarseCloud {
    std::vector<Index> rows;  ///< of the cloud, the features first
    Positions positions;
    Normals normals;
    KdTree<3> tree;
    std::vector<Index> cells;  ///< #cloud: the nearest coarse point on the same sheet
    SurfaceGraph graph;
    double spacing;  ///< of these points
    double unit;     ///< √area

    /// `chosen` and `radius` are those of blue_noise_subset(), `area` that of the surface.
    CoarseCloud(std::vector<Index> chosen, double radius, double area, const KdTree<3>& dense,
                const Normals& dense_normals, const Neighborhoods& nearest, Progress& progress);
};

}  // namespace pointmorph

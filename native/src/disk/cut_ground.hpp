// What a loop is proposed from, and the curves of a cut are searched among. Internal.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/disk/decomposition.hpp"
#include "pointmorph/surface/graph_extremities.hpp"
#include "pointmorph/surface/sampled_surface.hpp"
#include "surface/coarse_cloud.hpp"

namespace pointmorph {

/// A closed shape with some features, looked at once for all that is asked about it. Refers to the
/// surface's arrays and to `tree`, which holds its positions.
struct CutGround {
    SampledSurface surface;
    const KdTree<3>& tree;
    CoarseCloud coarse;                  ///< the features first
    Eigen::MatrixXd from;                ///< distances_from_features()
    std::vector<Extremity> extremities;  ///< nodes of `coarse`, the most prominent first

    /// `features`: rows, none twice.
    CutGround(const SampledSurface& shape, const KdTree<3>& shape_tree,
              std::span<const Index> features, const DecompositionOptions& options,
              Progress& progress);
    /// The same with the same features in another order.
    CutGround(const CutGround& other, std::span<const Index> features);

    std::span<const Index> features() const {
        return std::span(coarse.rows).first(to_size(from.cols()));
    }
    /// Whether these are its features, in any order.
    bool has(std::span<const Index> rows) const;
};

FeatureReach feature_reach(const CutGround& ground);

/// `request.features` are those of the ground, in any order.
Decomposition decompose(const CutGround& ground, const CutRequest& request,
                        const DecompositionOptions& options, Progress& progress);

}  // namespace pointmorph

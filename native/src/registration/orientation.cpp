#include "registration/orientation.hpp"

#include <algorithm>
#include <cmath>

#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/oriented_points.hpp"

namespace pointmorph {

double signed_volume(const CoarseShape& shape) {
    const Eigen::RowVector3d center = shape.positions.colwise().mean();
    return ((shape.positions.rowwise() - center).cwiseProduct(shape.normals).rowwise().sum())
               .dot(shape.areas) /
           3.0;
}

double normal_agreement(const CoarseShape& source, const CoarseShape& target,
                        const Positions& start) {
    const std::vector<Index> nearest = nearest_rows(KdTree<3>(target.positions), start);
    double sum = 0.0;
    for (Index i = 0; i < source.size(); ++i)
        sum += source.normals.row(i).dot(target.normals.row(nearest[to_size(i)]));
    return sum / source.size();
}

bool is_inside_out(const CoarseShape& source, const CoarseShape& target, const Positions& start) {
    const double s = signed_volume(source), t = signed_volume(target);
    if (std::min(std::abs(s), std::abs(t)) > kSomeVolume) return s * t < 0.0;
    return normal_agreement(source, target, start) < 0.0;
}

}  // namespace pointmorph

#include "pointmorph/lift.hpp"

#include <array>
#include <cmath>

#include "pointmorph/kd_tree.hpp"
#include "pointmorph/parallel.hpp"

namespace pointmorph {

LiftedCloud lifted(const CoarseShape& shape, const DeformedCloud& coarse,
                   const Positions& positions, const Normals& normals, Progress& progress) {
    constexpr Index kNeighbors = 6;  // the last has weight 0
    // Opposed normals count for four coarse spacings: thin sheets don't mix.
    const double normal_weight = 2.0 * std::sqrt(shape.areas.mean());
    KdTree<6>::Points keys(shape.size(), 6);
    keys << shape.positions, normal_weight * shape.normals;
    const KdTree<6> tree(keys);

    const auto count = static_cast<Index>(positions.rows());
    LiftedCloud result{Positions(count, 3), Normals(count, 3)};
    parallel_for(count, progress, [&](Index begin, Index end) {
        std::array<Index, kNeighbors> near;
        std::array<double, kNeighbors> squared;
        for (Index i = begin; i < end; ++i) {
            Eigen::Matrix<double, 6, 1> key;
            key << positions.row(i).transpose(), normal_weight * normals.row(i).transpose();
            const auto found = static_cast<std::size_t>(tree.nearest(key.data(), near, squared));
            const double reach = std::sqrt(squared[found - 1]);
            Vector3 x = Vector3::Zero(), normal = Vector3::Zero();
            double sum = 0.0;
            for (std::size_t k = 0; k < found; ++k) {
                const double fade =
                    found > 1 && reach > 0.0 ? 1.0 - std::sqrt(squared[k]) / reach : 1.0;
                const double weight = fade * fade / (squared[k] + 1e-4 * reach * reach + 1e-300);
                const auto c = static_cast<std::size_t>(near[k]);
                x += weight * (coarse.positions.row(near[k]).transpose() +
                               coarse.linear[c] *
                                   (positions.row(i) - shape.positions.row(near[k])).transpose());
                normal += weight * coarse.linear[c] * normals.row(i).transpose();
                sum += weight;
            }
            if (!(sum > 0.0)) {  // all found are equally far
                const auto c = static_cast<std::size_t>(near[0]);
                x = coarse.positions.row(near[0]).transpose() +
                    coarse.linear[c] *
                        (positions.row(i) - shape.positions.row(near[0])).transpose();
                normal = coarse.linear[c] * normals.row(i).transpose();
                sum = 1.0;
            }
            result.positions.row(i) = x / sum;
            const double length = normal.norm();
            if (length > 1e-12 * sum)
                result.normals.row(i) = normal / length;
            else
                result.normals.row(i) = normals.row(i);
        }
    });
    return result;
}

}  // namespace pointmorph

#include "pointmorph/registration/prolongation.hpp"

#include <algorithm>
#include <cmath>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

Prolongation::Prolongation(const CoarseShape& shape, const Positions& positions,
                           const Normals& normals, Progress& progress)
    : followed_(to_size(positions.rows())), weights_(followed_.size()) {
    // Opposed normals count for four coarse spacings: thin sheets don't mix.
    const double normal_weight = 2.0 * std::sqrt(shape.areas.mean());
    KdTree<6>::Points keys(shape.size(), 6);
    keys << shape.positions, normal_weight * shape.normals;
    const KdTree<6> tree(keys);

    parallel_for(to_index(positions.rows()), progress, [&](Index begin, Index end) {
        std::array<Index, kFollowed + 1> near;  // the last has weight 0
        std::array<double, kFollowed + 1> squared;
        for (Index i = begin; i < end; ++i) {
            Eigen::Matrix<double, 6, 1> key;
            key << positions.row(i).transpose(), normal_weight * normals.row(i).transpose();
            const auto found = to_size(tree.nearest(key.data(), near, squared));
            const double reach = std::sqrt(squared[found - 1]);
            std::array<double, kFollowed> weights{};
            double sum = 0.0;
            for (std::size_t k = 0; k < std::min(found, kFollowed); ++k) {
                const double fade =
                    found > 1 && reach > 0.0 ? 1.0 - std::sqrt(squared[k]) / reach : 1.0;
                weights[k] = fade * fade / (squared[k] + 1e-4 * reach * reach + 1e-300);
                sum += weights[k];
            }
            if (!(sum > 0.0)) sum = weights[0] = 1.0;  // all found are equally far
            auto& followed = followed_[to_size(i)];
            auto& shares = weights_[to_size(i)];
            for (std::size_t k = 0; k < kFollowed; ++k) {
                followed[k] = near[k < found ? k : 0];
                shares[k] = static_cast<float>(weights[k] / sum);
            }
        }
    });
}

CoarseMoves::CoarseMoves(const CoarseShape& shape, const DeformedCloud& coarse)
    : moves_(to_size(shape.size())) {
    for (Index c = 0; c < shape.size(); ++c) {
        moves_[to_size(c)] = {coarse.linear[to_size(c)], shape.positions.row(c).transpose(),
                              coarse.positions.row(c).transpose()};
    }
}

void Prolongation::move(Index point, const CoarseMoves& moves, Vector3& position,
                        Vector3& normal) const {
    const auto& followed = followed_[to_size(point)];
    const auto& weights = weights_[to_size(point)];
    Vector3 x = Vector3::Zero(), turned = Vector3::Zero();
    double sum = 0.0;
    for (std::size_t k = 0; k < kFollowed; ++k) {
        const double weight = weights[k];
        const auto& [linear, rest, now] = moves.moves_[to_size(followed[k])];
        x += weight * (now + linear * (position - rest));
        turned += weight * linear * normal;
        sum += weight;
    }
    position = x / sum;
    const double length = turned.norm();
    if (length > 1e-12) normal = turned / length;
}

OrientedPoints Prolongation::operator()(const CoarseShape& shape, const DeformedCloud& coarse,
                                        const Positions& positions, const Normals& normals,
                                        Progress& progress) const {
    const CoarseMoves moves(shape, coarse);
    const auto count = to_index(positions.rows());
    OrientedPoints result{Positions(count, 3), Normals(count, 3)};
    parallel_for(count, progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            Vector3 x = positions.row(i).transpose(), normal = normals.row(i).transpose();
            move(i, moves, x, normal);
            result.positions.row(i) = x;
            result.normals.row(i) = normal;
        }
    });
    return result;
}

Matrix3 Prolongation::linear(Index point, const DeformedCloud& coarse) const {
    const auto i = to_size(point);
    Matrix3 result = Matrix3::Zero();
    double sum = 0.0;
    for (std::size_t k = 0; k < kFollowed; ++k) {
        const double weight = weights_[i][k];
        result += weight * coarse.linear[to_size(followed_[i][k])];
        sum += weight;
    }
    return result / sum;
}

}  // namespace pointmorph

#include "pointmorph/registration/prolongation.hpp"

#include <algorithm>
#include <cmath>

#include "base/compiler.hpp"
#include "cloud/normalized_rows.hpp"
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
        const Matrix3& linear = coarse.linear[to_size(c)];
        moves_[to_size(c)] << linear,
            coarse.positions.row(c).transpose() - linear * shape.positions.row(c).transpose();
    }
}

void CoarseMoves::then(const Similarity& after) {
    for (Move& move : moves_) {
        move = (after.scale * after.rotation * move).eval();
        move.col(3) += after.translation;
    }
    after_.scale *= after.scale;
    after_.rotation = after.rotation * after_.rotation;
}

/// The moves that a point follows, averaged.
struct Prolongation::Blend {
    std::array<Two, 6> numbers{};  ///< two to each half of a row
    double factor;

    Blend(const Prolongation& prolongation, Index point, const CoarseMoves& moves) {
        const auto& followed = prolongation.followed_[to_size(point)];
        const auto& weights = prolongation.weights_[to_size(point)];
        double sum = 0.0;
        for (std::size_t k = 0; k < kFollowed; ++k) {
            const double weight = weights[k];
            const Two twice = {weight, weight};
            const double* const move = moves.moves_[to_size(followed[k])].data();
            for (std::size_t j = 0; j < numbers.size(); ++j)
                numbers[j] += twice * Two{move[2 * j], move[2 * j + 1]};
            sum += weight;
        }
        factor = 1.0 / sum;
    }

    /// Where (x, y, z, w) goes.
    Eigen::RowVector3d times(const Eigen::RowVector3d& xyz, double w) const {
        const Two xy = {xyz[0], xyz[1]}, zw = {xyz[2], w};
        Eigen::RowVector3d product;
        for (std::size_t row = 0; row < 3; ++row) {
            Two parts = numbers[2 * row] * xy;
            parts += numbers[2 * row + 1] * zw;
            product[static_cast<int>(row)] = parts[0] + parts[1];
        }
        return product;
    }
};

void Prolongation::move(Index begin, Index end, const CoarseMoves& moves,
                        OrientedPoints& points) const {
    constexpr double kCancelled = 1e-12;
    Eigen::Matrix<double, kNormalizedAtOnce, 3, Eigen::RowMajor> turned;
    for (Index first = begin; first < end; first += kNormalizedAtOnce) {
        const Index count = std::min(kNormalizedAtOnce, end - first);
        auto positions = points.positions.middleRows(first, count);
        auto normals = points.normals.middleRows(first, count);
        for (Index i = 0; i < count; ++i) {
            const Blend blend(*this, first + i, moves);
            positions.row(i) = blend.factor * blend.times(positions.row(i), 1.0);
            turned.row(i) = blend.times(normals.row(i), 0.0);
        }
        normalize_rows(turned.topRows(count), kCancelled * moves.after_.scale,
                       [&](Index i) -> Eigen::RowVector3d {
                           return normals.row(i) * moves.after_.rotation.transpose();
                       });
        normals = turned.topRows(count);
    }
}

OrientedPoints Prolongation::operator()(const CoarseShape& shape, const DeformedCloud& coarse,
                                        const Positions& positions, const Normals& normals,
                                        Progress& progress) const {
    const CoarseMoves moves(shape, coarse);
    OrientedPoints result{positions, normals};
    parallel_for(to_index(positions.rows()), progress,
                 [&](Index begin, Index end) { move(begin, end, moves, result); });
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

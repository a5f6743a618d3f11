#include "pointmorph/registration/prolongation.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/compiler.hpp"
#include "cloud/nearby_search.hpp"
#include "cloud/normalized_rows.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

/// A turned normal that is no longer than that has no direction any more.
constexpr double kCancelled = 1e-12;

void take_roots(double* numbers, std::size_t count) {
    auto all = Eigen::ArrayXd::Map(numbers, static_cast<Eigen::Index>(count));
    all = all.sqrt();
}

}  // namespace

Prolongation::Prolongation(const CoarseShape& shape, const Positions& positions,
                           const Normals& normals, Progress& progress)
    : followed_(std::make_unique_for_overwrite<std::array<std::uint32_t, kFollowed>[]>(
          to_size(positions.rows()))),
      weights_(std::make_unique_for_overwrite<std::array<float, kFollowed>[]>(
          to_size(positions.rows()))) {
    // Opposed normals count for four coarse spacings: thin sheets don't mix.
    const double normal_weight = 2.0 * std::sqrt(shape.areas.mean());
    KdTree<6>::Points keys(shape.size(), 6);
    keys << shape.positions, normal_weight * shape.normals;
    const KdTree<6> tree(keys);
    const NearbySearch<6> search(tree, progress);

    parallel_for(to_index(positions.rows()), progress, [&](Index begin, Index end) {
        std::array<Index, kFollowed + 1> near;  // the last has weight 0
        std::array<double, kFollowed + 1> squared;
        Index beside = 0;  // of the point before
        for (Index i = begin; i < end; ++i) {
            Eigen::Matrix<double, 6, 1> key;
            key << positions.row(i).transpose(), normal_weight * normals.row(i).transpose();
            const auto found = to_size(search.nearest(key.data(), beside, near, squared));
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
                followed[k] = static_cast<std::uint32_t>(sizeof(CoarseMoves::Move)) *
                              static_cast<std::uint32_t>(near[k < found ? k : 0]);
                shares[k] = static_cast<float>(weights[k] / sum);
            }
        }
    });
}

CoarseMoves::CoarseMoves(const CoarseShape& shape, const DeformedCloud& coarse)
    : moves_(to_size(shape.size())) {
    for (Index c = 0; c < shape.size(); ++c) {
        const Matrix3& linear = coarse.linear[to_size(c)];
        moves_[to_size(c)].map() << linear,
            coarse.positions.row(c).transpose() - linear * shape.positions.row(c).transpose();
    }
}

void CoarseMoves::then(const Similarity& after) {
    const Matrix3 linear = after.scale * after.rotation;
    for (Move& move : moves_) {
        move.map() = (linear * move.map()).eval();
        move.map().col(3) += after.translation;
    }
    after_.scale *= after.scale;
    after_.rotation = after.rotation * after_.rotation;
}

/// Moves some points. `Rows` say where they are and what becomes of them.
template <class Rows>
struct Prolongation::Blending {
    const Prolongation& prolongation;
    const CoarseMoves& moves;
    const Rows& rows;

    /// So many points, at most kNormalizedAtOnce, the first of which is `begin`.
    void run(Index begin, Index count, bool wide) const {
        if (wide && has_wide_registers())
            run_wide(begin, count);
        else
            run_narrow(begin, count);
    }

private:
    using Three = std::array<double, 3>;

    POINTMORPH_WIDE void run_wide(Index begin, Index count) const {
        run_with<Four>(begin, count);
        rows.settle(to_size(begin), to_size(count), take_roots_wide);
    }

    void run_narrow(Index begin, Index count) const {
        run_with<TwoTwos>(begin, count);
        rows.settle(to_size(begin), to_size(count), take_roots);
    }

    template <class Numbers>
    POINTMORPH_INLINE void run_with(Index begin, Index count) const {
        for (std::size_t i = 0; i < to_size(count); ++i) move<Numbers>(to_size(begin), i);
    }

    /// `Numbers` are four doubles.
    template <class Numbers>
    POINTMORPH_INLINE void move(std::size_t begin, std::size_t i) const {
        const auto& followed = prolongation.followed_[begin + i];
        const auto& weights = prolongation.weights_[begin + i];
        std::array<Numbers, 4> columns;
        double sum = 0.0;
        const auto* const all = reinterpret_cast<const std::byte*>(moves.moves_.data());
        for (std::size_t k = 0; k < kFollowed; ++k) {
            const double weight = weights[k];
            const std::byte* const from = all + followed[k];
            for (std::size_t j = 0; j < columns.size(); ++j) {
                Numbers column;
                std::memcpy(&column, from + j * sizeof(std::array<double, 4>), sizeof column);
                if (k == 0)
                    columns[j] = weight * column;
                else
                    columns[j] += weight * column;
            }
            sum += weight;
        }
        // Added up in the order that products of twos have.
        const Three place = rows.position(begin + i);
        Numbers even = place[0] * columns[0], odd = place[1] * columns[1];
        even += place[2] * columns[2];
        odd += columns[3];
        even += odd;
        even = 1.0 / sum * even;
        double* const placed = rows.placed(begin + i);
        for (int d = 0; d < 3; ++d) placed[d] = even[d];

        const Three normal = rows.normal(begin + i);
        even = normal[0] * columns[0];
        even += normal[2] * columns[2];
        even += normal[1] * columns[1];
        rows.turn(i, even);
    }
};

/// Points that are moved in place.
struct Prolongation::OwnRows {
    OrientedPoints& points;
    double* turned;  ///< normals that have yet to be normalized

    POINTMORPH_INLINE std::array<double, 3> position(std::size_t row) const {
        const double* const at = points.positions.data() + 3 * row;
        return {at[0], at[1], at[2]};
    }
    POINTMORPH_INLINE std::array<double, 3> normal(std::size_t row) const {
        const double* const at = points.normals.data() + 3 * row;
        return {at[0], at[1], at[2]};
    }
    POINTMORPH_INLINE double* placed(std::size_t row) const {
        return points.positions.data() + 3 * row;
    }
    POINTMORPH_INLINE void turn(std::size_t i, const auto& normal) const {
        for (int d = 0; d < 3; ++d) turned[3 * i + to_size(d)] = normal[d];
    }
    void settle(std::size_t, std::size_t, const auto&) const {}
};

/// Points that stay at rest, and are written elsewhere.
struct Prolongation::RestRows {
    static constexpr auto kMost = to_size(kNormalizedAtOnce);
    using Column = std::array<double, kMost>;
    struct Columns {
        Column x{}, y{}, z{};
    };

    const Rest& rest;
    OrientedPoint* points;
    const Similarity& after;
    Columns& turned;  ///< normals that have yet to be normalized

    POINTMORPH_INLINE std::array<double, 3> position(std::size_t row) const {
        const double *const at = rest.positions.data() + 3 * row, *const offset =
                                                                      rest.offsets.data() + 3 * row;
        return {at[0] + rest.share * offset[0], at[1] + rest.share * offset[1],
                at[2] + rest.share * offset[2]};
    }
    POINTMORPH_INLINE std::array<double, 3> normal(std::size_t row) const {
        const float* const at = rest.normals.data() + 3 * row;
        return {at[0], at[1], at[2]};
    }
    POINTMORPH_INLINE double* placed(std::size_t row) const { return points[row].position.data(); }
    POINTMORPH_INLINE void turn(std::size_t i, const auto& normal) const {
        turned.x[i] = normal[0];
        turned.y[i] = normal[1];
        turned.z[i] = normal[2];
    }

    /// Normalizes what was turned, in loops that the compiler vectorizes.
    POINTMORPH_INLINE void settle(std::size_t begin, std::size_t count, auto&& roots) const {
        const double least = kCancelled * after.scale;
        const auto& [x, y, z] = turned;
        Column lengths;
        for (std::size_t i = 0; i < kMost; ++i)
            lengths[i] = x[i] * x[i] + y[i] * y[i] + z[i] * z[i];
        roots(lengths.data(), kMost);
        std::array<float, kMost> unit_x, unit_y, unit_z;
        for (std::size_t i = 0; i < kMost; ++i) {
            const double factor = 1.0 / lengths[i];
            unit_x[i] = static_cast<float>(x[i] * factor);
            unit_y[i] = static_cast<float>(y[i] * factor);
            unit_z[i] = static_cast<float>(z[i] * factor);
        }
        for (std::size_t i = 0; i < count; ++i) {
            points[begin + i].normal = {unit_x[i], unit_y[i], unit_z[i], 0.0F};
            if (!(lengths[i] > least)) keep(begin + i);
        }
    }

private:
    /// Where turns cancel.
    void keep(std::size_t row) const {
        const Eigen::RowVector3d normal =
            rest.normals.row(to_index(row)).cast<double>() * after.rotation.transpose();
        for (int d = 0; d < 3; ++d) points[row].normal[to_size(d)] = static_cast<float>(normal[d]);
    }
};

void Prolongation::move(Index begin, Index end, const CoarseMoves& moves, OrientedPoints& points,
                        bool wide) const {
    Eigen::Matrix<double, kNormalizedAtOnce, 3, Eigen::RowMajor> turned;
    const OwnRows rows{points, turned.data()};
    for (Index first = begin; first < end; first += kNormalizedAtOnce) {
        const Index count = std::min(kNormalizedAtOnce, end - first);
        Blending<OwnRows>{*this, moves, rows}.run(first, count, wide);
        auto normals = points.normals.middleRows(first, count);
        normalize_rows(turned.topRows(count), kCancelled * moves.after_.scale,
                       [&](Index i) -> Eigen::RowVector3d {
                           return normals.row(i) * moves.after_.rotation.transpose();
                       });
        normals = turned.topRows(count);
    }
}

void Prolongation::move(Index begin, Index end, const CoarseMoves& moves, const Rest& rest,
                        std::span<OrientedPoint> points, bool wide) const {
    RestRows::Columns turned;
    const RestRows rows{rest, points.data(), moves.after_, turned};
    for (Index first = begin; first < end; first += kNormalizedAtOnce)
        Blending<RestRows>{*this, moves, rows}.run(first, std::min(kNormalizedAtOnce, end - first),
                                                   wide);
}

OrientedPoints Prolongation::operator()(const CoarseShape& shape, const DeformedCloud& coarse,
                                        const Positions& positions, const Normals& normals,
                                        Progress& progress) const {
    const CoarseMoves moves(shape, coarse);
    OrientedPoints result{Positions(positions.rows(), 3), Normals(positions.rows(), 3)};
    parallel_for(to_index(positions.rows()), progress, [&](Index begin, Index end) {
        const Index count = end - begin;
        result.positions.middleRows(begin, count) = positions.middleRows(begin, count);
        result.normals.middleRows(begin, count) = normals.middleRows(begin, count);
        move(begin, end, moves, result);
    });
    return result;
}

Matrix3 Prolongation::linear(Index point, const DeformedCloud& coarse) const {
    const auto i = to_size(point);
    Matrix3 result = Matrix3::Zero();
    double sum = 0.0;
    for (std::size_t k = 0; k < kFollowed; ++k) {
        const double weight = weights_[i][k];
        result += weight * coarse.linear[followed_[i][k] / sizeof(CoarseMoves::Move)];
        sum += weight;
    }
    return result / sum;
}

}  // namespace pointmorph

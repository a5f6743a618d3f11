#include "pointmorph/mesh/vertex_images.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/similarity.hpp"

namespace pointmorph {

namespace {

KdTree<6>::Points with_normals(const PointsOfParts& points, double weight) {
    KdTree<6>::Points rows(points.positions.rows(), 6);
    rows << points.positions, weight * points.normals;
    return rows;
}

/// How much of the fit is left to the similarity: a share of the samples' spread.
constexpr double kOpen = 0.02;

constexpr double kNormals = 2.0;  // spacings that opposite directions count, halved

/// The samples that tell about vertices.
class NearSamples {
public:
    NearSamples(const PointsOfParts& samples, double spacing)
        : samples_(samples.positions),
          parts_(samples.parts),
          weight_(kNormals * spacing),
          tree_(tree_of(with_normals(samples, weight_))) {}

    /// Their rows, the nearest first, and weights, whose sum is 1; returns the vertex less the
    /// weighted mean of the samples.
    Eigen::RowVector3d find(const PointsOfParts& vertices, Index vertex, std::span<Index> rows,
                            std::span<double> weights) const {
        Eigen::Matrix<double, 1, 6> query;
        query << vertices.positions.row(vertex), weight_ * vertices.normals.row(vertex);
        tree_.nearest(query.data(), rows, weights);
        if (!parts_.empty() && !vertices.parts.empty())
            keep_to_part(vertices.parts[to_size(vertex)], query.data(), rows, weights);
        const double farthest = weights.back() * (1.0 + 1e-9);
        Eigen::RowVector3d mean = Eigen::RowVector3d::Zero();
        double sum = 0.0;
        for (std::size_t k = 0; k < rows.size(); ++k) {
            const double fade = farthest > 0.0 ? 1.0 - weights[k] / farthest : 1.0;
            weights[k] = fade * fade;
            sum += fade * fade;
            mean += fade * fade * samples_.row(rows[k]);
        }
        for (double& weight : weights) weight /= sum;
        return vertices.positions.row(vertex) - mean / sum;
    }

private:
    static KdTree<6> tree_of(const KdTree<6>::Points& places) { return KdTree<6>(places); }

    /// Puts the nearest samples of the part in place of those of other parts, as far as there are
    /// any among the nearest `kLooked`; the farthest again where there are too few.
    void keep_to_part(Index part, const double* query, std::span<Index> rows,
                      std::span<double> squared) const {
        constexpr std::size_t kLooked = 64;
        const auto is_own = [&](Index row) { return parts_[to_size(row)] == part; };
        if (part < 0 || std::ranges::all_of(rows, is_own)) return;
        std::array<Index, kLooked> all_near{};
        std::array<double, kLooked> all_squared{};
        const auto found = to_size(tree_.nearest(query, all_near, all_squared));
        constexpr std::size_t kEnough = 4;  // fewer don't say how the part turns
        std::size_t own = 0;
        for (std::size_t k = 0; k < found && own < rows.size(); ++k) {
            if (!is_own(all_near[k])) continue;
            all_near[own] = all_near[k];
            all_squared[own++] = all_squared[k];
        }
        if (own < std::min(kEnough, rows.size())) return;
        std::copy_n(all_near.begin(), own, rows.begin());
        std::copy_n(all_squared.begin(), own, squared.begin());
        std::fill(rows.begin() + static_cast<std::ptrdiff_t>(own), rows.end(), rows[own - 1]);
        std::fill(squared.begin() + static_cast<std::ptrdiff_t>(own), squared.end(),
                  squared[own - 1]);
    }

    const Positions& samples_;
    std::span<const Index> parts_;
    double weight_;
    KdTree<6> tree_;
};

/// Where the samples around a vertex, which is `offset` from their weighted mean, take it.
Vector3 image_of(const Eigen::RowVector3d& offset, std::span<const Index> rows,
                 std::span<const double> weights, const Positions& samples,
                 const Positions& images) {
    Vector3 from = Vector3::Zero(), to = Vector3::Zero();
    for (std::size_t k = 0; k < rows.size(); ++k) {
        from += weights[k] * samples.row(rows[k]).transpose();
        to += weights[k] * images.row(rows[k]).transpose();
    }
    Matrix3 spread = Matrix3::Zero(), cross = Matrix3::Zero();
    for (std::size_t k = 0; k < rows.size(); ++k) {
        const Vector3 d = samples.row(rows[k]).transpose() - from;
        const Vector3 y = images.row(rows[k]).transpose() - to;
        spread += weights[k] * d * d.transpose();
        cross += weights[k] * y * d.transpose();
    }
    const double extent = spread.trace();
    if (!(extent > 0.0)) return to;
    const BestRotation turn = best_rotation(cross);
    const Matrix3 similar = turn.trace / extent * turn.rotation;
    const Matrix3 open = kOpen * extent * Matrix3::Identity();
    const Matrix3 linear = (cross + kOpen * extent * similar) * (spread + open).inverse();
    return to + linear * offset.transpose();
}

}  // namespace

VertexImages::VertexImages(const PointsOfParts& vertices, const PointsOfParts& samples,
                           double spacing, Progress& progress)
    : samples_(samples.positions), offsets_(vertices.positions.rows(), 3) {
    const auto count = to_index(vertices.positions.rows());
    neighbors_ = std::min(kNeighbors, to_index(samples.positions.rows()));
    rows_.resize(to_size(count * neighbors_));
    weights_.resize(count * neighbors_);
    at_one_.assign(to_size(count), 0);
    const NearSamples near(samples, spacing);
    parallel_for(count, progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v) {
            const auto first = v * neighbors_;
            offsets_.row(v) = near.find(vertices, v, {rows_.data() + first, to_size(neighbors_)},
                                        {weights_.data() + first, to_size(neighbors_)});
            at_one_[to_size(v)] = vertices.positions.row(v) == samples_.row(rows_[to_size(first)]);
        }
    });
}

Positions VertexImages::positions(const Positions& images, Progress& progress) const {
    Positions result(size(), 3);
    parallel_for(size(), progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v) {
            const auto around = rows(v);
            if (at_one_[to_size(v)])
                result.row(v) = images.row(around.front());
            else
                result.row(v) =
                    image_of(offsets_.row(v), around,
                             {weights_.data() + v * neighbors_, around.size()}, samples_, images)
                        .transpose();
        }
    });
    return result;
}

Positions carried_positions(const PointsOfParts& vertices, const PointsOfParts& samples,
                            const Positions& images, double spacing, Progress& progress) {
    const auto count = to_index(vertices.positions.rows());
    const auto around =
        to_size(std::min<Eigen::Index>(VertexImages::kNeighbors, samples.positions.rows()));
    const NearSamples near(samples, spacing);
    Positions result(count, 3);
    parallel_for(count, progress, [&](Index begin, Index end) {
        std::array<Index, VertexImages::kNeighbors> all_rows{};
        std::array<double, VertexImages::kNeighbors> all_weights{};
        const std::span rows(all_rows.data(), around);
        const std::span weights(all_weights.data(), around);
        for (Index v = begin; v < end; ++v) {
            const Eigen::RowVector3d offset = near.find(vertices, v, rows, weights);
            if (vertices.positions.row(v) == samples.positions.row(rows.front()))
                result.row(v) = images.row(rows.front());
            else
                result.row(v) =
                    image_of(offset, rows, weights, samples.positions, images).transpose();
        }
    });
    return result;
}

SampleValues VertexImages::values(const SampleValues& of_samples, Progress& progress) const {
    SampleValues result(size(), of_samples.cols());
    parallel_for(size(), progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v) {
            const auto around = rows(v);
            if (at_one_[to_size(v)]) {
                result.row(v) = of_samples.row(around.front());
                continue;
            }
            const auto weight = [&](Index k) { return weights_[v * neighbors_ + k]; };
            Vector3 from = Vector3::Zero();
            for (Index k = 0; k < neighbors_; ++k)
                from += weight(k) * samples_.row(around[to_size(k)]).transpose();
            Matrix3 spread = Matrix3::Zero();
            for (Index k = 0; k < neighbors_; ++k) {
                const Vector3 d = samples_.row(around[to_size(k)]).transpose() - from;
                spread += weight(k) * d * d.transpose();
            }
            Vector3 slope = Vector3::Zero();
            const double extent = spread.trace();
            if (extent > 0.0)
                slope = (spread + kOpen * extent * Matrix3::Identity()).inverse() *
                        offsets_.row(v).transpose();
            result.row(v).setZero();
            for (Index k = 0; k < neighbors_; ++k) {
                const Vector3 d = samples_.row(around[to_size(k)]).transpose() - from;
                result.row(v) +=
                    weight(k) * (1.0 + slope.dot(d)) * of_samples.row(around[to_size(k)]);
            }
        }
    });
    return result;
}

std::vector<Index> VertexImages::nearest() const {
    std::vector<Index> result;
    for (Index v = 0; v < size(); ++v) result.push_back(rows(v).front());
    return result;
}

}  // namespace pointmorph

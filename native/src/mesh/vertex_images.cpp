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

KdTree<6>::Points with_normals(const OrientedPoints& points, double weight) {
    KdTree<6>::Points rows(points.positions.rows(), 6);
    rows << points.positions, weight * points.normals;
    return rows;
}

/// How much of the fit is left to the similarity: a share of the samples' spread.
constexpr double kOpen = 0.02;

}  // namespace

VertexImages::VertexImages(const OrientedPoints& vertices, const OrientedPoints& samples,
                           double spacing, Progress& progress)
    : samples_(samples.positions), offsets_(vertices.positions.rows(), 3) {
    constexpr double kNormals = 2.0;  // spacings that opposite directions count, halved
    const auto count = static_cast<Index>(vertices.positions.rows());
    neighbors_ = std::min(kNeighbors, static_cast<Index>(samples.positions.rows()));
    rows_.resize(to_size(count * neighbors_));
    weights_.resize(count * neighbors_);
    at_one_.assign(to_size(count), 0);
    const KdTree<6>::Points places = with_normals(samples, kNormals * spacing);
    const KdTree<6>::Points queries = with_normals(vertices, kNormals * spacing);
    const KdTree<6> tree(places);
    parallel_for(count, progress, [&](Index begin, Index end) {
        std::array<double, kNeighbors> squared{};
        for (Index v = begin; v < end; ++v) {
            const auto first = v * neighbors_;
            tree.nearest(queries.row(v).data(), {rows_.data() + first, to_size(neighbors_)},
                         {squared.data(), to_size(neighbors_)});
            const double farthest = squared[to_size(neighbors_ - 1)] * (1.0 + 1e-9);
            Eigen::RowVector3d mean = Eigen::RowVector3d::Zero();
            double sum = 0.0;
            for (Index k = 0; k < neighbors_; ++k) {
                const double fade = farthest > 0.0 ? 1.0 - squared[to_size(k)] / farthest : 1.0;
                weights_[first + k] = fade * fade;
                sum += fade * fade;
                mean += fade * fade * samples_.row(rows_[to_size(first + k)]);
            }
            weights_.segment(first, neighbors_) /= sum;
            offsets_.row(v) = vertices.positions.row(v) - mean / sum;
            at_one_[to_size(v)] = vertices.positions.row(v) == samples_.row(rows_[to_size(first)]);
        }
    });
}

Positions VertexImages::positions(const Positions& images, Progress& progress) const {
    Positions result(size(), 3);
    parallel_for(size(), progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v) {
            const auto around = rows(v);
            if (at_one_[to_size(v)]) {
                result.row(v) = images.row(around.front());
                continue;
            }
            const auto weight = [&](Index k) { return weights_[v * neighbors_ + k]; };
            Vector3 from = Vector3::Zero(), to = Vector3::Zero();
            for (Index k = 0; k < neighbors_; ++k) {
                from += weight(k) * samples_.row(around[to_size(k)]).transpose();
                to += weight(k) * images.row(around[to_size(k)]).transpose();
            }
            Matrix3 spread = Matrix3::Zero(), cross = Matrix3::Zero();
            for (Index k = 0; k < neighbors_; ++k) {
                const Vector3 d = samples_.row(around[to_size(k)]).transpose() - from;
                const Vector3 y = images.row(around[to_size(k)]).transpose() - to;
                spread += weight(k) * d * d.transpose();
                cross += weight(k) * y * d.transpose();
            }
            const double extent = spread.trace();
            if (!(extent > 0.0)) {
                result.row(v) = to.transpose();
                continue;
            }
            const BestRotation turn = best_rotation(cross);
            const Matrix3 similar = turn.trace / extent * turn.rotation;
            const Matrix3 open = kOpen * extent * Matrix3::Identity();
            const Matrix3 linear = (cross + kOpen * extent * similar) * (spread + open).inverse();
            result.row(v) = (to + linear * offsets_.row(v).transpose()).transpose();
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

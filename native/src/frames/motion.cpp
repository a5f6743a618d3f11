#include "pointmorph/frames/motion.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

#include "base/angle.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/prolongation.hpp"

namespace pointmorph {

namespace {

Matrix3 share_of(const Matrix3& rotation, double t) {
    const Eigen::AngleAxisd whole = angle_axis(rotation);
    return Eigen::AngleAxisd(t * whole.angle(), whole.axis()).toRotationMatrix();
}

}  // namespace

Similarity GradualSimilarity::at(double t) const {
    Similarity part;
    part.scale = std::pow(whole.scale, t);
    part.rotation = share_of(whole.rotation, t);
    const Vector3 end = whole.scale * (whole.rotation * center) + whole.translation;
    part.translation = (1.0 - t) * center + t * end - part.scale * (part.rotation * center);
    return part;
}

GradualSimilarity GradualSimilarity::reversed() const {
    return {whole.inverse(), whole.scale * (whole.rotation * center) + whole.translation};
}

/// The nodes and what they do by t = 1.
struct Motion::Bend {
    CoarseShape shape;
    DeformationSolver solver;
    Deformation whole;
    Positions residual;  ///< nodes' images less where their own turns and scales would put them
    Prolongation prolongation;

    Bend(CoarseShape coarse, const Positions& positions, const Normals& normals,
         const Positions& images, Progress& progress)
        : shape(std::move(coarse)),
          solver(shape.positions, graph()),
          prolongation(shape, positions, normals, progress) {
        constexpr int kSmoothing = 1;
        constexpr double kLargestScale = 10.0;
        whole.positions = gather(gather(images, shape.cloud_rows), graph().node_rows);
        fit_similarities(shape.positions, graph(), kSmoothing, kLargestScale, whole);
        solver.factorize(1.0, {});
        residual = whole.positions - placed(whole);
    }

    const DeformationGraph& graph() const { return shape.levels.front(); }

    /// Places that follow from the turns and scales, about the center of the nodes' images.
    Positions placed(Deformation deformation) const {
        solver.solve({}, deformation);
        return deformation.positions.rowwise() - deformation.positions.colwise().mean();
    }

    DeformedCloud at(double t) const {
        Deformation part;
        for (const Matrix3& rotation : whole.rotations)
            part.rotations.push_back(share_of(rotation, t));
        part.scales = whole.scales.array().pow(t);
        part.positions = placed(part) + t * residual;
        const Positions rest = gather(shape.positions, graph().node_rows);
        part.positions.rowwise() += (1.0 - t) * rest.colwise().mean();
        return deformed(shape.positions, shape.normals, graph(), part);
    }
};

Motion::Motion(const Positions& positions, const Normals& normals, const Positions& images,
               const GradualSimilarity& similarity, PathKind path, Progress& progress)
    : unit_(normalization(positions)),
      positions_(unit_.apply(positions)),
      normals_(normals),
      similarity_(path == PathKind::kLinear ? GradualSimilarity{{}, unit_.center} : similarity) {
    const Positions straight = unit_.apply(similarity_.whole.inverse().apply(images));
    if (path != PathKind::kRigid) {
        offsets_ = straight - positions_;
        return;
    }
    constexpr Index kNodes = 1000;
    CoarseShapeOptions options;
    options.nodes = {kNodes};
    const KdTree<3> tree(positions_);
    bend_ = std::make_unique<const Bend>(coarse_shape(tree, normals, {}, options, progress),
                                         positions_, normals_, straight, progress);
    // Found backward: what has to be added at rest so that the end is the image. Where blended
    // turns cancel, nothing at rest would do: there it is added to the end, without any turn.
    const DeformedCloud end = bend_->at(1.0);
    offsets_ =
        straight - bend_->prolongation(bend_->shape, end, positions_, normals_, progress).positions;
    unturned_ = Positions::Zero(offsets_.rows(), 3);
    constexpr double kSingular = 1e-3;
    parallel_for(to_index(positions_.rows()), progress, [&](Index first, Index last) {
        for (Index i = first; i < last; ++i) {
            const Matrix3 linear = bend_->prolongation.linear(i, end);
            const double scale = linear.norm();
            if (linear.determinant() > kSingular * scale * scale * scale)
                offsets_.row(i) = linear.inverse() * offsets_.row(i).transpose();
            else
                unturned_.row(i).swap(offsets_.row(i));
        }
    });
    if (unturned_.isZero(0.0)) unturned_.resize(0, 3);
}

Motion::~Motion() = default;
Motion::Motion(Motion&&) noexcept = default;

OrientedPoints Motion::at(double t) const {
    Progress silent;
    OrientedPoints result{positions_ + t * offsets_, normals_};
    if (bend_)
        result =
            bend_->prolongation(bend_->shape, bend_->at(t), result.positions, normals_, silent);
    if (unturned_.rows() > 0) result.positions += t * unturned_;
    const Similarity part = similarity_.at(t);
    const Matrix3 linear = unit_.scale * part.scale * part.rotation;
    const Vector3 translation = part.scale * (part.rotation * unit_.center) + part.translation;
    parallel_for(to_index(positions_.rows()), silent, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const Vector3 x = result.positions.row(i).transpose();
            result.positions.row(i) = linear * x + translation;
            const Vector3 normal = part.rotation * result.normals.row(i).transpose();
            result.normals.row(i) = normal;
        }
    });
    return result;
}

template <class Scalar>
void fade(const OrientedPoints& source, const OrientedPoints& target,
          std::span<const IndexPair> pairs, double t, std::span<Scalar> positions,
          std::span<Scalar> normals) {
    const double share = t * t * (3.0 - 2.0 * t);
    const auto put = [](const Vector3& from, std::span<Scalar> to, std::size_t pair) {
        for (int d = 0; d < 3; ++d) to[3 * pair + to_size(d)] = static_cast<Scalar>(from[d]);
    };
    Progress silent;
    parallel_for(to_index(pairs.size()), silent, [&](Index begin, Index end) {
        for (auto i = to_size(begin); i < to_size(end); ++i) {
            const auto [s, r] = pairs[i];
            if (!positions.empty())
                put(((1.0 - share) * source.positions.row(s) + share * target.positions.row(r))
                        .transpose(),
                    positions, i);
            if (normals.empty()) continue;
            const Vector3 a = source.normals.row(s).transpose();
            const Vector3 b = target.normals.row(r).transpose();
            const Vector3 normal = (1.0 - share) * a + share * b;
            const double length = normal.norm();
            constexpr double kCancelled = 1e-6;
            if (length > kCancelled)
                put(normal / length, normals, i);
            else
                put(share < 0.5 ? a : b, normals, i);
        }
    });
}

template void fade<float>(const OrientedPoints&, const OrientedPoints&, std::span<const IndexPair>,
                          double, std::span<float>, std::span<float>);
template void fade<double>(const OrientedPoints&, const OrientedPoints&, std::span<const IndexPair>,
                           double, std::span<double>, std::span<double>);

}  // namespace pointmorph

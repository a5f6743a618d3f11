#include "pointmorph/refinement.hpp"

#include <algorithm>
#include <cmath>
#include <concepts>

#include "pointmorph/cloud.hpp"
#include "pointmorph/kd_tree.hpp"
#include "pointmorph/lift.hpp"
#include "pointmorph/parallel.hpp"
#include "pointmorph/subset.hpp"

namespace pointmorph {

namespace {

std::size_t at(Index i) {
    return static_cast<std::size_t>(i);
}

/// Calls `work(is_source, progress)` for both clouds, next to each other where there are threads.
template <std::invocable<bool, Progress&> Work>
void on_both(Progress& progress, Work&& work) {
    Progress silent;
    parallel_invoke(2, [&](int k, bool owner) { work(k == 0, owner ? progress : silent); });
}

/// A similarity after which the cloud has area 1 and its mean at the origin.
Similarity to_unit_area(const Positions& positions) {
    Similarity result;
    const double area = estimated_area(KdTree<3>(positions));
    if (area > 0.0) result.scale = 1.0 / std::sqrt(area);
    result.shift = -result.scale * positions.colwise().mean().transpose();
    return result;
}

Similarity composed(const Similarity& after, const Similarity& before) {
    return {after.scale * before.scale, after.rotation * before.rotation,
            after.scale * (after.rotation * before.shift) + after.shift};
}

/// The target onto the source by the features.
Similarity feature_alignment(const Positions& source, const Positions& target,
                             std::span<const IndexPair> features) {
    Positions s(static_cast<Eigen::Index>(features.size()), 3), t = s;
    for (std::size_t k = 0; k < features.size(); ++k) {
        s.row(static_cast<Eigen::Index>(k)) = source.row(features[k].source);
        t.row(static_cast<Eigen::Index>(k)) = target.row(features[k].target);
    }
    if (features.size() >= 3) return fit_similarity(t, s);
    Similarity shift;
    if (!features.empty()) shift.shift = (s.colwise().mean() - t.colwise().mean()).transpose();
    return shift;
}

/// Volume that the oriented points enclose, if they do.
double signed_volume(const CoarseShape& shape) {
    const Eigen::RowVector3d center = shape.positions.colwise().mean();
    return ((shape.positions.rowwise() - center).cwiseProduct(shape.normals).rowwise().sum())
               .dot(shape.areas) /
           3.0;
}

/// Mean agreement of the normals of source points, where they start, with the nearest target
/// points': about 1 for the same shape, below 0 where one is inside out.
double normal_agreement(const CoarseShape& source, const CoarseShape& target,
                        const Positions& start) {
    const KdTree<3> tree(target.positions);
    double sum = 0.0;
    for (Index i = 0; i < source.size(); ++i) {
        Index nearest;
        double squared;
        tree.nearest(start.row(i).data(), {&nearest, 1}, {&squared, 1});
        sum += source.normals.row(i).dot(target.normals.row(nearest));
    }
    return sum / source.size();
}

/// Whether the normals of one cloud face outwards and those of the other inwards: told from the
/// volumes where both clouds enclose one, else from how the normals agree.
bool inside_out(const CoarseShape& source, const CoarseShape& target, const Positions& start) {
    constexpr double kSomeVolume = 0.005;  // of a unit area; a ball has 0.09
    const double s = signed_volume(source), t = signed_volume(target);
    if (std::min(std::abs(s), std::abs(t)) > kSomeVolume) return s * t < 0.0;
    return normal_agreement(source, target, start) < 0.0;
}

/// Images moved onto the other surface: onto the tangent plane of the matching point, no further
/// from it than samples there are apart.
void project(Positions& images, const Pairing& pairs, Index IndexPair::*from, Index IndexPair::*to,
             const Positions& other, const Normals& other_normals, double reach) {
    std::vector<char> done(at(static_cast<Index>(images.rows())), 0);
    Positions result = images;
    std::vector<double> best(done.size(), std::numeric_limits<double>::infinity());
    for (const IndexPair& pair : pairs) {
        const Index i = pair.*from, j = pair.*to;
        const double squared = (images.row(i) - other.row(j)).squaredNorm();
        if (squared >= best[at(i)]) continue;
        best[at(i)] = squared;
        const Vector3 normal = other_normals.row(j).transpose();
        Vector3 offset = (images.row(i) - other.row(j)).transpose();
        offset -= normal * normal.dot(offset);
        const double length = offset.norm();
        if (length > reach) offset *= reach / length;
        result.row(i) = other.row(j) + offset.transpose();
    }
    images = std::move(result);
}

}  // namespace

Refinement refine(const Positions& source, const Normals& source_normals, const Positions& target,
                  const Normals& target_normals, std::span<const IndexPair> features,
                  const RefinementOptions& options, Progress& progress,
                  const RefinementStart* given) {
    Refinement result;
    progress.enter("coarse shapes");
    Similarity source_unit, target_move;
    on_both(progress, [&](bool is_source, Progress&) {
        (is_source ? source_unit : target_move) = to_unit_area(is_source ? source : target);
    });
    const Positions s = source_unit.apply(source);
    const bool pose_is_known =
        given || features.size() >= at(std::max<Index>(options.features_that_fix_the_pose, 3));
    if (given)
        target_move = composed(
            fit_similarity(target_move.apply(target), source_unit.apply(given->target_images)),
            target_move);
    else if (pose_is_known)
        target_move =
            composed(feature_alignment(s, target_move.apply(target), features), target_move);
    Positions t = target_move.apply(target);
    Normals tn = target_move.turn(target_normals);

    std::vector<Index> source_required, target_required;
    std::vector<IndexPair> coarse_features;
    for (std::size_t k = 0; k < features.size(); ++k) {
        source_required.push_back(features[k].source);
        target_required.push_back(features[k].target);
        coarse_features.push_back({static_cast<Index>(k), static_cast<Index>(k)});
    }
    CoarseShape coarse_source, coarse_target;
    on_both(progress, [&](bool is_source, Progress& p) {
        if (is_source)
            coarse_source =
                coarse_shape(KdTree<3>(s), source_normals, source_required, options.coarse, p);
        else
            coarse_target = coarse_shape(KdTree<3>(t), tn, target_required, options.coarse, p);
    });

    RegistrationStart start =
        given
            ? RegistrationStart{target_move.apply(gather(given->source_images, coarse_source.rows)),
                                source_unit.apply(gather(given->target_images, coarse_target.rows))}
            : thin_plate_start(coarse_source, coarse_target, coarse_features);
    if (inside_out(coarse_source, coarse_target, start.source)) {
        result.inside_out = true;
        tn = -tn;
        coarse_target.normals = -coarse_target.normals;
    }
    Index first_level = 0;
    if (!pose_is_known) {
        progress.enter("pose");
        const Pose pose = find_pose(coarse_source, coarse_target, coarse_features, options.pose,
                                    options.registration, progress);
        coarse_target = moved(coarse_target, pose.alignment);
        t = pose.alignment.apply(t);
        tn = pose.alignment.turn(tn);
        target_move = composed(pose.alignment, target_move);
        start = {pose.registration.source_points.positions,
                 pose.registration.target_points.positions};
        first_level = 1;
        result.margin = pose.margin;
        if (pose.margin < options.clear_margin)
            result.warnings.push_back(
                "The shapes fit another way almost as well (a swap of left and right, or of head "
                "and tail). If the morph goes wrong, mark one feature that tells them apart.");
    }
    result.alignment = composed(source_unit.inverse(), target_move);

    progress.enter("registration");
    const Registration registration =
        register_shapes(coarse_source, coarse_target, coarse_features, start, options.registration,
                        progress, first_level);

    progress.enter("lift");
    LiftedCloud x = lifted(coarse_source, registration.source_points, s, source_normals, progress);
    LiftedCloud y = lifted(coarse_target, registration.target_points, t, tn, progress);
    const double source_spacing = 1.0 / std::sqrt(static_cast<double>(s.rows()));
    const double target_spacing = 1.0 / std::sqrt(static_cast<double>(t.rows()));
    for (const IndexPair& f : features) {
        result.feature_residual =
            std::max({result.feature_residual,
                      (x.positions.row(f.source) - t.row(f.target)).norm() / target_spacing,
                      (y.positions.row(f.target) - s.row(f.source)).norm() / source_spacing});
        x.positions.row(f.source) = t.row(f.target);
        y.positions.row(f.target) = s.row(f.source);
    }

    progress.enter("product space");
    constexpr double kReferencePoints = 1e4;
    const double weight =
        options.normal_weight * std::min(1.0, std::sqrt(kReferencePoints) * source_spacing);
    result.source_product = product_points(x.positions, s, x.normals, source_normals, weight);
    result.target_product = product_points(t, y.positions, tn, y.normals, weight);
    result.pairs = mutual_pairs(result.source_product, result.target_product, features, progress);

    project(x.positions, result.pairs, &IndexPair::source, &IndexPair::target, t, tn,
            2.0 * target_spacing);
    project(y.positions, result.pairs, &IndexPair::target, &IndexPair::source, s, source_normals,
            2.0 * source_spacing);
    result.source_images = target_move.inverse().apply(x.positions);
    result.target_images = source_unit.inverse().apply(y.positions);
    for (const IndexPair& f : features) {
        result.source_images.row(f.source) = target.row(f.target);
        result.target_images.row(f.target) = source.row(f.source);
    }
    progress.finish();
    return result;
}

}  // namespace pointmorph

#include "pointmorph/refinement.hpp"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <optional>

#include "pointmorph/cloud.hpp"
#include "pointmorph/kd_tree.hpp"
#include "pointmorph/landing.hpp"
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

/// Farthest that a feature's image lies from its partner.
double largest_offset(const Positions& images, const Positions& other,
                      std::span<const IndexPair> features, Index IndexPair::*from,
                      Index IndexPair::*to) {
    double largest = 0.0;
    for (const IndexPair& f : features)
        largest = std::max(largest, (images.row(f.*from) - other.row(f.*to)).norm());
    return largest;
}

/// Moves images so that features come to lie near their partners, with everything around: offsets
/// averaged with Gaussian weights that fall with the distance (Shepard's method, fading out).
void pull_to_features(Positions& images, const Positions& positions, const Positions& other,
                      std::span<const IndexPair> features, Index IndexPair::*from,
                      Index IndexPair::*to) {
    constexpr double kReach = 0.15;  // of √area
    std::vector<Eigen::RowVector3d> offsets;
    for (const IndexPair& f : features)
        offsets.emplace_back(other.row(f.*to) - images.row(f.*from));
    for (Eigen::Index i = 0; i < images.rows(); ++i) {
        Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
        double weights = 0.0;
        for (std::size_t k = 0; k < features.size(); ++k) {
            const double squared =
                (positions.row(i) - positions.row(features[k].*from)).squaredNorm();
            const double weight = std::exp(-0.5 * squared / (kReach * kReach));
            sum += weight * offsets[k];
            weights += weight;
        }
        images.row(i) += sum / std::max(weights, 1.0);
    }
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

/// Moves the images of features onto their partners, and those around smoothly with them: by
/// (1 − (d/r)²)² of the offset within r, some spacings.
void pin_features(Positions& images, const Positions& positions, const Positions& other,
                  std::span<const IndexPair> features, Index IndexPair::*from, Index IndexPair::*to,
                  double spacing) {
    constexpr double kReach = 6.0;
    const double squared_reach = kReach * kReach * spacing * spacing;
    for (const IndexPair& f : features) {
        const Eigen::RowVector3d offset = other.row(f.*to) - images.row(f.*from);
        const Eigen::RowVector3d center = positions.row(f.*from);
        for (Eigen::Index i = 0; i < images.rows(); ++i) {
            const double ratio = (positions.row(i) - center).squaredNorm() / squared_reach;
            if (ratio < 1.0) images.row(i) += (1.0 - ratio) * (1.0 - ratio) * offset;
        }
    }
    // Features close to each other have pulled at one another.
    for (const IndexPair& f : features) images.row(f.*from) = other.row(f.*to);
}

/// The nearest of each row's partners.
std::vector<Index> nearest_partners(const Positions& images, const Pairing& pairs,
                                    Index IndexPair::*from, Index IndexPair::*to,
                                    const Positions& other) {
    const auto count = at(static_cast<Index>(images.rows()));
    std::vector<Index> partners(count, -1);
    std::vector<double> best(count, std::numeric_limits<double>::infinity());
    for (const IndexPair& pair : pairs) {
        const Index i = pair.*from, j = pair.*to;
        const double squared = (images.row(i) - other.row(j)).squaredNorm();
        if (squared >= best[at(i)]) continue;
        best[at(i)] = squared;
        partners[at(i)] = j;
    }
    return partners;
}

/// Rivals and proposals, from rows of the coarse shapes.
void to_cloud_rows(Refinement& result, const std::vector<Index>& source,
                   const std::vector<Index>& target) {
    for (Rival& rival : result.rivals) {
        for (Index& place : rival.places) place = source[at(place)];
        rival.source = source[at(rival.source)];
        rival.target = target[at(rival.target)];
        rival.rival_target = target[at(rival.rival_target)];
    }
    for (Proposal& proposal : result.proposals) {
        proposal.source = source[at(proposal.source)];
        proposal.target = target[at(proposal.target)];
    }
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
    if (given) {
        const double largest =
            std::max(source_unit.scale * largest_offset(given->target_images, source, features,
                                                        &IndexPair::target, &IndexPair::source),
                     target_move.scale * largest_offset(given->source_images, target, features,
                                                        &IndexPair::source, &IndexPair::target));
        if (largest > options.trusted_distance) given = nullptr;
    }
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
    std::optional<KdTree<3>> source_tree, target_tree;
    CoarseShape coarse_source, coarse_target;
    on_both(progress, [&](bool is_source, Progress& p) {
        if (is_source)
            coarse_source = coarse_shape(source_tree.emplace(s), source_normals, source_required,
                                         options.coarse, p);
        else
            coarse_target =
                coarse_shape(target_tree.emplace(t), tn, target_required, options.coarse, p);
    });

    RegistrationStart start = thin_plate_start(coarse_source, coarse_target, coarse_features);
    if (given) {
        start = {target_move.apply(gather(given->source_images, coarse_source.rows)),
                 source_unit.apply(gather(given->target_images, coarse_target.rows))};
        pull_to_features(start.source, coarse_source.positions, coarse_target.positions,
                         coarse_features, &IndexPair::source, &IndexPair::target);
        pull_to_features(start.target, coarse_target.positions, coarse_source.positions,
                         coarse_features, &IndexPair::target, &IndexPair::source);
    }
    if (inside_out(coarse_source, coarse_target, start.source)) {
        result.inside_out = true;
        tn = -tn;
        coarse_target.normals = -coarse_target.normals;
    }
    Registration registration;
    std::vector<Extremity> source_tips, target_tips;
    if (!pose_is_known) {
        progress.enter("pose");
        Pose pose = find_pose(coarse_source, coarse_target, coarse_features, options.pose,
                              options.registration, progress);
        result.rivals = describe_rivals(coarse_source, coarse_target, pose);
        const Similarity& move = pose.best.alignment;
        coarse_target = moved(coarse_target, move);
        t = move.apply(t);
        target_tree.emplace(t);
        tn = move.turn(tn);
        target_move = composed(move, target_move);
        registration = std::move(pose.best.registration);
        result.margin = pose.margin;
        result.confidence = pose.confidence;
        source_tips = std::move(pose.source_tips);
        target_tips = std::move(pose.target_tips);
    } else {
        progress.enter("registration");
        registration = register_shapes(coarse_source, coarse_target, coarse_features, start,
                                       options.registration, progress);
    }
    result.alignment = composed(source_unit.inverse(), target_move);
    if (options.propose || !pose_is_known) {
        if (pose_is_known) {
            const auto tips = [&](const CoarseShape& shape) {
                return extremities(shape, node_distances(shape), options.pose.extremities);
            };
            source_tips = tips(coarse_source);
            target_tips = tips(coarse_target);
        }
        result.proposals =
            propose_features(coarse_source, coarse_target, registration, source_tips, target_tips,
                             coarse_features, result.confidence, options.other_proposals, progress);
        to_cloud_rows(result, coarse_source.rows, coarse_target.rows);
    }

    progress.enter("lift");
    LiftedCloud x = Lift(coarse_source, s, source_normals, progress)(
        coarse_source, registration.source_points, s, source_normals, progress);
    LiftedCloud y = Lift(coarse_target, t, tn, progress)(coarse_target, registration.target_points,
                                                         t, tn, progress);
    const double source_spacing = 1.0 / std::sqrt(static_cast<double>(s.rows()));
    const double target_spacing = 1.0 / std::sqrt(static_cast<double>(t.rows()));
    pin_features(x.positions, s, t, features, &IndexPair::source, &IndexPair::target,
                 source_spacing);
    pin_features(y.positions, t, s, features, &IndexPair::target, &IndexPair::source,
                 target_spacing);

    progress.enter("product space");
    constexpr double kReferencePoints = 1e4;
    const double weight =
        options.normal_weight * std::min(1.0, std::sqrt(kReferencePoints) * source_spacing);
    result.source_product = product_points(x.positions, s, x.normals, source_normals, weight);
    result.target_product = product_points(t, y.positions, tn, y.normals, weight);
    result.pairs = mutual_pairs(result.source_product, result.target_product, features, progress);

    progress.enter("landing");
    x.positions = landed(
        x.positions,
        nearest_partners(x.positions, result.pairs, &IndexPair::source, &IndexPair::target, t),
        *target_tree, tn, progress);
    y.positions = landed(
        y.positions,
        nearest_partners(y.positions, result.pairs, &IndexPair::target, &IndexPair::source, s),
        *source_tree, source_normals, progress);
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

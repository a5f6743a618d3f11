#include "pointmorph/pose.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <numeric>

#include "pointmorph/cloud.hpp"
#include "pointmorph/extremities.hpp"
#include "pointmorph/kd_tree.hpp"
#include "pointmorph/parallel.hpp"
#include "pointmorph/subset.hpp"

namespace pointmorph {

namespace {

std::size_t at(Index i) {
    return static_cast<std::size_t>(i);
}

struct PrincipalFrame {
    Vector3 center;
    Vector3 spreads;  ///< root mean square along the axes, ascending
    Matrix3 axes;     ///< columns
};

PrincipalFrame principal_frame(const CoarseShape& shape) {
    const Values weights = shape.areas / shape.areas.sum();
    PrincipalFrame frame;
    frame.center = shape.positions.transpose() * weights;
    const Positions centered = shape.positions.rowwise() - frame.center.transpose();
    const Matrix3 covariance = centered.transpose() * weights.asDiagonal() * centered;
    const Eigen::SelfAdjointEigenSolver<Matrix3> solver(covariance);
    frame.axes = solver.eigenvectors();
    frame.spreads = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt();
    return frame;
}

Similarity turn_about(const Matrix3& rotation, const Vector3& from, const Vector3& to) {
    return {1.0, rotation, to - rotation * from};
}

/// Root mean square distance of the features under a pose.
double feature_distance(const CoarseShape& source, const CoarseShape& target,
                        std::span<const IndexPair> features, const Similarity& pose) {
    const MarkedPlaces places = marked_places(source, target, features);
    double sum = 0.0;
    for (Eigen::Index k = 0; k < places.source.rows(); ++k)
        sum += (places.source.row(k).transpose() -
                pose.rotation * places.target.row(k).transpose() - pose.shift)
                   .squaredNorm();
    return places.source.rows() == 0 ? 0.0
                                     : std::sqrt(sum / static_cast<double>(places.source.rows()));
}

Similarity composed(const Similarity& after, const Similarity& before) {
    return {after.scale * before.scale, after.rotation * before.rotation,
            after.scale * (after.rotation * before.shift) + after.shift};
}

/// The nodes of the coarsest level and other points among them, `points` in all: the same
/// deformations, at a fraction of the cost. No surface graph.
CoarseShape thinned(const CoarseShape& shape, const std::vector<Extremity>& tips, Index points,
                    Progress& progress) {
    const DeformationGraph& graph = shape.levels.front();
    const KdTree<3> tree(shape.positions);
    std::vector<Index> required = graph.nodes;
    for (const Extremity& tip : tips)
        if (std::ranges::find(required, tip.point) == required.end()) required.push_back(tip.point);
    const Subset subset =
        blue_noise_subset(tree, shape.normals, required,
                          std::max(points, static_cast<Index>(required.size())), progress);
    CoarseShape thin;
    thin.rows = subset.rows;
    thin.positions = gather(shape.positions, thin.rows);
    thin.normals = gather(shape.normals, thin.rows);
    thin.areas = Values::Zero(thin.size());
    const KdTree<3> thin_tree(thin.positions);
    for (Index i = 0; i < shape.size(); ++i) {
        Index nearest;
        double squared;
        thin_tree.nearest(shape.positions.row(i).data(), {&nearest, 1}, {&squared, 1});
        thin.areas[nearest] += shape.areas[i];
    }
    DeformationGraph& level = thin.levels.emplace_back(graph);
    std::iota(level.nodes.begin(), level.nodes.end(), 0);
    level.point_nodes.clear();
    level.point_weights.clear();
    for (const Index row : thin.rows) {
        level.point_nodes.push_back(graph.point_nodes[at(row)]);
        level.point_weights.push_back(graph.point_weights[at(row)]);
    }
    thin.guides = shape.guides;
    for (Index& row : thin.guides.rows)
        row = nearest_on_sheet(thin_tree, thin.normals, shape.positions.row(row),
                               shape.normals.row(row));
    if (shape.labels.rows() > 0) {
        thin.labels = gather(shape.labels, thin.rows);
        thin.pulls = gather(shape.pulls, thin.rows);
    }
    return thin;
}

/// Both shapes in full, to judge maps, and thinned, to find them.
struct Shapes {
    const CoarseShape &source, &target;
    CoarseShape thin_source, thin_target;
    NodeDistances distances;
    std::vector<Extremity> source_tips, target_tips;
    std::span<const IndexPair> features;
};

/// How far two maps lie apart: the mean, or a share of the mean over the worst nodes where that is
/// more, of the distances between images of the source's nodes seen from the target at rest, and
/// the other way round.
double difference(const Shapes& shapes, const Pose& a, const Pose& b) {
    constexpr double kWorst = 0.03, kShare = 0.35;
    double result = 0.0;
    const auto compare = [&](const Positions& x, const Positions& y,
                             const std::vector<Index>& nodes) {
        std::vector<double> distances;
        for (const Index i : nodes) distances.push_back((x.row(i) - y.row(i)).norm());
        const auto worst = std::max<std::ptrdiff_t>(
            1, std::lround(kWorst * static_cast<double>(distances.size())));
        std::ranges::sort(distances, std::greater<>());
        const double all = std::accumulate(distances.begin(), distances.end(), 0.0);
        const double some = std::accumulate(distances.begin(), distances.begin() + worst, 0.0);
        result = std::max({result, all / static_cast<double>(distances.size()),
                           kShare * some / static_cast<double>(worst)});
    };
    compare(a.alignment.inverse().apply(a.registration.source_points.positions),
            b.alignment.inverse().apply(b.registration.source_points.positions),
            shapes.source.levels.front().nodes);
    compare(a.registration.target_points.positions, b.registration.target_points.positions,
            shapes.target.levels.front().nodes);
    return result;
}

/// A start for a trial.
struct Attempt {
    Similarity alignment;         ///< the target's pose
    std::vector<IndexPair> tips;  ///< places in the lists of tips; drawn together at first
};

/// Rows of the thinned shapes.
std::vector<IndexPair> with_tips(const Shapes& shapes, const std::vector<IndexPair>& tips) {
    const auto place = [](const CoarseShape& thin, Index row) {
        return static_cast<Index>(std::ranges::find(thin.rows, row) - thin.rows.begin());
    };
    std::vector<IndexPair> result(shapes.features.begin(), shapes.features.end());
    for (const IndexPair& tip : tips)
        result.push_back({place(shapes.thin_source, shapes.source_tips[at(tip.source)].point),
                          place(shapes.thin_target, shapes.target_tips[at(tip.target)].point)});
    return result;
}

Pose try_pose(const Shapes& shapes, const Attempt& attempt, const RegistrationLevel& level,
              const RegistrationOptions& options) {
    Progress silent;
    const CoarseShape there = moved(shapes.thin_target, attempt.alignment);
    RegistrationStart start{shapes.thin_source.positions, there.positions};
    RegistrationLevel rest = level;
    if (!attempt.tips.empty()) {
        // Tips lead the way while the shapes are stiff; then the surfaces decide.
        RegistrationLevel lead = level;
        lead.rounds = level.rounds / 2;
        lead.last_stiffness = rest.first_stiffness =
            std::sqrt(level.first_stiffness * level.last_stiffness);
        rest.stiff_rounds = 0;
        rest.rounds -= lead.rounds;
        RegistrationOptions soft = options;
        soft.feature_weight = options.feature_weight / 10.0;
        Registration led =
            register_level(shapes.thin_source, there, 0, with_tips(shapes, attempt.tips), start,
                           lead, soft, silent);
        start = {std::move(led.source_points.positions), std::move(led.target_points.positions)};
    }
    Registration thin =
        register_level(shapes.thin_source, there, 0, shapes.features, start, rest, options, silent);
    const CoarseShape full = moved(shapes.target, attempt.alignment);
    Pose pose{attempt.alignment, {std::move(thin.source), std::move(thin.target), {}, {}}, 0.0};
    Registration& r = pose.registration;
    r.source_points = deformed(shapes.source.positions, shapes.source.normals,
                               shapes.source.levels.front(), r.source);
    r.target_points = deformed(full.positions, full.normals, full.levels.front(), r.target);
    pose.energy = registration_energy(shapes.source, full, 0, r, shapes.distances, options, silent);
    return pose;
}

/// All of them, side by side.
std::vector<Pose> try_poses(const Shapes& shapes, std::span<const Attempt> attempts,
                            const RegistrationLevel& level, const RegistrationOptions& options,
                            Progress& progress, double first, double last) {
    std::vector<Pose> poses(attempts.size());
    parallel_for(
        static_cast<Index>(attempts.size()), progress,
        [&](Index begin, Index end) {
            for (Index k = begin; k < end; ++k)
                poses[at(k)] = try_pose(shapes, attempts[at(k)], level, options);
        },
        first, last, 1);
    return poses;
}

/// Sorted by energy; of maps that aren't distinct only the first.
void keep_distinct(const Shapes& shapes, std::vector<Pose>& poses, const PoseOptions& options) {
    std::ranges::stable_sort(poses, {}, &Pose::energy);
    std::vector<Pose> kept;
    for (Pose& pose : poses)
        if (std::ranges::none_of(kept, [&](const Pose& other) {
                return difference(shapes, pose, other) < options.distinct;
            }))
            kept.push_back(std::move(pose));
    poses = std::move(kept);
}

/// Ways in which the tips may belong together, the likeliest first: as the map has them, and with
/// two of them swapped, or one left out. `count` at most.
std::vector<std::vector<IndexPair>> tip_variants(const Shapes& shapes, const Pose& pose,
                                                 const ExtremityOptions& options, Index count) {
    const CoarseShape there = moved(shapes.target, pose.alignment);
    const Registration& r = pose.registration;
    const auto mean_distance = [&](Index i, Index j) {
        const Index a = shapes.source_tips[at(i)].point, b = shapes.target_tips[at(j)].point;
        return 0.5 * ((r.source_points.positions.row(a) - there.positions.row(b)).norm() +
                      (r.target_points.positions.row(b) - shapes.source.positions.row(a)).norm());
    };
    const auto node = [](const CoarseShape& shape, const Extremity& tip) {
        return shape.levels.front().point_nodes[at(tip.point)][0];
    };
    // How differently far apart the tips are on both shapes, and how far the map leaves them.
    const auto cost = [&](const std::vector<IndexPair>& pairs) {
        double sum = 0.0;
        for (const IndexPair& p : pairs) {
            sum += mean_distance(p.source, p.target);
            double other = 0.0;
            for (const IndexPair& q : pairs)
                other += std::abs(
                    shapes.distances[0](node(shapes.source, shapes.source_tips[at(p.source)]),
                                        node(shapes.source, shapes.source_tips[at(q.source)])) -
                    shapes.distances[1](node(shapes.target, shapes.target_tips[at(p.target)]),
                                        node(shapes.target, shapes.target_tips[at(q.target)])));
            sum += other / static_cast<double>(pairs.size());
        }
        return sum / static_cast<double>(pairs.size());
    };
    std::vector<IndexPair> first;
    for (const ExtremityPair& p : paired_extremities(
             shapes.source, there, r.source_points.positions, r.target_points.positions,
             shapes.source_tips, shapes.target_tips, options))
        first.push_back({p.source, p.target});
    if (first.size() < 2) return {};
    std::vector<std::pair<double, std::vector<IndexPair>>> variants;
    for (std::size_t i = 0; i < first.size(); ++i) {
        for (std::size_t j = 0; j < i; ++j) {
            auto swapped = first;
            std::swap(swapped[i].target, swapped[j].target);
            variants.emplace_back(cost(swapped), std::move(swapped));
        }
        // Another partner, whose own one may be left alone.
        for (Index t = 0; t < static_cast<Index>(shapes.target_tips.size()); ++t)
            if (std::ranges::find(first, t, &IndexPair::target) == first.end()) {
                auto other = first;
                other[i].target = t;
                variants.emplace_back(cost(other), std::move(other));
            }
        for (Index s = 0; s < static_cast<Index>(shapes.source_tips.size()); ++s)
            if (std::ranges::find(first, s, &IndexPair::source) == first.end()) {
                auto other = first;
                other[i].source = s;
                variants.emplace_back(cost(other), std::move(other));
            }
    }
    std::ranges::stable_sort(variants, {}, &std::pair<double, std::vector<IndexPair>>::first);
    std::vector<std::vector<IndexPair>> result{std::move(first)};
    for (auto& variant : variants)
        if (static_cast<Index>(result.size()) < count) result.push_back(std::move(variant.second));
    return result;
}

/// The shapes as they lie, but for their centres, with and without the tips that this brings
/// together; nothing where the features contradict it, against the best of `others`.
std::vector<Attempt> as_given(const Shapes& shapes, std::span<const Attempt> others,
                              const PoseOptions& options, const RegistrationOptions& registration) {
    const Similarity lying = turn_about(Matrix3::Identity(), principal_frame(shapes.target).center,
                                        principal_frame(shapes.source).center);
    const auto apart = [&](const Similarity& pose) {
        return feature_distance(shapes.source, shapes.target, shapes.features, pose);
    };
    for (const Attempt& other : others)
        if (apart(lying) > apart(other.alignment) + options.feature_distance) return {};
    std::vector<Attempt> attempts{{lying, {}}};
    const Pose trial = try_pose(shapes, attempts.front(), options.trial, registration);
    for (auto& tips : tip_variants(shapes, trial, options.extremities, 1))
        attempts.push_back({lying, std::move(tips)});
    return attempts;
}

/// The pose that makes a map turn as little as it can.
Similarity implied(const Shapes& shapes, const Pose& pose) {
    const Positions& images = pose.registration.source_points.positions;
    const Similarity fit = fit_similarity(shapes.source.positions, images);
    return composed(turn_about(fit.rotation.transpose(), images.colwise().mean().transpose(),
                               shapes.source.positions.colwise().mean().transpose()),
                    pose.alignment);
}

}  // namespace

CoarseShape moved(const CoarseShape& shape, const Similarity& move) {
    CoarseShape result = shape;
    result.positions = move.apply(shape.positions);
    result.normals = move.turn(shape.normals);
    result.guides.places = move.apply(shape.guides.places);
    return result;
}

std::vector<Similarity> candidate_poses(const CoarseShape& source, const CoarseShape& target,
                                        std::span<const IndexPair> features,
                                        const PoseOptions& options) {
    const PrincipalFrame s = principal_frame(source), t = principal_frame(target);
    std::vector<Similarity> poses;
    std::array<int, 3> order{0, 1, 2};
    do {
        bool alike = true;
        for (int k = 0; k < 3; ++k) {
            const double a = s.spreads[k] + 1e-9,
                         b = t.spreads[order[static_cast<std::size_t>(k)]] + 1e-9;
            alike = alike && std::max(a / b, b / a) <= options.spread_ratio;
        }
        if (!alike && !std::ranges::is_sorted(order)) continue;  // like to like is always tried
        for (int signs = 0; signs < 8; ++signs) {
            Matrix3 axes;
            for (int k = 0; k < 3; ++k)
                axes.col(k) =
                    (signs >> k & 1 ? -1.0 : 1.0) * t.axes.col(order[static_cast<std::size_t>(k)]);
            const Matrix3 rotation = s.axes * axes.transpose();
            if (rotation.determinant() > 0.0)
                poses.push_back(turn_about(rotation, t.center, s.center));
        }
    } while (std::ranges::next_permutation(order).found);

    const auto [to, from] = marked_places(source, target, features);
    if (to.rows() >= 2) {
        const auto by_features = [&, &to = to, &from = from](const Similarity& before) {
            const Matrix3 turn = fit_similarity(before.apply(from), to).rotation;
            const Vector3 mean = before.apply(from).colwise().mean().transpose();
            return composed(turn_about(turn, mean, to.colwise().mean().transpose()), before);
        };
        // Two features leave the roll open: each pose gets the least turn that brings them
        // together. Three or more leave nothing open.
        if (to.rows() == 2) {
            const std::size_t count = poses.size();
            for (std::size_t k = 0; k < count; ++k) poses.push_back(by_features(poses[k]));
        } else {
            poses.push_back(by_features({}));
        }
    }
    double least = std::numeric_limits<double>::infinity();
    for (const Similarity& pose : poses)
        least = std::min(least, feature_distance(source, target, features, pose));
    std::erase_if(poses, [&](const Similarity& pose) {
        return feature_distance(source, target, features, pose) > least + options.feature_distance;
    });
    return poses;
}

Pose find_pose(const CoarseShape& source, const CoarseShape& target,
               std::span<const IndexPair> features, const PoseOptions& options,
               const RegistrationOptions& registration, Progress& progress) {
    NodeDistances distances{node_distances(source), node_distances(target)};
    std::vector<Extremity> source_tips = extremities(source, distances[0], options.extremities);
    std::vector<Extremity> target_tips = extremities(target, distances[1], options.extremities);
    CoarseShape thin_source = thinned(source, source_tips, options.points, progress);
    CoarseShape thin_target = thinned(target, target_tips, options.points, progress);
    const Shapes shapes{source,
                        target,
                        std::move(thin_source),
                        std::move(thin_target),
                        std::move(distances),
                        std::move(source_tips),
                        std::move(target_tips),
                        features};
    std::vector<Attempt> attempts;
    for (const Similarity& pose : candidate_poses(source, target, features, options))
        attempts.push_back({pose, {}});
    std::vector<Pose> trials =
        try_poses(shapes, attempts, options.trial, registration, progress, 0.0, 0.25);
    keep_distinct(shapes, trials, options);

    attempts.clear();
    const PrincipalFrame frame = principal_frame(source);
    for (std::size_t k = 0; k < trials.size() && k < at(options.finalists); ++k) {
        const Similarity base = implied(shapes, trials[k]);
        attempts.push_back({base, {}});
        if (k == 0)
            for (int axis = 0; axis < 3; ++axis)
                for (const double angle : {-options.swing, options.swing})
                    attempts.push_back(
                        {composed(
                             turn_about(
                                 Eigen::AngleAxisd(angle, frame.axes.col(axis)).toRotationMatrix(),
                                 frame.center, frame.center),
                             base),
                         {}});
    }
    std::vector<Pose> again =
        try_poses(shapes, attempts, options.trial, registration, progress, 0.25, 0.5);
    std::ranges::move(again, std::back_inserter(trials));
    keep_distinct(shapes, trials, options);

    attempts.clear();
    for (std::size_t k = 0; k < trials.size() && k < 2; ++k)
        for (auto& tips : tip_variants(shapes, trials[k], options.extremities, options.variants))
            attempts.push_back({implied(shapes, trials[k]), std::move(tips)});
    again = try_poses(shapes, attempts, options.trial, registration, progress, 0.5, 0.8);
    std::ranges::move(again, std::back_inserter(trials));
    keep_distinct(shapes, trials, options);

    attempts.clear();
    for (std::size_t k = 0; k < trials.size() && k < at(options.finalists); ++k)
        attempts.push_back({implied(shapes, trials[k]), {}});
    const std::size_t searched = attempts.size();
    for (Attempt& attempt : as_given(shapes, attempts, options, registration))
        attempts.push_back(std::move(attempt));
    std::vector<Pose> finals =
        try_poses(shapes, attempts, registration.levels.front(), registration, progress, 0.8, 1.0);
    const auto least = [](std::span<const Pose> poses) -> const Pose& {
        return *std::ranges::min_element(poses, {}, &Pose::energy);
    };
    const Pose& any = least(finals);
    const bool stays =
        searched < finals.size() &&
        least(std::span(finals).subspan(searched)).energy <= options.as_given * any.energy;
    Pose best = stays ? least(std::span(finals).subspan(searched)) : any;
    const auto rival = [&](const Pose& other, double energy) {
        if (difference(shapes, other, best) >= options.distinct)
            best.margin =
                std::min(best.margin, std::max(1.0, other.energy / std::max(energy, 1e-300)));
    };
    for (const Pose& other : finals) rival(other, best.energy);
    for (const Pose& other : trials) rival(other, trials.front().energy);
    return best;
}

}  // namespace pointmorph

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
    std::vector<Extremity> source_tips, target_tips;  ///< rows of the thinned shapes
    std::span<const IndexPair> features;
};

using Tips = std::vector<IndexPair>;  ///< places in the lists of tips; sorted

struct TrialStart {
    Similarity alignment;  ///< the target's pose
    Tips tips;             ///< drawn together at first
};

/// A map between the thinned shapes.
struct Trial {
    Similarity alignment;
    Registration registration;
    double energy = 0.0;
};

/// How far two maps lie apart: the mean, or a share of the mean over the worst nodes where that is
/// more, of the distances between images of the source's nodes seen from the target at rest, and
/// the other way round.
template <class Map>
double difference(const Map& a, const Map& b) {
    constexpr double kWorst = 0.03, kShare = 0.35;
    double result = 0.0;
    const auto compare = [&](const Positions& x, const Positions& y) {
        std::vector<double> distances;
        for (Eigen::Index i = 0; i < x.rows(); ++i)
            distances.push_back((x.row(i) - y.row(i)).norm());
        const auto worst = std::max<std::ptrdiff_t>(
            1, std::lround(kWorst * static_cast<double>(distances.size())));
        std::ranges::sort(distances, std::greater<>());
        const double all = std::accumulate(distances.begin(), distances.end(), 0.0);
        const double some = std::accumulate(distances.begin(), distances.begin() + worst, 0.0);
        result = std::max({result, all / static_cast<double>(distances.size()),
                           kShare * some / static_cast<double>(worst)});
    };
    compare(a.alignment.inverse().apply(a.registration.source.positions),
            b.alignment.inverse().apply(b.registration.source.positions));
    compare(a.registration.target.positions, b.registration.target.positions);
    return result;
}

/// Of maps that aren't distinct, only the first.
template <class Map>
void keep_distinct(std::vector<Map>& maps, double distinct) {
    std::vector<Map> kept;
    for (Map& map : maps)
        if (std::ranges::none_of(
                kept, [&](const Map& other) { return difference(map, other) < distinct; }))
            kept.push_back(std::move(map));
    maps = std::move(kept);
}

Trial try_pose(const Shapes& shapes, const TrialStart& from, const RegistrationLevel& level,
               const RegistrationOptions& options) {
    Progress silent;
    const CoarseShape there = moved(shapes.thin_target, from.alignment);
    // Curves and regions have to be brought over; by points alone a plate turns heads.
    RegistrationStart start =
        shapes.source.guides.size() > 0
            ? thin_plate_start(shapes.thin_source, there, shapes.features)
            : RegistrationStart{shapes.thin_source.positions, there.positions};
    RegistrationLevel rest = level;
    if (!from.tips.empty()) {
        // Tips lead the way while the shapes are stiff; then the surfaces decide.
        RegistrationLevel lead = level;
        lead.rounds = level.rounds / 2;
        lead.last_stiffness = rest.first_stiffness =
            std::sqrt(level.first_stiffness * level.last_stiffness);
        rest.stiff_rounds = 0;
        rest.rounds -= lead.rounds;
        RegistrationOptions soft = options;
        soft.feature_weight = options.feature_weight / 10.0;
        std::vector<IndexPair> guides(shapes.features.begin(), shapes.features.end());
        for (const IndexPair& tip : from.tips)
            guides.push_back({shapes.source_tips[at(tip.source)].point,
                              shapes.target_tips[at(tip.target)].point});
        Registration led =
            register_level(shapes.thin_source, there, 0, guides, start, lead, soft, silent);
        start = {std::move(led.source_points.positions), std::move(led.target_points.positions)};
    }
    Trial trial{from.alignment, register_level(shapes.thin_source, there, 0, shapes.features, start,
                                               rest, options, silent)};
    trial.energy = registration_energy(shapes.thin_source, there, 0, trial.registration,
                                       shapes.distances, options, silent);
    return trial;
}

/// Tries all, side by side, and sorts what is distinct into `trials`.
void try_poses(const Shapes& shapes, std::span<const TrialStart> starts, const PoseOptions& options,
               const RegistrationOptions& registration, std::vector<Trial>& trials,
               Progress& progress, double first, double last) {
    const std::size_t before = trials.size();
    trials.resize(before + starts.size());
    parallel_for(
        static_cast<Index>(starts.size()), progress,
        [&](Index begin, Index end) {
            for (Index k = begin; k < end; ++k)
                trials[before + at(k)] =
                    try_pose(shapes, starts[at(k)], options.trial, registration);
        },
        first, last, 1);
    std::ranges::stable_sort(trials, {}, &Trial::energy);
    keep_distinct(trials, options.apart);
}

/// Ways in which the tips may belong together, the likeliest first: as the map has them, and with
/// one pair more or less, two of them swapped, or one exchanged.
std::vector<Tips> tip_variants(const Shapes& shapes, const Trial& trial,
                               const ExtremityOptions& options) {
    const CoarseShape there = moved(shapes.thin_target, trial.alignment);
    const Registration& r = trial.registration;
    const auto count = [](const std::vector<Extremity>& tips) {
        return static_cast<Index>(tips.size());
    };
    const auto node = [](const CoarseShape& shape, const Extremity& tip) {
        return shape.levels.front().point_nodes[at(tip.point)][0];
    };
    // How far the map leaves tips apart, how differently far apart they are along both shapes, and
    // a price for those left alone.
    const auto cost = [&](const Tips& pairs) {
        constexpr double kAlone = 0.2;
        const double alone =
            static_cast<double>(std::min(shapes.source_tips.size(), shapes.target_tips.size())) -
            static_cast<double>(pairs.size());
        double sum = kAlone * alone;
        for (const IndexPair& p : pairs) {
            const Extremity &s = shapes.source_tips[at(p.source)],
                            &t = shapes.target_tips[at(p.target)];
            sum += 0.5 *
                   ((r.source_points.positions.row(s.point) - there.positions.row(t.point)).norm() +
                    (r.target_points.positions.row(t.point) -
                     shapes.thin_source.positions.row(s.point))
                        .norm());
            double other = 0.0;
            for (const IndexPair& q : pairs)
                other += std::abs(shapes.distances[0](
                                      node(shapes.thin_source, s),
                                      node(shapes.thin_source, shapes.source_tips[at(q.source)])) -
                                  shapes.distances[1](
                                      node(shapes.thin_target, t),
                                      node(shapes.thin_target, shapes.target_tips[at(q.target)])));
            sum += other / static_cast<double>(pairs.size());
        }
        return sum / (alone + static_cast<double>(pairs.size()));
    };
    Tips now;
    for (const ExtremityPair& p : paired_extremities(
             shapes.thin_source, there, r.source_points.positions, r.target_points.positions,
             shapes.source_tips, shapes.target_tips, options))
        now.push_back({p.source, p.target});
    if (now.size() < 2) return {};
    std::vector<Index> free_source, free_target;
    for (Index k = 0; k < count(shapes.source_tips); ++k)
        if (std::ranges::find(now, k, &IndexPair::source) == now.end()) free_source.push_back(k);
    for (Index k = 0; k < count(shapes.target_tips); ++k)
        if (std::ranges::find(now, k, &IndexPair::target) == now.end()) free_target.push_back(k);

    std::vector<std::pair<double, Tips>> variants;
    const auto add = [&](Tips tips) {
        std::ranges::sort(tips);
        const double its_cost = cost(tips);
        variants.emplace_back(its_cost, std::move(tips));
    };
    const auto changed = [&](std::size_t i, IndexPair pair) {
        Tips other = now;
        other[i] = pair;
        return other;
    };
    for (const Index s : free_source)
        for (const Index t : free_target) {
            Tips more = now;
            more.push_back({s, t});
            add(std::move(more));
        }
    for (std::size_t i = 0; i < now.size(); ++i) {
        for (std::size_t j = 0; j < i; ++j) {
            Tips swapped = now;
            std::swap(swapped[i].target, swapped[j].target);
            add(std::move(swapped));
        }
        for (const Index t : free_target) add(changed(i, {now[i].source, t}));
        for (const Index s : free_source) add(changed(i, {s, now[i].target}));
        if (now.size() > 2) {
            Tips fewer = now;
            fewer.erase(fewer.begin() + static_cast<std::ptrdiff_t>(i));
            add(std::move(fewer));
        }
    }
    std::ranges::stable_sort(variants, {}, &std::pair<double, Tips>::first);
    std::vector<Tips> result{std::move(now)};
    for (auto& variant : variants) result.push_back(std::move(variant.second));
    return result;
}

/// The pose that makes a map turn as little as it can.
Similarity implied(const Positions& source, const Positions& images, const Similarity& alignment) {
    const Similarity fit = fit_similarity(source, images);
    return composed(turn_about(fit.rotation.transpose(), images.colwise().mean().transpose(),
                               source.colwise().mean().transpose()),
                    alignment);
}

Similarity implied(const Shapes& shapes, const Trial& trial) {
    return implied(shapes.thin_source.positions, trial.registration.source_points.positions,
                   trial.alignment);
}

bool is_as_given(const Similarity& implied_alignment, const PoseOptions& options) {
    return Eigen::AngleAxisd(implied_alignment.rotation).angle() < options.as_given_turn;
}

/// The finest level, from a trial's map.
Candidate continued(const Shapes& shapes, const Trial& trial, const PoseOptions& options,
                    const RegistrationOptions& registration) {
    Progress silent;
    const CoarseShape there = moved(shapes.target, trial.alignment);
    const Registration relaxed = register_level(
        shapes.source, there, 0, shapes.features,
        {deformed(shapes.source.positions, shapes.source.normals, shapes.source.levels.front(),
                  trial.registration.source)
             .positions,
         deformed(there.positions, there.normals, there.levels.front(), trial.registration.target)
             .positions},
        options.relaxation, registration, silent);
    Candidate result{
        trial.alignment,
        register_shapes(shapes.source, there, shapes.features,
                        {relaxed.source_points.positions, relaxed.target_points.positions},
                        registration, silent, 1),
        {}};
    const auto finest = static_cast<Index>(shapes.source.levels.size()) - 1;
    result.misfit = registration_misfit(shapes.source, there, finest, result.registration,
                                        shapes.distances, registration, silent);
    return result;
}

/// Margin, where there are rivals, and confidence of the best map.
void rate(Pose& pose) {
    const double energy = pose.best.misfit.energy();
    const auto at_rest = [](const Candidate& c) {
        return c.alignment.inverse().apply(c.registration.source_points.positions);
    };
    std::vector<Competitor> competitors;
    for (const Candidate& rival : pose.rivals)
        competitors.push_back({rival.misfit.energy() / energy,
                               (at_rest(rival) - at_rest(pose.best)).rowwise().norm().mean()});
    if (!competitors.empty()) pose.margin = competitors.front().ratio;
    pose.confidence = pose_confidence(pose.best.misfit, competitors);
}

}  // namespace

CoarseShape moved(const CoarseShape& shape, const Similarity& move) {
    CoarseShape result = shape;
    result.positions = move.apply(shape.positions);
    result.normals = move.turn(shape.normals);
    result.guides.places = move.apply(shape.guides.places);
    return result;
}

double pose_confidence(const Misfit& misfit, std::span<const Competitor> competitors) {
    constexpr double kPlain = 3.4, kOpposed = 20.0, kEnergy = 20.0, kApart = 0.15;
    double others = 0.0;
    for (const Competitor& other : competitors)
        others +=
            std::min(other.distance / kApart, 1.0) * std::pow(std::max(other.ratio, 0.5), -kEnergy);
    const double alone = 1.0 / (1.0 + std::exp(kOpposed * std::sqrt(misfit.opposed) - kPlain));
    return alone / (1.0 + others);
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
    poses.push_back(turn_about(Matrix3::Identity(), t.center, s.center));
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
    Pose result;
    NodeDistances distances = node_distances(source, target);
    result.source_tips = extremities(source, distances[0], options.extremities);
    result.target_tips = extremities(target, distances[1], options.extremities);
    Shapes shapes{source,
                  target,
                  thinned(source, result.source_tips, options.points, progress),
                  thinned(target, result.target_tips, options.points, progress),
                  std::move(distances),
                  result.source_tips,
                  result.target_tips,
                  features};
    const auto to_thin = [](const CoarseShape& thin, std::vector<Extremity>& tips) {
        for (Extremity& tip : tips)
            tip.point =
                static_cast<Index>(std::ranges::find(thin.rows, tip.point) - thin.rows.begin());
    };
    to_thin(shapes.thin_source, shapes.source_tips);
    to_thin(shapes.thin_target, shapes.target_tips);

    std::vector<TrialStart> starts;
    for (const Similarity& pose : candidate_poses(source, target, features, options))
        starts.push_back({pose, {}});
    std::vector<Trial> trials;
    try_poses(shapes, starts, options, registration, trials, progress, 0.0, 0.2);

    starts.clear();
    const PrincipalFrame frame = principal_frame(source);
    for (std::size_t k = 0; k < trials.size() && k < at(options.finalists); ++k) {
        const Similarity base = implied(shapes, trials[k]);
        starts.push_back({base, {}});
        if (k > 0) continue;
        for (int axis = 0; axis < 3; ++axis)
            for (const double angle : {-options.swing, options.swing}) {
                const Matrix3 turn =
                    Eigen::AngleAxisd(angle, frame.axes.col(axis)).toRotationMatrix();
                starts.push_back(
                    {composed(turn_about(turn, frame.center, frame.center), base), {}});
            }
    }
    try_poses(shapes, starts, options, registration, trials, progress, 0.2, 0.4);

    // The best, the best of those that leave the shapes as given, and the best that lays them onto
    // each other quite another way.
    const auto bases = [&](std::size_t count) {
        constexpr double kAnotherWay = 0.2;
        std::vector<std::size_t> chosen;
        bool given = false, another = false;
        for (std::size_t k = 0; k < trials.size(); ++k) {
            if (trials[k].energy > options.hopeful * trials.front().energy) break;
            const bool lies = is_as_given(implied(shapes, trials[k]), options);
            const bool turns = difference(trials[k], trials.front()) > kAnotherWay;
            if (chosen.size() < count || (lies && !given) || (turns && !another))
                chosen.push_back(k);
            given = given || lies;
            another = another || turns;
        }
        return chosen;
    };
    std::vector<Tips> tried;
    for (Index round = 0; round < options.tip_rounds; ++round) {
        starts.clear();
        for (const std::size_t k : bases(2)) {
            Index count = 0;
            for (Tips& tips : tip_variants(shapes, trials[k], options.extremities)) {
                if (count == options.variants) break;
                if (std::ranges::find(tried, tips) != tried.end()) continue;
                ++count;
                starts.push_back({implied(shapes, trials[k]), tips});
                tried.push_back(std::move(tips));
            }
        }
        const double before = trials.front().energy;
        const double share = 0.4 / std::max<Index>(options.tip_rounds, 1);
        try_poses(shapes, starts, options, registration, trials, progress, 0.4 + round * share,
                  0.4 + (round + 1) * share);
        if (!(trials.front().energy < before)) break;
    }

    const std::vector<std::size_t> last = bases(at(std::max<Index>(options.finalists, 1)));
    std::vector<Candidate> finals(last.size());
    parallel_for(
        static_cast<Index>(last.size()), progress,
        [&](Index begin, Index end) {
            for (Index k = begin; k < end; ++k)
                finals[at(k)] = continued(shapes, trials[last[at(k)]], options, registration);
        },
        0.8, 1.0, 1);
    const auto energy = [](const Candidate& c) { return c.misfit.energy(); };
    std::ranges::stable_sort(finals, {}, energy);
    const auto given = std::ranges::find_if(finals, [&](const Candidate& c) {
        return energy(c) <= options.as_given * energy(finals.front()) &&
               is_as_given(
                   implied(source.positions, c.registration.source_points.positions, c.alignment),
                   options);
    });
    if (given != finals.end()) std::rotate(finals.begin(), given, given + 1);
    keep_distinct(finals, options.distinct);
    result.best = std::move(finals.front());
    result.rivals.assign(std::make_move_iterator(finals.begin() + 1),
                         std::make_move_iterator(finals.end()));
    if (trials.size() > 1) result.margin = std::max(1.0, trials[1].energy / trials[0].energy);
    rate(result);
    return result;
}

void replace_best(Pose& pose, Registration registration, const CoarseShape& source,
                  const CoarseShape& target, const PoseOptions& options,
                  const RegistrationOptions& registration_options, Progress& progress) {
    const auto finest = static_cast<Index>(source.levels.size()) - 1;
    pose.best.registration = std::move(registration);
    pose.best.misfit =
        registration_misfit(source, target, finest, pose.best.registration,
                            node_distances(source, target), registration_options, progress);
    std::erase_if(pose.rivals, [&](const Candidate& rival) {
        return difference(rival, pose.best) < options.distinct;
    });
    rate(pose);
}

}  // namespace pointmorph

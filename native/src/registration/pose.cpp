#include "pointmorph/registration/pose.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "pointmorph/registration/anchored_start.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "registration/pose_trials.hpp"
#include "registration/tip_variants.hpp"

namespace pointmorph {

namespace {

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
                pose.rotation * places.target.row(k).transpose() - pose.translation)
                   .squaredNorm();
    return places.source.rows() == 0 ? 0.0
                                     : std::sqrt(sum / static_cast<double>(places.source.rows()));
}

bool is_as_given(const Similarity& implied_alignment, const PoseOptions& options) {
    return Eigen::AngleAxisd(implied_alignment.rotation).angle() < options.as_given_turn;
}

/// Turns to either side about the shape's principal axes.
std::vector<Similarity> swings(const CoarseShape& shape, double angle) {
    const PrincipalFrame frame = principal_frame(shape);
    std::vector<Similarity> result;
    for (int axis = 0; axis < 3; ++axis)
        for (const double turn : {-angle, angle})
            result.push_back(
                turn_about(Eigen::AngleAxisd(turn, frame.axes.col(axis)).toRotationMatrix(),
                           frame.center, frame.center));
    return result;
}

/// Of sorted trials the best `count`, the best of those that leave the shapes as given, and up to
/// `options.other_ways` that lay them onto each other quite another way, but none that is worse
/// than the best by more than `factor`.
std::vector<Trial> hopeful(const PoseSearch& search, const std::vector<Trial>& trials, Index count,
                           double factor) {
    std::vector<Trial> chosen;
    bool given = false;
    Index others = 0;
    for (const Trial& trial : trials) {
        if (trial.energy > factor * trials.front().energy) break;
        const bool lies = is_as_given(implied_pose(search, trial), search.options);
        const bool turns = std::ranges::all_of(
            chosen, [&](const Trial& other) { return difference(trial, other) > kAnotherWay; });
        const bool another = turns && !chosen.empty() && others < search.options.other_ways;
        if (static_cast<Index>(chosen.size()) < count || (lies && !given) || another)
            chosen.push_back(trial);
        given = given || lies;
        others += another;
    }
    return chosen;
}

/// Varies how the tips are paired under the best trials, in turn, and adds what comes out to them.
/// `tried` holds what needn't be tried again.
void try_tips(const PoseSearch& search, const PoseEffort& effort, std::vector<Trial>& trials,
              std::vector<Tips>& tried, Progress& progress, double first, double last) {
    const PoseOptions& options = search.options;
    const double share = (last - first) / std::max<Index>(effort.rounds, 1);
    for (Index round = 0; round < effort.rounds; ++round) {
        std::vector<Way> ways = ways_of(trials, effort.hopeful, options.other_ways);
        std::erase_if(ways, [&](const Way& way) {
            return way.front()->energy > options.contending * trials.front().energy;
        });
        // Where one way doesn't stand out, each is looked at more closely.
        const Index variants = (ways.size() > 1 ? 2 : 1) * effort.variants;
        std::vector<TrialStart> starts;
        const auto vary = [&](const Trial& trial) {
            Index count = 0;
            for (Tips& tips : tip_variants(search, trial)) {
                if (count == variants) break;
                if (std::ranges::find(tried, tips) != tried.end()) continue;
                ++count;
                const Similarity pose = implied_pose(search, trial);
                starts.push_back({pose, tips});
                // Each costs as much as another variant: the likeliest is worth it.
                if (count == 1 && anchors(search, tips).size() >= kFewestAnchors)
                    starts.push_back({pose, tips, true});
                tried.push_back(std::move(tips));
            }
        };
        for (const Way& way : ways)
            for (const Trial* trial : way) vary(*trial);
        const double before = trials.front().energy;
        try_starts(search, starts, trials, progress, first + round * share,
                   first + (round + 1) * share);
        if (!(trials.front().energy < before)) break;
    }
}

/// Registers the best trials for longer, and takes the best of those to the finest level, into
/// `finals`, which are sorted; `contenders` are those that have been there, which aren't taken
/// again.
void try_finals(const PoseSearch& search, const PoseEffort& effort,
                const std::vector<Trial>& trials, std::vector<Trial>& contenders,
                std::vector<Candidate>& finals, Progress& progress, double first, double last) {
    const PoseOptions& options = search.options;
    const double middle = 0.5 * (first + last);
    std::vector<Trial> longer =
        relaxed(search, hopeful(search, trials, options.semifinalists, effort.hopeful), progress,
                first, middle);
    const double best = longer.front().energy;
    std::erase_if(longer, [&](const Trial& trial) {
        return trial.energy > options.contending * best ||
               std::ranges::any_of(contenders, [&](const Trial& other) {
                   return difference(trial, other) < options.same;
               });
    });
    if (longer.empty()) return;
    const std::vector<Trial> chosen =
        hopeful(search, longer, std::max<Index>(options.finalists, 1), options.contending);
    contenders.insert(contenders.end(), chosen.begin(), chosen.end());
    for (Candidate& candidate : continued(search, chosen, progress, middle, last))
        finals.push_back(std::move(candidate));
    std::ranges::stable_sort(finals, {}, &Candidate::cost);
}

bool looks_wrong(const PoseSearch& search, const Candidate& map) {
    return map.misfit.opposed > search.options.backs || map.torn > search.registration.most_torn;
}

/// Margin, where there are rivals, and confidence of the best map.
void rate(Pose& pose) {
    const auto at_rest = [](const Candidate& c) {
        return c.alignment.inverse().apply(c.registration.source_points.positions);
    };
    std::vector<Competitor> competitors;
    for (const Candidate& rival : pose.rivals)
        competitors.push_back({rival.cost / pose.best.cost,
                               (at_rest(rival) - at_rest(pose.best)).rowwise().norm().mean()});
    if (!competitors.empty()) pose.margin = competitors.front().ratio;
    pose.confidence = pose_confidence(pose.best.misfit, competitors);
}

}  // namespace

CoarseShape moved(const CoarseShape& shape, const Similarity& move) {
    CoarseShape result = shape;
    result.positions = move.apply(shape.positions);
    result.normals = move.rotated(shape.normals);
    result.guides.places = move.apply(shape.guides.places);
    return result;
}

double pose_confidence(const Misfit& misfit, std::span<const Competitor> competitors) {
    constexpr double kPlain = 4.5, kOpposed = 20.0, kCost = 40.0, kApart = 0.15;
    double others = 0.0;
    for (const Competitor& other : competitors)
        others += std::pow(std::min(other.distance / kApart, 1.0), 1.5) *
                  std::pow(std::max(other.ratio, 0.5), -kCost);
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
            const double a = s.spreads[k] + 1e-9, b = t.spreads[order[to_size(k)]] + 1e-9;
            alike = alike && std::max(a / b, b / a) <= options.spread_ratio;
        }
        if (!alike && !std::ranges::is_sorted(order)) continue;  // like to like is always tried
        for (int signs = 0; signs < 8; ++signs) {
            Matrix3 axes;
            for (int k = 0; k < 3; ++k)
                axes.col(k) = (signs >> k & 1 ? -1.0 : 1.0) * t.axes.col(order[to_size(k)]);
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
    PoseSearch search{thinned_shape(source, result.source_tips, options.points, progress),
                      thinned_shape(target, result.target_tips, options.points, progress),
                      std::move(distances),
                      {},
                      features,
                      options,
                      registration};
    if (options.symmetry.weight > 0.0)
        search.symmetries = {reflection_symmetry(search.source.thin, search.distances[0], options,
                                                 registration, progress, 0.0, 0.05),
                             reflection_symmetry(search.target.thin, search.distances[1], options,
                                                 registration, progress, 0.05, 0.1)};

    std::vector<TrialStart> starts;
    for (const Similarity& pose : candidate_poses(source, target, features, options))
        starts.push_back({pose, {}});
    std::vector<Trial> trials;
    try_starts(search, starts, trials, progress, 0.1, 0.25);

    starts.clear();
    for (const Way& way : ways_of(trials, options.effort.hopeful, options.other_ways)) {
        for (const Trial* trial : way) starts.push_back({implied_pose(search, *trial), {}});
        for (const Similarity& turn : swings(source, options.swing))
            starts.push_back({composed(turn, implied_pose(search, *way.front())), {}});
    }
    try_starts(search, starts, trials, progress, 0.25, 0.4);

    std::vector<Tips> tried;
    try_tips(search, options.effort, trials, tried, progress, 0.4, 0.65);
    std::vector<Trial> contenders;
    std::vector<Candidate> best;
    try_finals(search, options.effort, trials, contenders, best, progress, 0.65, 0.8);
    if (looks_wrong(search, best.front())) {
        try_tips(search, options.second_effort, trials, tried, progress, 0.8, 0.95);
        try_finals(search, options.second_effort, trials, contenders, best, progress, 0.95, 1.0);
    }
    const double least_energy = std::ranges::min_element(best, {}, &Candidate::energy)->energy;
    const auto given = std::ranges::find_if(best, [&](const Candidate& c) {
        return c.cost <= options.as_given * best.front().cost &&
               c.energy <= options.as_given * least_energy &&
               is_as_given(implied_pose(source.positions, c.registration.source_points.positions,
                                        c.alignment),
                           options);
    });
    if (given != best.end()) std::rotate(best.begin(), given, given + 1);
    keep_distinct(best, options.distinct);
    result.best = std::move(best.front());
    result.rivals.assign(std::make_move_iterator(best.begin() + 1),
                         std::make_move_iterator(best.end()));
    if (trials.size() > 1) result.margin = std::max(1.0, trials[1].energy / trials[0].energy);
    rate(result);
    return result;
}

}  // namespace pointmorph

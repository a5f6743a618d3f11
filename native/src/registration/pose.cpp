#include "pointmorph/registration/pose.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <iterator>
#include <optional>
#include <utility>

#include "base/angle.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/registration/anchored_start.hpp"
#include "pointmorph/registration/candidate_poses.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "registration/extremity_variants.hpp"
#include "registration/likeness.hpp"
#include "registration/pose_rating.hpp"
#include "registration/pose_trials.hpp"
#include "registration/rolls.hpp"
#include "registration/self_motions.hpp"

namespace pointmorph {

namespace {

bool is_as_given(const Similarity& implied_alignment, const PoseOptions& options) {
    return angle_axis(implied_alignment.rotation).angle() < options.as_given_angle;
}

/// What the search works on: the shapes thinned, with their extremities and symmetries.
PoseSearch prepared_search(const CoarsePair& shapes, const PoseOptions& options,
                           const RegistrationOptions& registration, Progress& progress) {
    NodeDistances distances = node_distances(shapes.source, shapes.target);
    std::optional<FormRadii> radii;
    if (options.likeness > 0.0) radii = form_radii(shapes.source, shapes.target);
    std::array<std::optional<ThinnedShape>, 2> thinned;
    parallel_invoke(2, [&](int k, bool) {
        Progress silent;  // it takes no time
        const CoarseShape& shape = k == 0 ? shapes.source : shapes.target;
        ThinnedShape& its = thinned[to_size(k)].emplace(
            thinned_shape(shape, extremities(shape, distances[to_size(k)], options.extremities),
                          options.points, silent));
        if (radii) its.forms = local_forms(shape, its.full_rows, *radii);
    });
    PoseSearch search{std::move(*thinned[0]),
                      std::move(*thinned[1]),
                      std::move(distances),
                      {},
                      shapes.features,
                      options,
                      registration};
    if (radii) make_comparable(search.source.forms, search.target.forms);
    if (!(options.symmetry.weight > 0.0)) return search;
    const auto symmetry = [&](const ThinnedShape& shape, const Eigen::MatrixXd& its_distances,
                              Progress& its) {
        return reflection_symmetry(shape.thin, its_distances, options, registration, its);
    };
    on_both(progress, [&](bool is_source, Progress& its) {
        const std::size_t k = is_source ? 0 : 1;
        search.symmetries[k] =
            symmetry(is_source ? search.source : search.target, search.distances[k], its);
    });
    return search;
}

/// What first_trials() has found.
struct FirstTrials {
    std::vector<Trial> trials;        ///< sorted
    std::vector<SelfMotion> motions;  ///< under which the shapes look the same
};

/// Whether a trial is worse than the best of them, which are sorted, by no more than a factor.
bool is_within(double factor, const Trial& trial, const std::vector<Trial>& trials) {
    return trial.energy <= factor * trials.front().energy;
}

/// Half turns that take a shape close to itself, but not onto itself.
std::vector<Similarity> mistakable(const CoarseShape& shape, const SelfMotions& motions) {
    std::vector<Similarity> turns = half_turns(shape);
    std::erase_if(turns, [&](const Similarity& turn) { return motions.keep(turn); });
    return turns;
}

/// What the poses of maps become by the half turns of the source, and of the target. None near one
/// of `tried`, and none that contradicts the features.
std::vector<TrialStart> half_turned(const PoseSearch& search, const std::vector<Similarity>& poses,
                                    const std::array<std::vector<Similarity>, 2>& turns,
                                    const std::vector<TrialStart>& tried) {
    constexpr double kNear = 0.17;  // radians
    const CoarsePair thin{search.source.thin, search.target.thin, search.features};
    const auto& [of_source, of_target] = turns;
    std::vector<TrialStart> starts;
    for (const Similarity& pose : poses) {
        std::vector<Similarity> turned{pose};
        for (const Similarity& turn : of_source) turned.push_back(composed(turn, pose));
        for (const Similarity& turn : of_target) turned.push_back(composed(pose, turn));
        for (const Similarity& its :
             agreeing_with_features(thin, std::move(turned), search.options)) {
            const auto is_near = [&](const TrialStart& start) {
                const Matrix3 between = its.rotation * start.alignment.rotation.transpose();
                return angle_axis(between).angle() < kNear;
            };
            if (std::ranges::none_of(tried, is_near) && std::ranges::none_of(starts, is_near))
                starts.push_back({its, {}});
        }
    }
    return starts;
}

/// Places of the extremities that belong together, on the source or the target.
Positions places_of(const ThinnedShape& shape, const ExtremityMatches& matches,
                    Index IndexPair::*side) {
    std::vector<Index> rows;
    for (const IndexPair& match : matches)
        rows.push_back(shape.extremities[to_size(match.*side)].point);
    return gather(shape.thin.positions, rows);
}

/// From where the extremities lie closest to each other once pairs of them have changed places, as
/// both hands and both feet where a map takes a person's chest to the other's back.
std::vector<TrialStart> exchanged(const PoseSearch& search,
                                  const std::vector<PoseCluster>& clusters) {
    constexpr std::size_t kOfEach = 2;
    const NodeDistances along = distances_between_extremities(search);
    std::vector<TrialStart> starts;
    for (const PoseCluster& cluster : clusters)
        for (ExtremityMatches& matches :
             exchanged_pairings(matches_under(search, *cluster.front()), along, kOfEach)) {
            if (std::ranges::find(starts, matches, &TrialStart::extremities) != starts.end())
                continue;
            const Similarity pose =
                fit_rigid_motion(places_of(search.target, matches, &IndexPair::target),
                                 places_of(search.source, matches, &IndexPair::source));
            const bool is_anchored = anchors(search, matches).size() >= kFewestAnchors;
            starts.push_back({pose, matches});
            if (is_anchored) starts.push_back({pose, std::move(matches), StartPlaces::kAnchored});
        }
    return starts;
}

/// Adds maps that see the shapes from another side than those of `trials`: from half a turn away,
/// and with pairs of extremities exchanged. Only those that may become the best, and that nothing
/// like and no worse has been found of. Where the principal axes of a person with raised arms lie
/// askew, no other trial starts in front of it.
void try_other_sides(const PoseSearch& search, const std::array<std::vector<Similarity>, 2>& turns,
                     std::vector<TrialStart> tried, std::vector<Trial>& trials,
                     Progress& progress) {
    const double factor = search.options.varied_factor;
    const std::vector<PoseCluster> clusters =
        pose_clusters(trials, search.options.contender_factor, search.options.other_clusters);
    std::vector<Similarity> poses;
    for (const PoseCluster& cluster : clusters)
        poses.push_back(implied_pose(search, *cluster.front()));
    for (const Similarity& pose : poses) tried.push_back({pose, {}});
    std::vector<TrialStart> starts = half_turned(search, poses, turns, tried);
    std::ranges::move(exchanged(search, clusters), std::back_inserter(starts));
    std::vector<Trial> found;
    try_starts(search, starts, found, progress);
    std::erase_if(found, [&](const Trial& trial) {
        return !is_within(factor, trial, trials) ||
               std::ranges::any_of(trials, [&](const Trial& other) {
                   return other.energy <= trial.energy && difference(trial, other) <= kOtherCluster;
               });
    });
    std::ranges::move(found, std::back_inserter(trials));
    std::ranges::stable_sort(trials, {}, &Trial::energy);
}

/// Maps from every candidate pose; then from where the best of them lie, and, of those that
/// contend, tilted from there and seen from other sides. What the shapes' own symmetries make of a
/// candidate, tilt or half turn that is tried isn't tried.
FirstTrials first_trials(const PoseSearch& search, const CoarsePair& shapes, Progress& progress) {
    // A person whose arms are raised and lie along the sides on the other shape fits as badly at
    // first where head and front are right, but not from where that map lies.
    constexpr double kWorthAnother = 2.5;
    const PoseOptions& options = search.options;
    const SelfMotions source(shapes.source, search.source.full_rows),
        target(shapes.target, search.target.full_rows);
    DistinctPoses distinct{candidate_poses(shapes, options), {}};
    if (!search.has_marks()) distinct = distinct_poses(distinct.poses, source, target);
    FirstTrials first{{}, std::move(distinct.motions)};
    std::vector<TrialStart> starts;
    for (const Similarity& pose : distinct.poses) starts.push_back({pose, {}});
    in_part(progress, 0.0, 0.5,
            [&] { try_starts(search, starts, first.trials, progress, kWorthAnother); });

    const std::vector<TrialStart> candidates = std::exchange(starts, {});
    const double promising = options.effort.promising * first.trials.front().energy;
    for (const PoseCluster& cluster :
         pose_clusters(first.trials, kWorthAnother, options.other_clusters)) {
        for (const Trial* trial : cluster)
            if (trial == cluster.front() || trial->energy <= promising)
                starts.push_back({implied_pose(search, *trial), {}});
        if (!is_within(options.contender_factor, *cluster.front(), first.trials)) continue;
        const Similarity pose = implied_pose(search, *cluster.front());
        for (const Similarity& tilt : tilts(shapes.source, options.tilt))
            if (search.has_marks() ||
                !(source.keep(tilt) || target.keep(composed(pose.inverse(), composed(tilt, pose)))))
                starts.push_back({composed(tilt, pose), {}});
    }
    in_part(progress, 0.5, 0.9, [&] { try_starts(search, starts, first.trials, progress); });
    std::array<std::vector<Similarity>, 2> turns;
    in_part(progress, 0.9, 0.92, [&] {
        on_both(progress, [&](bool is_source, Progress&) {
            turns[is_source ? 0 : 1] = is_source ? mistakable(search.source.thin, source)
                                                 : mistakable(search.target.thin, target);
        });
    });
    in_part(progress, 0.92, 1.0,
            [&] { try_other_sides(search, turns, candidates, first.trials, progress); });
    return first;
}

/// Adds what comes of laying unlike shapes onto each other as they were given, each all over the
/// other: no other trial may leave them so, as rotated they fit better.
void try_as_given(const PoseSearch& search, std::vector<Trial>& trials, Progress& progress) {
    const Vector3 to = search.source.thin.positions.colwise().mean().transpose(),
                  from = search.target.thin.positions.colwise().mean().transpose();
    try_starts(search, {{{1.0, Matrix3::Identity(), to - from}, {}, StartPlaces::kTransported}},
               trials, progress);
}

/// Of sorted trials the best `count`, the best of those that leave the shapes as given, and up to
/// `options.other_clusters` of other clusters, but none that is worse than the best by more than
/// `factor`, except that as given where shapes are unlike and it's known what is up.
std::vector<Trial> promising(const PoseSearch& search, const std::vector<Trial>& trials,
                             Index count, double factor) {
    std::vector<Trial> chosen;
    // What faces another way costs little more, and trials of unlike shapes tell little.
    const bool keeps_as_given = search.unlike > 0.0 && search.options.up != UpAxis::kNone;
    bool has_as_given = false;
    Index others = 0;
    for (const Trial& trial : trials) {
        const bool is_near = trial.energy <= factor * trials.front().energy;
        if (!is_near && (has_as_given || !keeps_as_given)) break;
        const bool as_given = is_as_given(implied_pose(search, trial), search.options);
        if (!is_near && !as_given) continue;
        const bool is_apart = std::ranges::all_of(
            chosen, [&](const Trial& other) { return difference(trial, other) > kOtherCluster; });
        const bool is_other = is_apart && !chosen.empty() && others < search.options.other_clusters;
        if (to_index(chosen.size()) < count || (as_given && !has_as_given) || is_other)
            chosen.push_back(trial);
        has_as_given = has_as_given || as_given;
        others += is_other;
    }
    return chosen;
}

/// Starts with the extremities paired otherwise than under the best trials. `tried` holds what
/// needn't be tried again.
std::vector<TrialStart> varied_starts(const PoseSearch& search, const PoseEffort& effort,
                                      const std::vector<Trial>& trials,
                                      std::vector<ExtremityMatches>& tried) {
    const PoseOptions& options = search.options;
    std::vector<PoseCluster> clusters =
        pose_clusters(trials, effort.promising, options.other_clusters);
    std::erase_if(clusters, [&](const PoseCluster& cluster) {
        return !is_within(options.varied_factor, *cluster.front(), trials);
    });
    std::vector<TrialStart> starts;
    const auto vary = [&](const Trial& trial) {
        Index count = 0;
        for (ExtremityMatches& matches : extremity_variants(search, trial)) {
            if (count == effort.variants) break;
            if (std::ranges::find(tried, matches) != tried.end()) continue;
            ++count;
            const Similarity pose = implied_pose(search, trial);
            starts.push_back({pose, matches});
            // Each costs as much as another variant: the likeliest is worth it.
            if (count == 1 && anchors(search, matches).size() >= kFewestAnchors)
                starts.push_back({pose, matches, StartPlaces::kAnchored});
            tried.push_back(std::move(matches));
        }
    };
    for (const PoseCluster& cluster : clusters)
        for (const Trial* trial : cluster) vary(*trial);
    return starts;
}

/// Varies how the extremities are paired under the best trials, in turn, and adds what comes out to
/// them.
void vary_extremities(const PoseSearch& search, const PoseEffort& effort,
                      std::vector<Trial>& trials, std::vector<ExtremityMatches>& tried,
                      Progress& progress) {
    const double share = 1.0 / std::max<Index>(effort.rounds, 1);
    for (Index round = 0; round < effort.rounds; ++round) {
        const std::vector<TrialStart> starts = varied_starts(search, effort, trials, tried);
        const double before = trials.front().energy;
        in_part(progress, round * share, (round + 1) * share,
                [&] { try_starts(search, starts, trials, progress); });
        if (!(trials.front().energy < before)) break;
    }
}

/// What the search has come to so far.
struct Finals {
    std::vector<Trial> contenders;    ///< registered for longer
    std::vector<Candidate> finished;  ///< those of them at the finest level, sorted
    std::vector<Candidate> relaxed;   ///< the others, with what they cost before that
    double least_relaxed = std::numeric_limits<double>::infinity();  ///< of all, before that
};

/// What raises doubts by less isn't looked at.
constexpr double kLeastDoubt = 0.05;

/// Whether a map that hasn't been to the finest level may win there, or raise doubts about the one
/// that does. `least` is what the best costs before that level. Of 30 searches among animals, none
/// had a winner that cost more than 1.03 times as much there.
bool may_matter(const Candidate& map, const Positions& best_images, double least) {
    constexpr double kMayWin = 1.03;
    constexpr double kMayFall = 0.05;  // by which ratios of costs change there
    const double ratio = map.cost / least;
    const double apart = (images_at_rest(map) - best_images).rowwise().norm().mean();
    return ratio <= kMayWin || doubt_from({std::max(ratio - kMayFall, 1.0), apart}) > kLeastDoubt;
}

/// Registers the best trials for longer, and takes the best of those, but what is tried already,
/// to the finest level.
void try_finals(const PoseSearch& search, const PoseEffort& effort,
                const std::vector<Trial>& trials, Finals& finals, Progress& progress) {
    const PoseOptions& options = search.options;
    std::vector<Trial> longer = in_part(progress, 0.0, 0.4, [&] {
        return relaxed(search, promising(search, trials, options.semifinalists, effort.promising),
                       progress);
    });
    const double best = longer.front().energy;
    std::erase_if(longer, [&](const Trial& trial) {
        return trial.energy > options.contender_factor * best ||
               std::ranges::any_of(finals.contenders, [&](const Trial& other) {
                   return difference(trial, other) < options.same;
               });
    });
    if (longer.empty()) return;
    const std::vector<Trial> chosen =
        promising(search, longer, std::max<Index>(options.finalists, 1), options.contender_factor);
    finals.contenders.insert(finals.contenders.end(), chosen.begin(), chosen.end());
    std::vector<RelaxedMap> maps = in_part(
        progress, 0.4, 0.6, [&] { return relaxed_on_all_points(search, chosen, progress); });
    std::ranges::stable_sort(maps, {}, [](const RelaxedMap& map) { return map.candidate.cost; });
    finals.least_relaxed = std::min(finals.least_relaxed, maps.front().candidate.cost);
    const Positions best_images =
        images_at_rest(finals.finished.empty() ? maps.front().candidate : finals.finished.front());
    std::vector<RelaxedMap> taken;
    for (RelaxedMap& map : maps) {
        const bool is_distinct = std::ranges::all_of(taken, [&](const RelaxedMap& other) {
            return difference(map.candidate, other.candidate) >= options.distinct;
        });
        if (is_distinct && may_matter(map.candidate, best_images, finals.least_relaxed))
            taken.push_back(std::move(map));
        else
            finals.relaxed.push_back(std::move(map.candidate));
    }
    if (taken.empty()) return;
    std::vector<Candidate> added =
        in_part(progress, 0.6, 1.0, [&] { return continued(search, taken, progress); });
    for (Candidate& candidate : added) finals.finished.push_back(std::move(candidate));
    std::ranges::stable_sort(finals.finished, {}, &Candidate::cost);
}

/// All maps, the best first; what hasn't been to the finest level costs as much more there as it
/// does before.
std::vector<Candidate> all_maps(Finals finals) {
    std::vector<Candidate> maps = std::move(finals.finished);
    const double cost = maps.front().cost, energy = maps.front().energy;
    for (Candidate& map : finals.relaxed) {
        const double ratio = map.cost / finals.least_relaxed;
        map.cost = ratio * cost;
        map.energy = ratio * energy;
        maps.push_back(std::move(map));
    }
    std::ranges::stable_sort(maps, {}, &Candidate::cost);
    return maps;
}

/// Adds what the shapes' own symmetries make of the best map: it fits as well. They take the places
/// of other finalists of its pose cluster.
void add_symmetric(const PoseSearch& search, std::span<const SelfMotion> motions,
                   std::vector<Candidate>& maps, Progress& progress) {
    const auto finalists = to_size(search.options.finalists);
    const std::size_t added =
        std::min(finalists + to_size(search.options.other_clusters), motions.size());
    std::vector<Candidate> symmetric =
        with_motions(search, maps.front(), motions.first(added), progress);
    std::size_t left = finalists > added + 1 ? finalists - added - 1 : 0;
    std::vector<Candidate> kept;
    for (Candidate& map : maps)
        if (kept.empty() || added == 0 || difference(map, kept.front()) > kOtherCluster) {
            kept.push_back(std::move(map));
        } else if (left > 0) {
            kept.push_back(std::move(map));
            --left;
        }
    maps = std::move(kept);
    for (Candidate& map : symmetric) maps.push_back(std::move(map));
    std::ranges::stable_sort(maps, {}, &Candidate::cost);
}

/// Adds the best map of long thin shapes, rolled by half a turn about their length where no mark
/// tells. What such a map costs says how either shape happens to be bent, not what is its belly,
/// unless it is much more than what the best one does, as that of feet in the air is.
void add_rolled(const PoseSearch& search, std::vector<Candidate>& maps) {
    constexpr double kBent = 2.0;  // times the best one's cost, for bends and for its rough places
    const CoarseShape &source = search.source.full, &target = search.target.full;
    const auto rolls = half_rolls(source, search.distances[0]);
    if (!rolls || !half_rolls(target, search.distances[1])) return;
    Candidate same = maps.front(), rolled = followed_by_turns(same, source, target, rolls->turns);
    rate(search, same);
    rate(search, rolled);
    if (!(same.cost > 0.0)) return;
    const double ratio = std::max(1.0, rolled.cost / (kBent * same.cost));
    std::vector<Index> features;
    for (const IndexPair& feature : search.features) features.push_back(feature.source);
    Candidate other =
        followed_by_turns(maps.front(), source, target, untold_turns(*rolls, source, features));
    const double apart =
        (images_at_rest(other) - images_at_rest(maps.front())).rowwise().norm().mean();
    if (!(doubt_from({ratio, apart}) > kLeastDoubt)) return;
    const auto found = std::find_if(maps.begin() + 1, maps.end(), [&](const Candidate& map) {
        return difference(map, other) < search.options.distinct;
    });
    double cost = ratio * maps.front().cost, energy = ratio * maps.front().energy;
    if (found != maps.end()) {  // it is less rough
        cost = std::min(cost, found->cost);
        energy = std::min(energy, found->energy);
        other = std::move(*found);
        maps.erase(found);
    }
    other.cost = cost;
    other.energy = energy;
    other.is_rolled = true;
    const auto place =
        std::ranges::lower_bound(maps.begin() + 1, maps.end(), other.cost, {}, &Candidate::cost);
    maps.insert(place, std::move(other));
}

bool looks_wrong(const PoseSearch& search, const Candidate& map) {
    return map.misfit.opposed > search.options.most_opposed ||
           map.torn > search.registration.most_torn;
}

double least_disparity(const std::vector<Candidate>& maps) {
    double least = std::numeric_limits<double>::infinity();
    for (const Candidate& map : maps) least = std::min(least, map.misfit.energy() * map.unlikeness);
    return least;
}

/// Whether the finest maps show that the shapes have much less in common than trials did, whose
/// misfits fall less between such shapes: other trials would have been taken to their end.
bool are_less_alike(const PoseSearch& search, const Finals& finals) {
    constexpr double kMuch = 0.1;
    const double added = added_for_turning(search.options, least_disparity(finals.finished));
    return added > search.unlike + kMuch;
}

/// Extremities of a thinned shape as coarse rows.
std::vector<Extremity> in_full(const ThinnedShape& shape) {
    std::vector<Extremity> result = shape.extremities;
    for (Extremity& extremity : result) extremity.point = shape.full_rows[to_size(extremity.point)];
    return result;
}

}  // namespace

Positions images_at_rest(const Candidate& map) {
    return map.alignment.inverse().apply(map.registration.source_points.positions);
}

Pose find_pose(const CoarsePair& shapes, const PoseOptions& options,
               const RegistrationOptions& registration, Progress& progress) {
    PoseSearch search = in_part(progress, 0.0, 0.1, [&] {
        return prepared_search(shapes, options, registration, progress);
    });
    auto [trials, motions] =
        in_part(progress, 0.1, 0.4, [&] { return first_trials(search, shapes, progress); });
    keep_unlike_as_given(search, least_disparity(search, trials), trials, {});
    const bool has_tried = search.unlike > 0.0;
    if (has_tried) in_part(progress, 0.4, 0.42, [&] { try_as_given(search, trials, progress); });
    std::vector<ExtremityMatches> tried;
    Finals so_far;
    const auto vary = [&](const PoseEffort& effort, Index rounds, double first, double last) {
        in_part(progress, first, last, [&] {
            vary_extremities(search, {effort.variants, rounds, effort.promising}, trials, tried,
                             progress);
        });
    };
    const auto finish = [&](const PoseEffort& effort, double first, double last) {
        in_part(progress, first, last,
                [&] { try_finals(search, effort, trials, so_far, progress); });
    };
    const Index rounds = options.effort.rounds,
                plain = options.likeness > 0.0 ? std::min(options.plain_rounds, rounds) : rounds;
    vary(options.effort, plain, 0.42, 0.5);
    count_likeness(search, trials);
    vary(options.effort, rounds - plain, 0.5, 0.65);
    finish(options.effort, 0.65, 0.75);
    if (are_less_alike(search, so_far)) {
        keep_unlike_as_given(search, least_disparity(so_far.finished), trials, {});
        if (!has_tried)
            in_part(progress, 0.75, 0.76, [&] { try_as_given(search, trials, progress); });
        so_far = {};
        finish(options.effort, 0.76, 0.8);
    }
    if (looks_wrong(search, so_far.finished.front())) {
        vary(options.second_effort, options.second_effort.rounds, 0.8, 0.95);
        finish(options.second_effort, 0.95, 1.0);
    }
    std::vector<Candidate> finals = all_maps(std::move(so_far));
    add_symmetric(search, motions, finals, progress);
    add_rolled(search, finals);
    keep_unlike_as_given(search, least_disparity(finals), trials, finals);
    const std::vector<NodeImages> tried_images = node_images(trials);
    Alternatives alternatives = alternatives_to_first(shapes, finals, tried_images);
    keep_distinct(finals, options.distinct);
    Pose pose = rated(shapes, std::move(finals), tried_images);
    pose.alternatives = std::move(alternatives);
    pose.source_extremities = in_full(search.source);
    pose.target_extremities = in_full(search.target);
    return pose;
}

}  // namespace pointmorph

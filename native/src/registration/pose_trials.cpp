#include "registration/pose_trials.hpp"

#include <limits>
#include <memory>
#include <random>
#include <utility>

#include "base/angle.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/registration/anchored_start.hpp"
#include "pointmorph/registration/misfit.hpp"
#include "pointmorph/registration/thin_plate.hpp"
#include "registration/annealing.hpp"
#include "registration/transported_start.hpp"

namespace pointmorph {

namespace {

/// A shape's points in `rows`, and its coarsest level; without extremities.
ThinnedShape thinned(const CoarseShape& shape, const std::vector<Index>& rows) {
    const DeformationGraph& graph = shape.levels.front();
    ThinnedShape result{shape, {}, {}, rows};
    CoarseShape& thin = result.thin;
    thin.cloud_rows = gather(shape.cloud_rows, rows);
    thin.positions = gather(shape.positions, rows);
    thin.normals = gather(shape.normals, rows);
    thin.areas = Values::Zero(thin.size());
    const KdTree<3>& tree = result.tree.emplace(thin.positions);
    const std::vector<Index> nearest = nearest_rows(tree, shape.positions);
    for (Index i = 0; i < shape.size(); ++i) thin.areas[nearest[to_size(i)]] += shape.areas[i];
    DeformationGraph& level = thin.levels.emplace_back(graph);
    std::iota(level.node_rows.begin(), level.node_rows.end(), 0);
    level.point_nodes = gather(graph.point_nodes, rows);
    level.point_weights = gather(graph.point_weights, rows);
    level.pattern = deformation_pattern(level);
    thin.guides = shape.guides;
    for (Index& row : thin.guides.coarse_rows)
        row =
            nearest_on_sheet(tree, thin.normals, shape.positions.row(row), shape.normals.row(row));
    if (shape.labels.rows() > 0) {
        thin.labels = gather(shape.labels, rows);
        thin.pulls = gather(shape.pulls, rows);
    }
    if (!shape.ends.empty()) thin.ends = gather(shape.ends, rows);
    return result;
}

/// What a map does to the thinned shapes, at rest.
struct BothImages {
    Images source, target;

    BothImages(const PoseSearch& search, const Positions& of_source, const Positions& of_target)
        : source{of_source, nearest_rows(*search.target.tree, of_source)},
          target{of_target, nearest_rows(*search.source.tree, of_target)} {}
};

/// The factor by which a map's energy is larger for the sides that it doesn't treat alike.
double dearer_by_asymmetry(const PoseSearch& search, const BothImages& images) {
    const SymmetryOptions& options = search.options.symmetry;
    return 1.0 + options.weight * asymmetry(search.source.thin, search.target.thin,
                                            search.symmetries, images.source, images.target,
                                            options.far);
}

/// The factor by which a map's energy is larger for taking points to unlike ones.
double dearer_by_unlikeness(const PoseSearch& search, const BothImages& images) {
    const ThinnedShape &source = search.source, &target = search.target;
    const double there =
        unlikeness(source.forms, target.forms, images.source.nearest, target.thin.ends);
    const double back =
        unlikeness(target.forms, source.forms, images.target.nearest, source.thin.ends);
    constexpr double kFloor = 0.1;  // as those of the misfit's terms: none can win alone
    return std::pow(0.5 * (there + back) + kFloor, search.options.likeness);
}

Similarity implied_pose(const PoseSearch& search, const Candidate& map) {
    return implied_pose(search.source.full.positions, map.registration.source_points.positions,
                        map.alignment);
}

/// How far a map rotates the target from how it was given, and how far it tilts it: each up to 1,
/// at PoseOptions::as_given_angle.
struct Turning {
    double turn, tilt;
};

template <class Map>
Turning turning(const PoseSearch& search, const Map& map) {
    const PoseOptions& options = search.options;
    const Matrix3 rotation = implied_pose(search, map).rotation;
    const auto share = [&](double angle) { return std::min(1.0, angle / options.as_given_angle); };
    const double turn = share(angle_axis(rotation).angle());
    if (options.up == UpAxis::kNone) return {turn, turn};
    const Vector3 up = Vector3::Unit(static_cast<int>(options.up) - 1), its = rotation * up;
    // What leans a little stands as well.
    const double tilt = share(angle_of(its.cross(up).norm(), its.dot(up))), square = tilt * tilt;
    return {turn, square * square};
}

/// The factor by which a map's energy is larger for that; `unlike` is as in PoseSearch.
double dearer_by_turning(const PoseOptions& options, double unlike, const Turning& its) {
    const double facing = std::min(unlike, options.facing) * std::max(0.0, its.turn - its.tilt);
    return 1.0 + (options.as_given - 1.0) * its.turn + unlike * its.tilt + facing;
}

template <class Map>
double dearer_by_turning(const PoseSearch& search, const Map& map) {
    return dearer_by_turning(search.options, search.unlike, turning(search, map));
}

double dearer_by_unlikeness(const PoseSearch& search, const Trial& trial) {
    const Registration& its = trial.registration;
    const Positions images = trial.alignment.inverse().apply(its.source_points.positions);
    return dearer_by_unlikeness(search, {search, images, its.target_points.positions});
}

/// A trial at its end, whose energy has been all but for likeness so far.
Trial with_likeness(const PoseSearch& search, Trial trial) {
    if (search.counts_likeness) trial.energy *= dearer_by_unlikeness(search, trial);
    return trial;
}

/// One level of the thinned shapes, the target moved, some rounds at a time.
class OpenTrial {
public:
    OpenTrial(const PoseSearch& search, const Similarity& alignment,
              std::span<const IndexPair> features, const RegistrationStart& start,
              const RegistrationLevel& level, const RegistrationOptions& options)
        : search_(search),
          alignment_(alignment),
          there_(moved(search.target.thin, alignment)),
          features_(features.begin(), features.end()),
          level_(level),
          options_(options),
          shapes_{search.source.thin, there_, features_},
          run_({shapes_, 0, level_, options_}, start, std::mt19937_64(1)) {}
    OpenTrial(const OpenTrial&) = delete;
    OpenTrial& operator=(const OpenTrial&) = delete;

    /// Polls between rounds; throws Cancelled.
    void advance(int rounds, Progress& progress) { run_.advance(rounds, progress); }

    /// The map as far as it has come, with its energy.
    Trial trial() const {
        Progress silent;
        Trial trial{alignment_, run_.result()};
        const Registration& its = trial.registration;
        trial.energy =
            registration_misfit(shapes_, 0, its, search_.distances, search_.registration, silent)
                .energy() *
            dearer_by_turning(search_, trial);
        if (!search_.has_symmetries()) return trial;
        const Positions images = alignment_.inverse().apply(its.source_points.positions);
        trial.energy *=
            dearer_by_asymmetry(search_, {search_, images, its.target_points.positions});
        return trial;
    }

    /// The map at the end of all rounds.
    Trial ended(Progress& progress) {
        advance(run_.rounds(), progress);
        return trial();
    }

private:
    const PoseSearch& search_;
    const Similarity alignment_;
    const CoarseShape there_;
    const std::vector<IndexPair> features_;
    const RegistrationLevel level_;
    const RegistrationOptions& options_;
    const CoarsePair shapes_;
    AnnealingRun run_;
};

/// Where the points of a trial have come to.
RegistrationStart from_there(const Trial& trial) {
    return {trial.registration.source_points.positions, trial.registration.target_points.positions};
}

/// The stiffness at which extremities are let go.
double middle_stiffness(const RegistrationLevel& level) {
    return std::sqrt(level.first_stiffness * level.last_stiffness);
}

/// A trial whose points are where they belong from the start on, at its end.
Trial begun_there(const PoseSearch& search, const TrialStart& start, Progress& progress) {
    RegistrationLevel level = search.options.trial;
    level.stiff_rounds = 0;  // the shapes don't lie alike
    const CoarseShape& source = search.source.thin;
    const CoarseShape there = moved(search.target.thin, start.alignment);
    const RegistrationStart places =
        start.places == StartPlaces::kTransported
            ? transported_start(source, there)
            : anchored_start(source, there, search.distances, anchors(search, start.extremities));
    OpenTrial trial(search, start.alignment, search.features, places, level, search.registration);
    return with_likeness(search, trial.ended(progress));
}

/// Where points start that nothing leads.
RegistrationStart resting(const PoseSearch& search, const Similarity& alignment) {
    const CoarseShape &source = search.source.thin, &target = search.target.thin;
    // Curves and regions have to be brought over; by points alone a plate turns heads.
    return source.guides.size() > 0
               ? thin_plate_start({source, moved(target, alignment), search.features})
               : RegistrationStart{source.positions, alignment.apply(target.positions)};
}

/// A trial halfway, or, where it starts from elsewhere, at its end.
struct Begun {
    std::unique_ptr<OpenTrial> open;  ///< goes on; none where extremities led, which let go now
    Trial trial;
};

Begun begun(const PoseSearch& search, const TrialStart& start, Progress& progress) {
    if (start.places != StartPlaces::kAtRest)
        return {nullptr, begun_there(search, start, progress)};
    const RegistrationStart places = resting(search, start.alignment);
    RegistrationLevel level = search.options.trial;
    if (start.extremities.empty()) {
        auto open = std::make_unique<OpenTrial>(search, start.alignment, search.features, places,
                                                level, search.registration);
        open->advance(level.stiff_rounds + level.rounds / 2, progress);
        Trial trial = open->trial();
        return {std::move(open), std::move(trial)};
    }
    // Extremities lead the way while the shapes are stiff; then the surfaces decide.
    level.rounds /= 2;
    level.last_stiffness = middle_stiffness(search.options.trial);
    RegistrationOptions soft = search.registration;
    soft.feature_weight /= 10.0;
    std::vector<IndexPair> guides(search.features.begin(), search.features.end());
    for (const IndexPair& match : start.extremities)
        guides.push_back({search.source.extremities[to_size(match.source)].point,
                          search.target.extremities[to_size(match.target)].point});
    OpenTrial led(search, start.alignment, guides, places, level, soft);
    return {nullptr, led.ended(progress)};
}

Trial ended(const PoseSearch& search, const Begun& half, Progress& progress) {
    if (half.open) return with_likeness(search, half.open->ended(progress));
    RegistrationLevel level = search.options.trial;
    level.stiff_rounds = 0;
    level.rounds -= level.rounds / 2;
    level.first_stiffness = middle_stiffness(search.options.trial);
    OpenTrial rest(search, half.trial.alignment, search.features, from_there(half.trial), level,
                   search.registration);
    return with_likeness(search, rest.ended(progress));
}

/// `make(given, its)` of all of them, side by side.
template <class Made, class Given, class Make>
std::vector<Made> each(const Given& given, Make&& make, Progress& progress) {
    std::vector<Made> made(given.size());
    parallel_invoke(static_cast<int>(given.size()), progress,
                    [&](int k, Progress& its) { made[to_size(k)] = make(given[to_size(k)], its); });
    return made;
}

void keep_best(std::vector<Trial>& trials, double distinct) {
    std::ranges::stable_sort(trials, {}, &Trial::energy);
    keep_distinct(trials, distinct);
}

/// A trial's map on all points of the coarsest level, carried to the nodes of the finest.
RelaxedMap relaxed_on_all(const PoseSearch& search, const Trial& trial, Progress& progress) {
    const CoarseShape& source = search.source.full;
    const CoarseShape there = moved(search.target.full, trial.alignment);
    const auto all = [](const CoarseShape& shape, const Deformation& deformation) {
        return deformed(shape.positions, shape.normals, shape.levels.front(), deformation)
            .positions;
    };
    const CoarsePair shapes{source, there, search.features};
    Registration coarse = register_level(
        shapes, 0, {all(source, trial.registration.source), all(there, trial.registration.target)},
        search.options.relaxation, search.registration, progress);
    RelaxedMap map;
    map.points = {std::move(coarse.source_points.positions),
                  std::move(coarse.target_points.positions)};
    RegistrationLevel as_it_is = search.options.relaxation;
    as_it_is.stiff_rounds = as_it_is.rounds = 0;
    map.candidate.alignment = trial.alignment;
    map.candidate.registration =
        register_level(shapes, to_index(source.levels.size()) - 1, map.points, as_it_is,
                       search.registration, progress);
    rate(search, map.candidate);
    return map;
}

/// The finest level.
Candidate to_the_finest(const PoseSearch& search, const RelaxedMap& map, Progress& progress) {
    const CoarseShape there = moved(search.target.full, map.candidate.alignment);
    Candidate result{.alignment = map.candidate.alignment,
                     .registration = register_shapes({search.source.full, there, search.features},
                                                     map.points, search.registration, progress, 1)};
    rate(search, result);
    return result;
}

}  // namespace

void rate(const PoseSearch& search, Candidate& map) {
    Progress silent;
    const CoarseShape there = moved(search.target.full, map.alignment);
    const CoarsePair shapes{search.source.full, there, search.features};
    const Registration& its = map.registration;
    map.misfit = registration_misfit(shapes, to_index(there.levels.size()) - 1, its,
                                     search.distances, search.registration, silent);
    map.energy = map.misfit.energy() * dearer_by_turning(search, map);
    if (search.has_symmetries() || search.counts_likeness) {
        const Positions of_source = map.alignment.inverse().apply(
                            gather(its.source_points.positions, search.source.full_rows)),
                        of_target = gather(its.target_points.positions, search.target.full_rows);
        const BothImages images(search, of_source, of_target);
        map.energy *= dearer_by_asymmetry(search, images);
        if (search.counts_likeness) {
            map.unlikeness = dearer_by_unlikeness(search, images);
            map.energy *= map.unlikeness;
        }
    }
    map.torn = torn_share(shapes, its, search.registration, silent);
    map.cost = map.energy * (1.0 + search.options.tear_weight * map.torn);
}

namespace {

Values distances(const Positions& x, const Positions& y) {
    return (x - y).rowwise().norm();
}

}  // namespace

double difference(const NodePlaces& a, const NodePlaces& b) {
    constexpr double kWorst = 0.03, kShare = 0.35;
    const auto apart = [](Values distances) {
        const Eigen::Index count = distances.size();
        const Eigen::Index worst =
            std::max<Eigen::Index>(1, std::lround(kWorst * static_cast<double>(count)));
        const double mean = distances.mean();
        std::nth_element(distances.begin(), distances.begin() + worst - 1, distances.end(),
                         std::greater<>());
        return std::max(mean, kShare * distances.head(worst).mean());
    };
    return std::max(apart(distances(a.source, b.source)), apart(distances(a.target, b.target)));
}

bool differ_by_less(const NodePlaces& a, const NodePlaces& b, double distinct) {
    return distances(a.source, b.source).mean() < distinct &&
           distances(a.target, b.target).mean() < distinct && difference(a, b) < distinct;
}

std::vector<IndexPair> anchors(const PoseSearch& search, const ExtremityMatches& extremities) {
    const ThinnedShape &source = search.source, &target = search.target;
    std::vector<IndexPair> result;
    for (const IndexPair& f : search.features)
        result.push_back({node_at(source, f.source), node_at(target, f.target)});
    for (const IndexPair& match : extremities) {
        const Index s = node_at(source, source.extremities[to_size(match.source)].point),
                    t = node_at(target, target.extremities[to_size(match.target)].point);
        if (std::ranges::none_of(result, [&](const IndexPair& other) {
                return other.source == s || other.target == t;
            }))
            result.push_back({s, t});
    }
    return result;
}

ThinnedShape thinned_shape(const CoarseShape& shape, std::vector<Extremity> extremities,
                           Index points, Progress& progress) {
    std::vector<Index> required = shape.levels.front().node_rows;
    for (const Extremity& extremity : extremities)
        if (std::ranges::find(required, extremity.point) == required.end())
            required.push_back(extremity.point);
    const KdTree<3> tree(shape.positions);
    std::vector<Index> rows =
        poisson_disk_subset(tree, shape.normals, required,
                            std::max(points, to_index(required.size())), progress)
            .rows;
    for (Extremity& extremity : extremities)
        extremity.point = to_index(std::ranges::find(rows, extremity.point) - rows.begin());
    ThinnedShape result = thinned(shape, rows);
    result.extremities = std::move(extremities);
    return result;
}

std::vector<PoseCluster> pose_clusters(const std::vector<Trial>& trials, double factor,
                                       Index others) {
    constexpr std::size_t kOfEach = 2;
    std::vector<PoseCluster> clusters;
    for (const Trial& trial : trials) {
        if (trial.energy > factor * trials.front().energy) break;
        const auto cluster = std::ranges::find_if(clusters, [&](const PoseCluster& other) {
            return difference(trial, *other.front()) <= kOtherCluster;
        });
        if (cluster != clusters.end()) {
            if (cluster->size() < kOfEach) cluster->push_back(&trial);
        } else if (clusters.size() <= to_size(others)) {
            clusters.push_back({&trial});
        }
    }
    return clusters;
}

void try_starts(const PoseSearch& search, const std::vector<TrialStart>& starts,
                std::vector<Trial>& trials, Progress& progress, double hopeless) {
    std::vector<Begun> made = in_part(progress, 0.0, 0.5, [&] {
        return each<Begun>(
            starts,
            [&](const TrialStart& start, Progress& its) { return begun(search, start, its); },
            progress);
    });
    std::vector<Trial> led;
    std::vector<Begun> open;
    for (std::size_t k = 0; k < starts.size(); ++k) {
        if (made[k].open)
            open.push_back(std::move(made[k]));
        else
            (starts[k].places != StartPlaces::kAtRest ? trials : led)
                .push_back(std::move(made[k].trial));
    }
    double least = std::numeric_limits<double>::infinity();
    for (const Begun& half : open) least = std::min(least, half.trial.energy);
    std::erase_if(open, [&](const Begun& half) { return half.trial.energy > hopeless * least; });
    keep_best(led, search.options.same);
    std::erase_if(led, [&](const Trial& trial) {
        return trial.energy > search.options.halfway_factor * led.front().energy;
    });
    for (Trial& trial : led) open.push_back({nullptr, std::move(trial)});
    std::vector<Trial> finished = in_part(progress, 0.5, 1.0, [&] {
        return each<Trial>(
            open, [&](const Begun& half, Progress& its) { return ended(search, half, its); },
            progress);
    });
    for (Trial& trial : finished) trials.push_back(std::move(trial));
    keep_best(trials, search.options.distinct);
}

void count_likeness(PoseSearch& search, std::vector<Trial>& trials) {
    if (search.counts_likeness) return;
    search.counts_likeness = search.source.forms.rows() > 0 && search.target.forms.rows() > 0;
    for (Trial& trial : trials) trial = with_likeness(search, std::move(trial));
    std::ranges::stable_sort(trials, {}, &Trial::energy);
}

double least_disparity(const PoseSearch& search, const std::vector<Trial>& trials) {
    constexpr double kFinest = 1.0 / 2.3;  // what is left of a trial's at the finest level
    const bool has_forms = search.source.forms.rows() > 0 && search.target.forms.rows() > 0;
    double least = std::numeric_limits<double>::infinity();
    for (const Trial& trial : trials) {
        const double misfit = kFinest * trial.energy / dearer_by_turning(search, trial);
        least = std::min(least, has_forms ? misfit * dearer_by_unlikeness(search, trial) : misfit);
    }
    return least;
}

double added_for_turning(const PoseOptions& options, double disparity) {
    constexpr double kMost = 10.0;  // nothing is turned then
    const double ratio = disparity > options.alike ? disparity / options.alike : 1.0;
    const double squared = std::min(ratio * ratio, kMost);
    return options.unlike * (squared - 1.0) * squared * squared * squared;
}

void keep_unlike_as_given(PoseSearch& search, double disparity, std::vector<Trial>& trials,
                          std::span<Candidate> maps) {
    const PoseOptions& options = search.options;
    const double unlike = added_for_turning(options, disparity);
    if (unlike == search.unlike) return;
    const auto growth = [&](const auto& map) {
        const Turning its = turning(search, map);
        return dearer_by_turning(options, unlike, its) /
               dearer_by_turning(options, search.unlike, its);
    };
    for (Trial& trial : trials) trial.energy *= growth(trial);
    std::ranges::stable_sort(trials, {}, &Trial::energy);
    // What a rolled map costs has been said by what the best one does.
    const double of_best = maps.empty() ? 1.0 : growth(maps.front());
    for (Candidate& map : maps) {
        const double more = map.is_rolled ? of_best : growth(map);
        map.energy *= more;
        map.cost *= more;
    }
    search.unlike = unlike;
    std::ranges::stable_sort(maps, {}, &Candidate::cost);
}

std::vector<Trial> relaxed(const PoseSearch& search, const std::vector<Trial>& trials,
                           Progress& progress) {
    std::vector<Trial> result = each<Trial>(
        trials,
        [&](const Trial& trial, Progress& its) {
            OpenTrial longer(search, trial.alignment, search.features, from_there(trial),
                             search.options.longer, search.registration);
            return with_likeness(search, longer.ended(its));
        },
        progress);
    keep_best(result, search.options.distinct);
    return result;
}

std::vector<Candidate> with_motions(const PoseSearch& search, const Candidate& map,
                                    std::span<const SelfMotion> motions, Progress& progress) {
    // Each point takes the image of the nearest one to where the motion brings it, which costs a
    // little; where the samples are the same on both shapes, the map itself costs much less. But
    // the target may be rotated more from how it was given.
    constexpr double kLittle = 1.25;
    const double of_map = dearer_by_turning(search, map);
    return each<Candidate>(
        motions,
        [&](const SelfMotion& motion, Progress&) {
            Candidate other =
                followed_by_motion(map, search.source.full, search.target.full, motion);
            rate(search, other);
            const double more = std::max(1.0, dearer_by_turning(search, other) / of_map);
            if (other.cost < kLittle * more * map.cost) {
                other.energy = more * map.energy;
                other.cost = more * map.cost;
            }
            return other;
        },
        progress);
}

std::vector<RelaxedMap> relaxed_on_all_points(const PoseSearch& search,
                                              const std::vector<Trial>& trials,
                                              Progress& progress) {
    return each<RelaxedMap>(
        trials,
        [&](const Trial& trial, Progress& its) { return relaxed_on_all(search, trial, its); },
        progress);
}

std::vector<Candidate> continued(const PoseSearch& search, const std::vector<RelaxedMap>& maps,
                                 Progress& progress) {
    return each<Candidate>(
        maps, [&](const RelaxedMap& map, Progress& its) { return to_the_finest(search, map, its); },
        progress);
}

Similarity implied_pose(const Positions& source, const Positions& images,
                        const Similarity& alignment) {
    const Similarity fit = fit_similarity(source, images);
    const Matrix3 back = fit.rotation.transpose();
    const Vector3 from = images.colwise().mean().transpose(),
                  to = source.colwise().mean().transpose();
    return composed({1.0, back, to - back * from}, alignment);
}

Similarity implied_pose(const PoseSearch& search, const Trial& trial) {
    return implied_pose(search.source.thin.positions, trial.registration.source_points.positions,
                        trial.alignment);
}

NodeImages node_images(const Candidate& map, const std::vector<Index>& source_rows,
                       const std::vector<Index>& target_rows) {
    const Registration& found = map.registration;
    return {map.cost,
            map.alignment.inverse().apply(gather(found.source_points.positions, source_rows)),
            gather(found.target_points.positions, target_rows)};
}

std::vector<NodeImages> node_images(std::span<const Trial> trials) {
    std::vector<NodeImages> result;
    for (const Trial& trial : trials)
        result.push_back({trial.energy,
                          trial.alignment.inverse().apply(trial.registration.source.positions),
                          trial.registration.target.positions});
    return result;
}

double ratio_in_doubt(const NodeImages& best, const NodeImages& other,
                      std::span<const NodeImages> trials) {
    const double ratio = other.cost / best.cost;
    if ((other.source - best.source).rowwise().norm().mean() < kApart) return ratio;
    double of_best = std::numeric_limits<double>::infinity(), of_other = of_best;
    for (const NodeImages& trial : trials) {
        const bool is_other = (trial.source - other.source).squaredNorm() <
                              (trial.source - best.source).squaredNorm();
        double& least = is_other ? of_other : of_best;
        least = std::min(least, trial.cost);
    }
    if (!std::isfinite(of_best) || !std::isfinite(of_other)) return ratio;
    // No less than if both cost the same: the other one wasn't chosen.
    return std::min(ratio, std::max(1.0, std::sqrt(ratio * of_other / of_best)));
}

}  // namespace pointmorph

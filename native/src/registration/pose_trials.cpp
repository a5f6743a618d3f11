#include "registration/pose_trials.hpp"

#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/registration/anchored_start.hpp"

namespace pointmorph {

namespace {

CoarseShape thinned(const CoarseShape& shape, const std::vector<Extremity>& tips, Index points,
                    Progress& progress) {
    const DeformationGraph& graph = shape.levels.front();
    const KdTree<3> tree(shape.positions);
    std::vector<Index> required = graph.nodes;
    for (const Extremity& tip : tips)
        if (std::ranges::find(required, tip.point) == required.end()) required.push_back(tip.point);
    const Subset subset =
        poisson_disk_subset(tree, shape.normals, required,
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
        level.point_nodes.push_back(graph.point_nodes[to_size(row)]);
        level.point_weights.push_back(graph.point_weights[to_size(row)]);
    }
    level.pattern = deformation_pattern(level);
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

/// The factor by which a map's energy is larger for the sides that it doesn't treat alike. Images
/// of the thinned shapes, those of the source seen from the target at rest.
double dearer_by_asymmetry(const PoseSearch& search, const Positions& source_images,
                           const Positions& target_images) {
    const SymmetryOptions& options = search.options.symmetry;
    return 1.0 + options.weight * asymmetry(search.source.thin, search.target.thin,
                                            search.symmetries, source_images, target_images,
                                            options.far);
}

/// One level of the thinned shapes, the target moved; with its energy.
Trial registered(const PoseSearch& search, const Similarity& alignment,
                 std::span<const IndexPair> features, const RegistrationStart& start,
                 const RegistrationLevel& level, const RegistrationOptions& options) {
    Progress silent;
    const CoarseShape there = moved(search.target.thin, alignment);
    Trial trial{alignment, register_level(search.source.thin, there, 0, features, start, level,
                                          options, silent)};
    const Positions &images = trial.registration.source_points.positions,
                    &back = trial.registration.target_points.positions;
    trial.energy = registration_energy(search.source.thin, there, 0, trial.registration,
                                       search.distances, search.registration, silent) *
                   dearer_by_asymmetry(search, alignment.inverse().apply(images), back);
    return trial;
}

/// Where the points of a trial have come to.
RegistrationStart from_there(const Trial& trial) {
    return {trial.registration.source_points.positions, trial.registration.target_points.positions};
}

/// The stiffness at which tips are let go.
double middle_stiffness(const RegistrationLevel& level) {
    return std::sqrt(level.first_stiffness * level.last_stiffness);
}

Trial begun_at_anchors(const PoseSearch& search, const TrialStart& start) {
    RegistrationLevel level = search.options.trial;
    level.stiff_rounds = 0;  // the points are where they belong, the shapes don't lie alike
    return registered(search, start.alignment, search.features,
                      anchored_start(search.source.thin, moved(search.target.thin, start.alignment),
                                     search.distances, anchors(search, start.tips)),
                      level, search.registration);
}

Trial begun(const PoseSearch& search, const TrialStart& start) {
    if (start.anchored) return begun_at_anchors(search, start);
    const CoarseShape &source = search.source.thin, &target = search.target.thin;
    // Curves and regions have to be brought over; by points alone a plate turns heads.
    const RegistrationStart places =
        source.guides.size() > 0
            ? thin_plate_start(source, moved(target, start.alignment), search.features)
            : RegistrationStart{source.positions, start.alignment.apply(target.positions)};
    RegistrationLevel level = search.options.trial;
    if (start.tips.empty())
        return registered(search, start.alignment, search.features, places, level,
                          search.registration);
    // Tips lead the way while the shapes are stiff; then the surfaces decide.
    level.rounds /= 2;
    level.last_stiffness = middle_stiffness(search.options.trial);
    RegistrationOptions soft = search.registration;
    soft.feature_weight /= 10.0;
    std::vector<IndexPair> guides(search.features.begin(), search.features.end());
    for (const IndexPair& tip : start.tips)
        guides.push_back({search.source.tips[to_size(tip.source)].point,
                          search.target.tips[to_size(tip.target)].point});
    return registered(search, start.alignment, guides, places, level, soft);
}

Trial ended(const PoseSearch& search, const Trial& led) {
    RegistrationLevel level = search.options.trial;
    level.stiff_rounds = 0;
    level.rounds -= level.rounds / 2;
    level.first_stiffness = middle_stiffness(search.options.trial);
    return registered(search, led.alignment, search.features, from_there(led), level,
                      search.registration);
}

/// `make` of all of them, side by side.
template <class Made, class Given, class Make>
std::vector<Made> each(const std::vector<Given>& given, Make&& make, Progress& progress,
                       double first, double last) {
    std::vector<Made> made(given.size());
    parallel_for(
        static_cast<Index>(given.size()), progress,
        [&](Index begin, Index end) {
            for (Index k = begin; k < end; ++k) made[to_size(k)] = make(given[to_size(k)]);
        },
        first, last, 1);
    return made;
}

void keep_best(std::vector<Trial>& trials, double distinct) {
    std::ranges::stable_sort(trials, {}, &Trial::energy);
    keep_distinct(trials, distinct);
}

/// The finest level, from a trial's map.
Candidate to_the_finest(const PoseSearch& search, const Trial& trial) {
    Progress silent;
    const CoarseShape& source = search.source.full;
    const CoarseShape there = moved(search.target.full, trial.alignment);
    const auto all = [](const CoarseShape& shape, const Deformation& deformation) {
        return deformed(shape.positions, shape.normals, shape.levels.front(), deformation)
            .positions;
    };
    const Registration coarse = register_level(
        source, there, 0, search.features,
        {all(source, trial.registration.source), all(there, trial.registration.target)},
        search.options.relaxation, search.registration, silent);
    Candidate result{
        trial.alignment,
        register_shapes(source, there, search.features,
                        {coarse.source_points.positions, coarse.target_points.positions},
                        search.registration, silent, 1),
        {},
        0.0,
        0.0};
    const auto finest = static_cast<Index>(source.levels.size()) - 1;
    result.misfit = registration_misfit(source, there, finest, result.registration,
                                        search.distances, search.registration, silent);
    const Registration& finest_map = result.registration;
    const Positions images = gather(finest_map.source_points.positions, search.source.thin.rows);
    result.energy =
        result.misfit.energy() *
        dearer_by_asymmetry(search, trial.alignment.inverse().apply(images),
                            gather(finest_map.target_points.positions, search.target.thin.rows));
    result.torn = torn_share(source, there, result.registration, search.registration, silent);
    result.cost = result.energy * (1.0 + search.options.tear_weight * result.torn);
    return result;
}

}  // namespace

std::vector<IndexPair> anchors(const PoseSearch& search, const Tips& tips) {
    std::vector<IndexPair> result;
    for (const IndexPair& f : search.features)
        result.push_back({node_at(search.source, f.source), node_at(search.target, f.target)});
    for (const IndexPair& tip : tips) {
        const Index s = node_at(search.source, search.source.tips[to_size(tip.source)].point),
                    t = node_at(search.target, search.target.tips[to_size(tip.target)].point);
        if (std::ranges::none_of(result, [&](const IndexPair& other) {
                return other.source == s || other.target == t;
            }))
            result.push_back({s, t});
    }
    return result;
}

ThinnedShape thinned_shape(const CoarseShape& shape, std::vector<Extremity> tips, Index points,
                           Progress& progress) {
    ThinnedShape result{shape, thinned(shape, tips, points, progress), std::move(tips)};
    const std::vector<Index>& rows = result.thin.rows;
    for (Extremity& tip : result.tips)
        tip.point = static_cast<Index>(std::ranges::find(rows, tip.point) - rows.begin());
    return result;
}

std::vector<Way> ways_of(const std::vector<Trial>& trials, double factor, Index others) {
    constexpr std::size_t kOfEach = 2;
    std::vector<Way> ways;
    for (const Trial& trial : trials) {
        if (trial.energy > factor * trials.front().energy) break;
        const auto way = std::ranges::find_if(ways, [&](const Way& other) {
            return difference(trial, *other.front()) <= kAnotherWay;
        });
        if (way != ways.end()) {
            if (way->size() < kOfEach) way->push_back(&trial);
        } else if (ways.size() <= to_size(others)) {
            ways.push_back({&trial});
        }
    }
    return ways;
}

void try_starts(const PoseSearch& search, const std::vector<TrialStart>& starts,
                std::vector<Trial>& trials, Progress& progress, double first, double last) {
    const double middle = 0.5 * (first + last);
    std::vector<Trial> made = each<Trial>(
        starts, [&](const TrialStart& start) { return begun(search, start); }, progress, first,
        middle);
    std::vector<Trial> led;
    for (std::size_t k = 0; k < starts.size(); ++k)
        (starts[k].tips.empty() || starts[k].anchored ? trials : led).push_back(std::move(made[k]));
    keep_best(led, search.options.same);
    std::erase_if(led, [&](const Trial& trial) {
        return trial.energy > search.options.promising * led.front().energy;
    });
    for (Trial& trial : each<Trial>(
             led, [&](const Trial& half) { return ended(search, half); }, progress, middle, last))
        trials.push_back(std::move(trial));
    keep_best(trials, search.options.distinct);
}

std::vector<Trial> relaxed(const PoseSearch& search, const std::vector<Trial>& trials,
                           Progress& progress, double first, double last) {
    std::vector<Trial> result = each<Trial>(
        trials,
        [&](const Trial& trial) {
            return registered(search, trial.alignment, search.features, from_there(trial),
                              search.options.longer, search.registration);
        },
        progress, first, last);
    keep_best(result, search.options.distinct);
    return result;
}

std::vector<Candidate> continued(const PoseSearch& search, const std::vector<Trial>& trials,
                                 Progress& progress, double first, double last) {
    return each<Candidate>(
        trials, [&](const Trial& trial) { return to_the_finest(search, trial); }, progress, first,
        last);
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

}  // namespace pointmorph

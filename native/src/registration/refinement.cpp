#include "pointmorph/registration/refinement.hpp"

#include <optional>
#include <utility>

#include "base/unused_memory.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "pointmorph/registration/prolongation.hpp"
#include "pointmorph/registration/thin_plate.hpp"
#include "registration/marks.hpp"
#include "registration/orientation.hpp"
#include "registration/scene.hpp"
#include "registration/scene_maps.hpp"

namespace pointmorph {

namespace {

/// A map between the coarse shapes, and what the search for it found out; rows are coarse.
struct FoundMap {
    Registration registration;
    Diagnostics diagnostics;
    std::vector<Extremity> source_extremities, target_extremities;  ///< where proposals need them
};

/// What the search for the pose found; it has compared other maps already, and more of them.
FoundMap found_by(Pose pose, std::vector<Rival> rivals) {
    FoundMap found;
    found.diagnostics.starts = {{"pose", pose.best.torn, pose.best.misfit.energy()}};
    found.diagnostics.margin = pose.margin;
    found.diagnostics.confidence = pose.confidence;
    found.diagnostics.alternatives = std::move(pose.alternatives);
    found.diagnostics.rivals = std::move(rivals);
    found.registration = std::move(pose.best.registration);
    found.source_extremities = std::move(pose.source_extremities);
    found.target_extremities = std::move(pose.target_extremities);
    return found;
}

/// Registered from where the features, or an earlier map, say that the points belong.
FoundMap registered(const Scene& scene, const RegistrationStart& start, bool is_earlier_map,
                    const RefinementOptions& options, Progress& progress) {
    RegistrationOptions first = options.registration;
    // As stiff as from the features alone, few of them would move legs that lie well.
    if (is_earlier_map) first.levels.front() = options.pose.relaxation;
    Restarts restarts = register_best(scene.coarse(),
                                      {is_earlier_map ? "earlier map" : "features",
                                       register_shapes(scene.coarse(), start, first, progress)},
                                      options.restarts, options.registration, progress);
    FoundMap found;
    found.registration = std::move(restarts.registration);
    found.diagnostics.starts = std::move(restarts.tried);
    found.diagnostics.start_taken = restarts.taken;
    if (options.propose) {
        parallel_invoke(2, [&](int k, bool) {
            const CoarseShape& shape = k == 0 ? scene.coarse_source : scene.coarse_target;
            (k == 0 ? found.source_extremities : found.target_extremities) =
                extremities(shape, node_distances(shape), options.pose.extremities);
        });
    }
    return found;
}

/// Coarse rows.
std::vector<Proposal> proposals_for(const FoundMap& found, const Scene& scene, Index others,
                                    Progress& progress) {
    std::vector<IndexPair> marked = scene.coarse_features;
    const std::vector<Index>&s = scene.coarse_source.guides.coarse_rows,
          &t = scene.coarse_target.guides.coarse_rows;
    for (std::size_t k = 0; k < s.size(); ++k) marked.push_back({s[k], t[k]});
    return propose_features({{scene.coarse_source, scene.coarse_target, marked},
                             found.registration,
                             found.source_extremities,
                             found.target_extremities,
                             found.diagnostics.confidence},
                            others, progress);
}

/// A scene, the target where the map has it, and that map.
struct MappedScene {
    Scene scene;
    FoundMap map;
    std::optional<Similarity> move;  ///< which the target's points have yet to make
};

/// Registered from `start`, or, where nothing says how the target lies to the source, from wherever
/// the search for the pose finds that it fits.
MappedScene mapped(Scene scene, const RegistrationStart& start, bool is_earlier_map,
                   bool pose_is_known, const RefinementOptions& options, Progress& progress) {
    FoundMap map;
    std::optional<Similarity> move;
    if (pose_is_known) {
        progress.enter("registration");
        map = registered(scene, start, is_earlier_map, options, progress);
    } else {
        progress.enter("pose");
        Pose pose = find_pose(scene.coarse(), options.pose, options.registration, progress);
        auto rivals = describe_rivals(scene.coarse_source, scene.coarse_target, pose);
        move = pose.best.alignment;
        scene = with_coarse_target_moved(std::move(scene), *move);
        progress.enter("registration");
        map = found_by(std::move(pose), std::move(rivals));
    }
    if (options.propose || !pose_is_known)
        map.diagnostics.proposals = proposals_for(map, scene, options.other_proposals, progress);
    return {std::move(scene), std::move(map), move};
}

/// From the images of the coarse points to those of all points, which meet where they are marked.
/// The target's points are moved where they have yet to be: beside what the source's follow, since
/// a tree is built by one thread.
SceneImages lifted(MappedScene& mapped, Progress& progress) {
    Scene& scene = mapped.scene;
    std::optional<const Prolongation> of_source, of_target;
    if (mapped.move) {
        on_both(progress, [&](bool is_source, Progress& its) {
            if (is_source)
                of_source.emplace(prolongation(scene.source, scene.coarse_source, its));
            else
                scene.target = scene.target.moved(*mapped.move);
        });
    } else {
        of_source.emplace(prolongation(scene.source, scene.coarse_source, progress));
    }
    of_target.emplace(prolongation(scene.target, scene.coarse_target, progress));
    const DeformedCloud &source_points = mapped.map.registration.source_points,
                        &target_points = mapped.map.registration.target_points;
    SceneImages images = with_marks_met(
        {prolonged(scene.source, scene.coarse_source, *of_source, source_points, progress),
         prolonged(scene.target, scene.coarse_target, *of_target, target_points, progress)},
        {scene.source, scene.target, scene.marks},
        {[&](Index row) { return of_source->linear(row, source_points); },
         [&](Index row) { return of_target->linear(row, target_points); }},
        progress);
    free_both(scene.source.tree.size() + scene.target.tree.size(),
              [&](bool is_source) { (is_source ? of_source : of_target).reset(); });
    return images;
}

}  // namespace

Refinement refine(const RefinementCloud& source, const RefinementCloud& target,
                  std::span<const Feature> features, const RefinementOptions& options,
                  Progress& progress, const RefinementStart* start) {
    progress.enter("coarse shapes");
    const GivenClouds given{source, target};
    UnitClouds unit = at_unit_area(given, progress);
    Marks marks = marks_of(features, {unit.source.positions, source.normals},
                           {unit.target.positions, target.normals}, progress);
    if (start && !is_trusted(*start, given, unit, marks, options.trusted_distance)) start = nullptr;
    const FirstAlignment first =
        first_alignment(unit, marks, start, options.features_that_fix_the_pose);
    Scene placed = scene_of(given, unit, std::move(marks), first.alignment, options, progress);
    const auto points = to_index(source.positions.rows() + target.positions.rows());
    free_both(points, [&](bool is_source) {
        (is_source ? unit.source : unit.target).positions.resize(0, 3);
    });
    give_back_unused_memory(points);
    const RegistrationStart coarse_start =
        start ? start_from(*start, placed) : thin_plate_start(placed.coarse());
    const bool inside_out =
        is_inside_out(placed.coarse_source, placed.coarse_target, coarse_start.source);
    if (inside_out) placed = with_target_normals_reversed(std::move(placed));

    MappedScene found = mapped(std::move(placed), coarse_start, start != nullptr,
                               first.fixes_the_pose, options, progress);
    progress.enter("lift");
    SceneImages images = lifted(found, progress);
    const Scene& scene = found.scene;
    Refinement result = on_surfaces(std::move(images), {scene.source, scene.target, scene.marks},
                                    given, options.normal_weight, progress);
    progress.finish();
    result.diagnostics = found.map.diagnostics.with_rows(scene.coarse_source.cloud_rows,
                                                         scene.coarse_target.cloud_rows);
    result.inside_out = inside_out;
    free_both(points, [&](bool is_source) {
        PlacedCloud& cloud = is_source ? found.scene.source : found.scene.target;
        const PlacedCloud gone = std::move(cloud);
    });
    return result;
}

}  // namespace pointmorph

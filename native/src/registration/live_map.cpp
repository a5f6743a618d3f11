#include "pointmorph/registration/live_map.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/misfit.hpp"
#include "registration/marks.hpp"
#include "registration/orientation.hpp"
#include "registration/pinning.hpp"
#include "registration/scene.hpp"
#include "registration/scene_maps.hpp"

namespace pointmorph {

namespace {

/// The coarse shapes with what features mark on them. All points are guides: the nodes stay where
/// they are, whatever is marked.
struct MarkedShapes {
    CoarseShape source, target;

    CoarsePair pair() const { return {source, target}; }
};

/// Softens what is settled already; what it makes of the old features is subtracted again.
RegistrationLevel coarsest_level(const RefinementOptions& options) {
    RegistrationLevel level = options.pose.relaxation;
    level.rounds = 6;
    return level;
}

/// Farthest distance of the rows' images from their partners.
double farthest(const RefinementStart& map, const GivenClouds& given, const Scene& scene,
                std::span<const IndexPair> rows) {
    return std::max(scene.source.placement.scale *
                        largest_offset(map.target_images, given.source.positions,
                                       {rows, &IndexPair::target, &IndexPair::source}),
                    scene.target.placement.scale *
                        largest_offset(map.source_images, given.target.positions,
                                       {rows, &IndexPair::source, &IndexPair::target}));
}

/// Rows that tell where a feature is on both shapes.
std::vector<IndexPair> telling_rows(const Feature& feature, const GivenClouds& given) {
    const auto &s = feature.source.rows, &t = feature.target.rows;
    if (feature.kind == FeatureKind::kRegion)
        return {{central_row(feature.source, given.source.positions),
                 central_row(feature.target, given.target.positions)}};
    if (feature.closed) return {{s.front(), t.front()}};
    return {{s.front(), t.front()}, {s.back(), t.back()}};
}

}  // namespace

struct LiveMap::State {
    RefinementCloud source, target;
    RefinementStart map;
    RefinementOptions options;
    bool inside_out = false;
    Scene scene;
    std::array<KdTree<3>, 2> coarse_trees;
    RegistrationStart start;  ///< where the map takes the coarse points
    Prolongation source_prolongation, target_prolongation;
    /// By the features as they were: the coarsest level, all levels, and what these make of all
    /// points.
    Registration coarse{}, fine{};
    SceneImages before{};
    double torn = 0.0;

    State(const RefinementCloud& source_cloud, const RefinementCloud& target_cloud,
          RefinementStart its_map, RefinementOptions its_options, Scene its_scene,
          Progress& progress)
        : source(source_cloud),
          target(target_cloud),
          map(std::move(its_map)),
          options(std::move(its_options)),
          scene(std::move(its_scene)),
          coarse_trees{KdTree<3>(scene.coarse_source.positions),
                       KdTree<3>(scene.coarse_target.positions)},
          start{scene.target.placement.apply(
                    gather(map.source_images, scene.coarse_source.cloud_rows)),
                scene.source.placement.apply(
                    gather(map.target_images, scene.coarse_target.cloud_rows))},
          source_prolongation(prolongation(scene.source, scene.coarse_source, progress)),
          target_prolongation(prolongation(scene.target, scene.coarse_target, progress)) {}

    GivenClouds given() const { return {source, target}; }

    Marks marks(std::span<const Feature> features, Progress& progress) const {
        return marks_of(features, {scene.source.positions(), scene.source.normals},
                        {scene.target.positions(), scene.target.normals}, progress);
    }
    MarkedShapes marked(std::span<const Feature> features, const Marks& marks) const;
    Registration settled_coarsely(const CoarsePair& shapes, Progress& progress) const;
    Registration settled(const CoarsePair& shapes, const Registration& coarsely,
                         Progress& progress) const;
    SceneImages prolonged_from(const Registration& registration, Progress& progress) const;
    SceneImages shifted(SceneImages after) const;
};

MarkedShapes LiveMap::State::marked(std::span<const Feature> features, const Marks& marks) const {
    MarkedShapes shapes{scene.coarse_source, scene.coarse_target};
    const double node_spacing = 1.0 / std::sqrt(static_cast<double>(options.coarse.nodes.back()));
    Marks curves;
    curves.curves = marks.curves;
    auto guides = guides_of(shapes.pair(), curves, node_spacing, options.registration);
    std::vector<const Feature*> points;
    for (const Feature& f : features)
        if (f.kind == FeatureKind::kPoint) points.push_back(&f);
    const auto add_points = [&](CoarseShape& shape, const PlacedCloud& cloud, Marked Feature::*side,
                                const KdTree<3>& tree, Guides added) {
        const auto first = static_cast<Eigen::Index>(added.size()),
                   count = first + static_cast<Eigen::Index>(points.size());
        added.places.conservativeResize(count, 3);
        added.weights.conservativeResize(count);
        for (std::size_t k = 0; k < points.size(); ++k) {
            const Feature& f = *points[k];
            const Index row = (f.*side).rows.front();
            const auto at = first + static_cast<Eigen::Index>(k);
            added.places.row(at) = cloud.positions().row(row);
            added.weights[at] = f.hard ? options.registration.feature_weight
                                       : options.registration.soft_weight * f.weight;
            added.coarse_rows.push_back(nearest_on_sheet(
                tree, shape.normals, cloud.positions().row(row), cloud.normals.row(row)));
        }
        shape.guides = std::move(added);
    };
    add_points(shapes.source, scene.source, &Feature::source, coarse_trees[0],
               std::move(guides[0]));
    add_points(shapes.target, scene.target, &Feature::target, coarse_trees[1],
               std::move(guides[1]));
    const auto add_labels = [&](CoarseShape& shape, const Labels& members) {
        RegionLabels added =
            region_labels(gather(members, shape.cloud_rows), marks.regions, options.registration);
        shape.labels = std::move(added.labels);
        shape.pulls = std::move(added.pulls);
    };
    if (marks.regions.empty()) return shapes;
    add_labels(shapes.source, marks.source_members);
    add_labels(shapes.target, marks.target_members);
    return shapes;
}

Registration LiveMap::State::settled_coarsely(const CoarsePair& shapes, Progress& progress) const {
    const RegistrationStart from{pulled_to_marks(start.source, shapes.source, shapes.target,
                                                 {{}, &IndexPair::source, &IndexPair::target}),
                                 pulled_to_marks(start.target, shapes.target, shapes.source,
                                                 {{}, &IndexPair::target, &IndexPair::source})};
    return register_level(shapes, 0, from, coarsest_level(options), options.registration, progress);
}

Registration LiveMap::State::settled(const CoarsePair& shapes, const Registration& coarsely,
                                     Progress& progress) const {
    return register_shapes(shapes,
                           {coarsely.source_points.positions, coarsely.target_points.positions},
                           options.registration, progress, 1);
}

SceneImages LiveMap::State::prolonged_from(const Registration& registration,
                                           Progress& progress) const {
    return {prolonged(scene.source, scene.coarse_source, source_prolongation,
                      registration.source_points, progress),
            prolonged(scene.target, scene.coarse_target, target_prolongation,
                      registration.target_points, progress)};
}

/// Where the map takes all points, moved by what has changed since.
SceneImages LiveMap::State::shifted(SceneImages after) const {
    after.source.positions +=
        scene.target.placement.apply(map.source_images) - before.source.positions;
    after.target.positions +=
        scene.source.placement.apply(map.target_images) - before.target.positions;
    return after;
}

LiveMap::LiveMap(const RefinementCloud& source, const RefinementCloud& target,
                 std::span<const Feature> features, RefinementStart map,
                 const RefinementOptions& options, Progress& progress) {
    progress.enter("coarse shapes");
    const GivenClouds given{source, target};
    const UnitClouds unit = at_unit_area(given, progress);
    Marks marks = marks_of(features, {unit.source.positions, source.normals},
                           {unit.target.positions, target.normals}, progress);
    const FirstAlignment first =
        first_alignment(unit, marks, &map, options.features_that_fix_the_pose);
    Scene scene = scene_of(given, unit, std::move(marks), first.alignment, options, progress);
    const bool inside_out = is_inside_out(
        scene.coarse_source, scene.coarse_target,
        scene.target.placement.apply(gather(map.source_images, scene.coarse_source.cloud_rows)));
    if (inside_out) scene = with_target_normals_reversed(std::move(scene));
    // Marks are added anew for each update.
    scene.marks = {};
    scene.coarse_features.clear();
    for (CoarseShape* shape : {&scene.coarse_source, &scene.coarse_target}) {
        shape->guides = {};
        shape->labels.resize(0, Eigen::NoChange);
        shape->pulls.resize(0);
    }
    auto state = std::make_unique<State>(source, target, std::move(map), options, std::move(scene),
                                         progress);
    state->inside_out = inside_out;

    progress.enter("registration");
    const Marks present = state->marks(features, progress);
    const MarkedShapes shapes = state->marked(features, present);
    state->coarse = state->settled_coarsely(shapes.pair(), progress);
    state->fine = state->settled(shapes.pair(), state->coarse, progress);
    state->torn = torn_share(shapes.pair(), state->fine, options.registration, progress);
    state->before = state->prolonged_from(state->fine, progress);
    state->before.source.normals.resize(0, 3);
    state->before.target.normals.resize(0, 3);
    state_ = std::move(state);
    progress.finish();
}

LiveMap::~LiveMap() = default;
LiveMap::LiveMap(LiveMap&&) noexcept = default;

FarFeature LiveMap::farthest(std::span<const Feature> features) const {
    FarFeature found;
    for (const Feature& f : features) {
        const double distance = pointmorph::farthest(state_->map, state_->given(), state_->scene,
                                                     telling_rows(f, state_->given()));
        if (found.name.empty() || distance > found.distance) found = {f.name, distance};
    }
    return found;
}

FollowingPoints LiveMap::follow(const Positions& positions, const Normals& normals,
                                Progress& progress) const {
    const Scene& scene = state_->scene;
    Positions placed = scene.source.placement.apply(positions);
    Normals turned = scene.source.placement.rotated(normals);
    Prolongation following(scene.coarse_source, placed, turned, progress);
    Positions before =
        following(scene.coarse_source, state_->coarse.source_points, placed, turned, progress)
            .positions;
    return {std::move(placed), std::move(turned), std::move(following), std::move(before)};
}

Positions LiveMap::shifts(const FollowingPoints& points, std::span<const Feature> features,
                          Progress& progress) const {
    progress.enter("registration");
    const Marks marks = state_->marks(features, progress);
    const MarkedShapes shapes = state_->marked(features, marks);
    const Registration coarse = state_->settled_coarsely(shapes.pair(), progress);
    const OrientedPoints after =
        points.prolongation(state_->scene.coarse_source, coarse.source_points, points.positions,
                            points.normals, progress);
    const Similarity back = state_->scene.target.placement.inverse();
    Positions shifts = back.scale * back.rotated(after.positions - points.before);
    progress.finish();
    return shifts;
}

LiveUpdate LiveMap::updated(std::span<const Feature> features, Progress& progress) const {
    const Scene& scene = state_->scene;
    progress.enter("registration");
    const Marks marks = state_->marks(features, progress);
    const MarkedShapes shapes = state_->marked(features, marks);
    const Registration fine =
        state_->settled(shapes.pair(), state_->settled_coarsely(shapes.pair(), progress), progress);
    const RegistrationOptions& options = state_->options.registration;
    const double torn = torn_share(shapes.pair(), fine, options, progress);

    progress.enter("lift");
    const MarkedClouds marked{scene.source, scene.target, marks};
    SceneImages images = with_marks_met(
        state_->shifted(state_->prolonged_from(fine, progress)), marked,
        {[&](Index row) { return state_->source_prolongation.linear(row, fine.source_points); },
         [&](Index row) { return state_->target_prolongation.linear(row, fine.target_points); }},
        progress);
    LiveUpdate update{on_surfaces(std::move(images), marked, state_->given(),
                                  state_->options.normal_weight, progress),
                      torn - state_->torn};
    update.refinement.diagnostics.starts = {{"update", torn, 0.0}};
    update.refinement.inside_out = state_->inside_out;
    progress.finish();
    return update;
}

}  // namespace pointmorph

#include "pointmorph/registration/refinement.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "pointmorph/registration/prolongation.hpp"
#include "pointmorph/registration/thin_plate.hpp"
#include "pointmorph/surface/projection.hpp"
#include "registration/marks.hpp"
#include "registration/orientation.hpp"
#include "registration/pinning.hpp"
#include "registration/scene.hpp"

namespace pointmorph {

namespace {

/// A map between the coarse shapes, and what the search for it found out; rows are coarse.
struct FoundMap {
    Registration registration;
    Diagnostics diagnostics;
    std::vector<Extremity> source_extremities, target_extremities;  ///< where proposals need them
};

/// Images of all points of both clouds, where the scene has the other one.
struct SceneImages {
    OrientedPoints source, target;
};

/// What the search for the pose found; it has compared other maps already, and more of them.
FoundMap found_by(Pose pose, std::vector<Rival> rivals) {
    FoundMap found;
    found.diagnostics.starts = {{"pose", pose.best.torn, pose.best.misfit.energy()}};
    found.diagnostics.margin = pose.margin;
    found.diagnostics.confidence = pose.confidence;
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
        const auto extremities_of = [&](const CoarseShape& shape) {
            return extremities(shape, node_distances(shape), options.pose.extremities);
        };
        found.source_extremities = extremities_of(scene.coarse_source);
        found.target_extremities = extremities_of(scene.coarse_target);
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

/// One direction of the map: whose points it takes, and onto what.
struct Direction {
    const PlacedCloud& here;
    const PlacedCloud& there;
    const CoarseShape& coarse;
    const Labels& members_here;
    const Labels& members_there;
    Positions CurvePlaces::*curve_here, CurvePlaces::*curve_there;
    Normals CurvePlaces::*curve_normals;
    Index IndexPair::*row_here, IndexPair::*row_there;
};

Direction forward(const Scene& scene) {
    return {.here = scene.source,
            .there = scene.target,
            .coarse = scene.coarse_source,
            .members_here = scene.marks.source_members,
            .members_there = scene.marks.target_members,
            .curve_here = &CurvePlaces::source,
            .curve_there = &CurvePlaces::target,
            .curve_normals = &CurvePlaces::source_normals,
            .row_here = &IndexPair::source,
            .row_there = &IndexPair::target};
}

Direction backward(const Scene& scene) {
    return {.here = scene.target,
            .there = scene.source,
            .coarse = scene.coarse_target,
            .members_here = scene.marks.target_members,
            .members_there = scene.marks.source_members,
            .curve_here = &CurvePlaces::target,
            .curve_there = &CurvePlaces::source,
            .curve_normals = &CurvePlaces::target_normals,
            .row_here = &IndexPair::target,
            .row_there = &IndexPair::source};
}

/// Images of all points from those of the coarse ones, so moved that hard marks meet.
OrientedPoints images_of(const Direction& map, const Marks& marks, const DeformedCloud& coarse,
                         Progress& progress) {
    const PlacedCloud &here = map.here, &there = map.there;
    const Prolongation prolongation(map.coarse, here.positions(), here.normals, progress);
    OrientedPoints images =
        prolongation(map.coarse, coarse, here.positions(), here.normals, progress);
    const ImagedSurface surface{here.tree, here.normals, here.spacing(),
                                [&](Index row) { return prolongation.linear(row, coarse); }};
    for (const MarkedCurve& curve : marks.curves) {
        if (!curve.hard) continue;
        const CurvePlaces along =
            places_along(curve, 0.5 * std::min(here.spacing(), there.spacing()));
        images.positions = pinned_to_curve(std::move(images.positions), surface,
                                           {along.*map.curve_here, along.*map.curve_normals},
                                           along.*map.curve_there);
    }
    images.positions =
        pinned_to_marks(std::move(images.positions), here.positions(), there.positions(),
                        {marks.pinned, map.row_here, map.row_there}, here.spacing());
    return images;
}

/// Both clouds in the product space.
struct ProductClouds {
    ProductPoints source, target;
};

ProductClouds product_clouds(const Scene& scene, const SceneImages& images,
                             double largest_normal_weight) {
    constexpr double kReferencePoints = 1e4;
    const double weight =
        largest_normal_weight * std::min(1.0, std::sqrt(kReferencePoints) * scene.source.spacing());
    const OrientedView source{scene.source.positions(), scene.source.normals},
        target{scene.target.positions(), scene.target.normals};
    return {product_points(oriented(images.source), source, weight),
            product_points(target, oriented(images.target), weight)};
}

/// The nearest both ways, those of regions among themselves.
Pairing paired(const ProductClouds& product, const Scene& scene, Progress& progress) {
    constexpr double kSoftLabel = 1.0;  // spacings between points inside and outside
    const Marks& marks = scene.marks;
    if (marks.regions.empty())
        return mutual_pairs<12>(product.source, product.target, marks.pinned, progress);
    Values scales(static_cast<Eigen::Index>(Labels::ColsAtCompileTime));
    scales.setZero();
    for (std::size_t r = 0; r < marks.regions.size(); ++r)
        scales[static_cast<Eigen::Index>(r)] =
            marks.regions[r].feature->hard ? 1.0 : kSoftLabel * scene.source.spacing();
    return mutual_pairs<32>(
        labeled_points(product.source, marks.source_members * scales.asDiagonal()),
        labeled_points(product.target, marks.target_members * scales.asDiagonal()), marks.pinned,
        progress);
}

/// The nearest of each row's partners.
std::vector<Index> nearest_partners(const Positions& images, const Pairing& pairs,
                                    const Direction& map) {
    const auto count = to_size(static_cast<Index>(images.rows()));
    std::vector<Index> partners(count, -1);
    std::vector<double> best(count, std::numeric_limits<double>::infinity());
    for (const IndexPair& pair : pairs) {
        const Index i = pair.*map.row_here, j = pair.*map.row_there;
        const double squared = (images.row(i) - map.there.positions().row(j)).squaredNorm();
        if (squared >= best[to_size(i)]) continue;
        best[to_size(i)] = squared;
        partners[to_size(i)] = j;
    }
    return partners;
}

/// Images on the other surface, those of hard regions in their partners, in given coordinates.
Positions given_images(const Positions& images, const Pairing& pairs, const Marks& marks,
                       const Direction& map, Progress& progress) {
    const PlacedCloud& there = map.there;
    Positions projected = project_onto_surface(images, nearest_partners(images, pairs, map),
                                               there.tree, there.normals, progress, there.nearest);
    for (std::size_t r = 0; r < marks.regions.size(); ++r) {
        if (!marks.regions[r].feature->hard) continue;
        const auto column = static_cast<Eigen::Index>(r);
        projected = clamped_to_region(std::move(projected), map.members_here.col(column),
                                      there.tree, map.members_there.col(column));
    }
    return there.placement.inverse().apply(projected);
}

/// A scene, the target where the map has it, and that map.
struct MappedScene {
    Scene scene;
    FoundMap map;
};

/// Registered from `start`, or, where nothing says how the target lies to the source, from wherever
/// the search for the pose finds that it fits.
MappedScene mapped(Scene scene, const RegistrationStart& start, bool is_earlier_map,
                   bool pose_is_known, const RefinementOptions& options, Progress& progress) {
    FoundMap map;
    if (pose_is_known) {
        progress.enter("registration");
        map = registered(scene, start, is_earlier_map, options, progress);
    } else {
        progress.enter("pose");
        Pose pose = find_pose(scene.coarse(), options.pose, options.registration, progress);
        auto rivals = describe_rivals(scene.coarse_source, scene.coarse_target, pose);
        scene = with_target_moved(std::move(scene), pose.best.alignment);
        progress.enter("registration");
        map = found_by(std::move(pose), std::move(rivals));
    }
    if (options.propose || !pose_is_known)
        map.diagnostics.proposals = proposals_for(map, scene, options.other_proposals, progress);
    return {std::move(scene), std::move(map)};
}

/// Images of all points where both clouds were given, those of pinned rows on their partners.
RefinementStart given_maps(const SceneImages& images, const Pairing& pairs, const Scene& scene,
                           const GivenClouds& given, Progress& progress) {
    const Marks& marks = scene.marks;
    RefinementStart maps{
        given_images(images.source.positions, pairs, marks, forward(scene), progress),
        given_images(images.target.positions, pairs, marks, backward(scene), progress)};
    for (const IndexPair& f : marks.pinned) {
        maps.source_images.row(f.source) = given.target.positions.row(f.target);
        maps.target_images.row(f.target) = given.source.positions.row(f.source);
    }
    return maps;
}

}  // namespace

Refinement refine(const RefinementCloud& source, const RefinementCloud& target,
                  std::span<const Feature> features, const RefinementOptions& options,
                  Progress& progress, const RefinementStart* start) {
    progress.enter("coarse shapes");
    const GivenClouds given{source, target};
    const UnitClouds unit = at_unit_area(given, progress);
    Marks marks = marks_of(features, {unit.source.positions, source.normals},
                           {unit.target.positions, target.normals}, progress);
    if (start && !is_trusted(*start, given, unit, marks, options.trusted_distance)) start = nullptr;
    const FirstAlignment first =
        first_alignment(unit, marks, start, options.features_that_fix_the_pose);
    Scene placed = scene_of(given, unit, std::move(marks), first.alignment, options, progress);
    const RegistrationStart coarse_start =
        start ? start_from(*start, placed) : thin_plate_start(placed.coarse());
    const bool inside_out =
        is_inside_out(placed.coarse_source, placed.coarse_target, coarse_start.source);
    if (inside_out) placed = with_target_normals_reversed(std::move(placed));

    const auto [scene, map] = mapped(std::move(placed), coarse_start, start != nullptr,
                                     first.fixes_the_pose, options, progress);

    progress.enter("lift");
    const SceneImages images{
        images_of(forward(scene), scene.marks, map.registration.source_points, progress),
        images_of(backward(scene), scene.marks, map.registration.target_points, progress)};
    progress.enter("product space");
    ProductClouds product = product_clouds(scene, images, options.normal_weight);
    Pairing pairs = paired(product, scene, progress);
    progress.enter("landing");
    RefinementStart maps = given_maps(images, pairs, scene, given, progress);
    progress.finish();
    return {.source_images = std::move(maps.source_images),
            .target_images = std::move(maps.target_images),
            .alignment = composed(scene.source.placement.inverse(), scene.target.placement),
            .pairs = std::move(pairs),
            .source_product = std::move(product.source),
            .target_product = std::move(product.target),
            .diagnostics = map.diagnostics.with_rows(scene.coarse_source.cloud_rows,
                                                     scene.coarse_target.cloud_rows),
            .inside_out = inside_out};
}

}  // namespace pointmorph

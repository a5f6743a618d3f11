#include "pointmorph/registration/refinement.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "pointmorph/registration/misfit.hpp"
#include "pointmorph/registration/prolongation.hpp"
#include "pointmorph/registration/thin_plate.hpp"
#include "pointmorph/surface/projection.hpp"
#include "registration/marks.hpp"
#include "registration/orientation.hpp"
#include "registration/pinning.hpp"

namespace pointmorph {

namespace {

// Rows are cloud rows but for those that are called coarse.

/// As refine() got them.
struct GivenClouds {
    const RefinementCloud& source;
    const RefinementCloud& target;
};

/// A cloud moved so that it has area 1 and its mean at the origin.
struct UnitCloud {
    Similarity placement;  ///< takes given positions to those here
    Positions positions;
};

struct UnitClouds {
    UnitCloud source, target;
};

/// A cloud where it is registered, with a tree over its points.
struct PlacedCloud {
    Similarity placement;                     ///< takes given positions to those here
    std::unique_ptr<const Positions> places;  ///< which the tree refers to
    KdTree<3> tree;
    Normals normals;
    const Neighborhoods* nearest;

    PlacedCloud(const Similarity& move, Positions positions, Normals its_normals,
                const Neighborhoods* known)
        : placement(move),
          places(std::make_unique<const Positions>(std::move(positions))),
          tree(*places),
          normals(std::move(its_normals)),
          nearest(known) {}

    const Positions& positions() const { return *places; }
    double spacing() const { return 1.0 / std::sqrt(static_cast<double>(tree.size())); }
    PlacedCloud moved(const Similarity& move) const {
        return {composed(move, placement), move.apply(*places), move.rotated(normals), nearest};
    }
};

/// Both clouds where they lie to each other, what is marked on them, and their coarse shapes.
struct Scene {
    PlacedCloud source, target;
    Marks marks;
    CoarseShape coarse_source, coarse_target;
    std::vector<IndexPair> coarse_features;

    CoarsePair coarse() const { return {coarse_source, coarse_target, coarse_features}; }
};

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

UnitCloud at_unit_area(const RefinementCloud& cloud) {
    Similarity unit;
    const double area = cloud.nearest ? estimated_area(cloud.positions, *cloud.nearest)
                                      : estimated_area(KdTree<3>(cloud.positions));
    if (area > 0.0) unit.scale = 1.0 / std::sqrt(area);
    unit.translation = -unit.scale * cloud.positions.colwise().mean().transpose();
    return {unit, unit.apply(cloud.positions)};
}

UnitClouds at_unit_area(const GivenClouds& given, Progress& progress) {
    UnitClouds unit;
    on_both(progress, [&](bool is_source, Progress&) {
        (is_source ? unit.source : unit.target) =
            at_unit_area(is_source ? given.source : given.target);
    });
    return unit;
}

/// Positions of the rows that belong together.
struct PosePlaces {
    Positions source, target;  ///< #pairs by 3
};

PosePlaces places_of(const UnitClouds& unit, std::span<const IndexPair> pairs) {
    PosePlaces places{Positions(static_cast<Eigen::Index>(pairs.size()), 3),
                      Positions(static_cast<Eigen::Index>(pairs.size()), 3)};
    for (std::size_t k = 0; k < pairs.size(); ++k) {
        places.source.row(static_cast<Eigen::Index>(k)) =
            unit.source.positions.row(pairs[k].source);
        places.target.row(static_cast<Eigen::Index>(k)) =
            unit.target.positions.row(pairs[k].target);
    }
    return places;
}

/// The target onto the source by the places.
Similarity alignment_by(const PosePlaces& places) {
    if (places.source.rows() >= 3) return fit_similarity(places.target, places.source);
    Similarity move;
    if (places.source.rows() > 0)
        move.translation =
            (places.source.colwise().mean() - places.target.colwise().mean()).transpose();
    return move;
}

/// Whether places lie on no line, by a margin.
bool spread_out(const Positions& places) {
    constexpr double kSpread = 0.05;  // root mean square off the line, in √area
    const Positions centered = places.rowwise() - places.colwise().mean();
    const Matrix3 covariance = centered.transpose() * centered / static_cast<double>(places.rows());
    const Eigen::SelfAdjointEigenSolver<Matrix3> solver(covariance, Eigen::EigenvaluesOnly);
    return solver.eigenvalues()[1] > kSpread * kSpread;
}

/// Whether the marks alone say how the target lies to the source.
bool fix_the_pose(const Marks& marks, const PosePlaces& places, Index features_that_fix_the_pose) {
    const Index enough = std::max<Index>(features_that_fix_the_pose, 3);
    return marks.pose_points >= enough || (static_cast<Index>(marks.pose_pairs.size()) >= enough &&
                                           spread_out(places.source) && spread_out(places.target));
}

/// Whether an earlier map leaves no mark far from its partner.
bool is_trusted(const RefinementStart& start, const GivenClouds& given, const UnitClouds& unit,
                const Marks& marks, double trusted_distance) {
    const double largest =
        std::max(unit.source.placement.scale *
                     largest_offset(start.target_images, given.source.positions,
                                    {marks.pose_pairs, &IndexPair::target, &IndexPair::source}),
                 unit.target.placement.scale *
                     largest_offset(start.source_images, given.target.positions,
                                    {marks.pose_pairs, &IndexPair::source, &IndexPair::target}));
    return !(largest > trusted_distance);
}

/// Rows that have to be coarse ones, none twice.
struct RequiredRows {
    std::vector<Index> source, target;
    std::vector<IndexPair> features;  ///< places in these, which become the coarse rows
};

RequiredRows required_rows(const Marks& marks) {
    RequiredRows required;
    const auto require = [](std::vector<Index>& rows, Index row) {
        const auto found = std::ranges::find(rows, row);
        const auto place = static_cast<Index>(found - rows.begin());
        if (found == rows.end()) rows.push_back(row);
        return place;
    };
    for (const IndexPair& f : marks.pinned)
        required.features.push_back(
            {require(required.source, f.source), require(required.target, f.target)});
    for (const Feature* f : marks.soft_points) {
        require(required.source, f->source.rows.front());
        require(required.target, f->target.rows.front());
    }
    for (const MarkedRegion& region : marks.regions) {
        require(required.source, region.centers.source);
        require(required.target, region.centers.target);
    }
    return required;
}

/// Adds what is marked to the coarse shapes.
void add_marks(CoarseShape& source, CoarseShape& target, const Marks& marks,
               const RefinementOptions& options) {
    // Nodes are about this far apart where the deformation is finest.
    const double node_spacing = 1.0 / std::sqrt(static_cast<double>(options.coarse.nodes.back()));
    auto [source_guides, target_guides] =
        guides_of({source, target}, marks, node_spacing, options.registration);
    source.guides = std::move(source_guides);
    target.guides = std::move(target_guides);
    if (marks.regions.empty()) return;
    const auto add_labels = [&](CoarseShape& shape, const Labels& members) {
        RegionLabels added =
            region_labels(gather(members, shape.cloud_rows), marks.regions, options.registration);
        shape.labels = std::move(added.labels);
        shape.pulls = std::move(added.pulls);
    };
    add_labels(source, marks.source_members);
    add_labels(target, marks.target_members);
}

/// The scene with the target moved by `alignment` from where it is at unit area.
Scene scene_of(const GivenClouds& given, const UnitClouds& unit, Marks marks,
               const Similarity& alignment, const RefinementOptions& options, Progress& progress) {
    RequiredRows required = required_rows(marks);
    std::optional<PlacedCloud> source, target;
    CoarseShape coarse_source, coarse_target;
    on_both(progress, [&](bool is_source, Progress& p) {
        const RefinementCloud& cloud = is_source ? given.source : given.target;
        const Similarity move =
            is_source ? unit.source.placement : composed(alignment, unit.target.placement);
        const PlacedCloud& placed =
            (is_source ? source : target)
                .emplace(move, is_source ? unit.source.positions : move.apply(cloud.positions),
                         is_source ? cloud.normals : move.rotated(cloud.normals), cloud.nearest);
        (is_source ? coarse_source : coarse_target) =
            coarse_shape(placed.tree, placed.normals, is_source ? required.source : required.target,
                         options.coarse, p, cloud.nearest);
    });
    marks.curves = with_target_moved(std::move(marks.curves), alignment);
    add_marks(coarse_source, coarse_target, marks, options);
    return {std::move(*source),       std::move(*target),       std::move(marks),
            std::move(coarse_source), std::move(coarse_target), std::move(required.features)};
}

/// An earlier map's images of the coarse points, pulled to the marks.
RegistrationStart start_from(const RefinementStart& earlier, const Scene& scene) {
    const CoarseShape &source = scene.coarse_source, &target = scene.coarse_target;
    return {pulled_to_marks(
                scene.target.placement.apply(gather(earlier.source_images, source.cloud_rows)),
                source, target, {scene.coarse_features, &IndexPair::source, &IndexPair::target}),
            pulled_to_marks(
                scene.source.placement.apply(gather(earlier.target_images, target.cloud_rows)),
                target, source, {scene.coarse_features, &IndexPair::target, &IndexPair::source})};
}

Scene with_target_normals_reversed(Scene scene) {
    scene.target.normals = -scene.target.normals;
    scene.coarse_target.normals = -scene.coarse_target.normals;
    return scene;
}

Scene with_target_moved(Scene scene, const Similarity& move) {
    scene.target = scene.target.moved(move);
    scene.coarse_target = moved(scene.coarse_target, move);
    scene.marks.curves = with_target_moved(std::move(scene.marks.curves), move);
    return scene;
}

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
    const PosePlaces places = places_of(unit, marks.pose_pairs);
    const bool pose_is_known =
        start || fix_the_pose(marks, places, options.features_that_fix_the_pose);
    Similarity alignment;
    if (start)
        alignment = fit_similarity(unit.target.positions,
                                   unit.source.placement.apply(start->target_images));
    else if (pose_is_known)
        alignment = alignment_by(places);
    Scene scene = scene_of(given, unit, std::move(marks), alignment, options, progress);

    const RegistrationStart coarse_start =
        start ? start_from(*start, scene) : thin_plate_start(scene.coarse());
    Refinement result;
    result.inside_out =
        is_inside_out(scene.coarse_source, scene.coarse_target, coarse_start.source);
    if (result.inside_out) scene = with_target_normals_reversed(std::move(scene));

    FoundMap found;
    if (pose_is_known) {
        progress.enter("registration");
        found = registered(scene, coarse_start, start != nullptr, options, progress);
    } else {
        progress.enter("pose");
        Pose pose = find_pose(scene.coarse(), options.pose, options.registration, progress);
        auto rivals = describe_rivals(scene.coarse_source, scene.coarse_target, pose);
        scene = with_target_moved(std::move(scene), pose.best.alignment);
        progress.enter("registration");
        found = found_by(std::move(pose), std::move(rivals));
    }
    result.alignment = composed(scene.source.placement.inverse(), scene.target.placement);
    if (options.propose || !pose_is_known)
        found.diagnostics.proposals =
            proposals_for(found, scene, options.other_proposals, progress);
    result.diagnostics =
        found.diagnostics.with_rows(scene.coarse_source.cloud_rows, scene.coarse_target.cloud_rows);

    progress.enter("lift");
    const Registration& coarse = found.registration;
    const Direction there = forward(scene), back = backward(scene);
    const SceneImages images{images_of(there, scene.marks, coarse.source_points, progress),
                             images_of(back, scene.marks, coarse.target_points, progress)};

    progress.enter("product space");
    ProductClouds product = product_clouds(scene, images, options.normal_weight);
    result.pairs = paired(product, scene, progress);
    result.source_product = std::move(product.source);
    result.target_product = std::move(product.target);

    progress.enter("landing");
    result.source_images =
        given_images(images.source.positions, result.pairs, scene.marks, there, progress);
    result.target_images =
        given_images(images.target.positions, result.pairs, scene.marks, back, progress);
    for (const IndexPair& f : scene.marks.pinned) {
        result.source_images.row(f.source) = target.positions.row(f.target);
        result.target_images.row(f.target) = source.positions.row(f.source);
    }
    progress.finish();
    return result;
}

}  // namespace pointmorph

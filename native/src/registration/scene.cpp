#include "registration/scene.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <optional>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "registration/pinning.hpp"

namespace pointmorph {

namespace {

UnitCloud at_unit_area(const RefinementCloud& cloud) {
    Similarity unit;
    const double area = cloud.area > 0.0 ? cloud.area
                        : cloud.nearest  ? estimated_area(cloud.positions, *cloud.nearest)
                                         : estimated_area(KdTree<3>(cloud.positions));
    if (area > 0.0) unit.scale = 1.0 / std::sqrt(area);
    unit.translation = -unit.scale * cloud.positions.colwise().mean().transpose();
    return {unit, unit.apply(cloud.positions)};
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
    return marks.pose_points >= enough || (to_index(marks.pose_pairs.size()) >= enough &&
                                           spread_out(places.source) && spread_out(places.target));
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
        const auto place = to_index(found - rows.begin());
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

/// Marks the coarse points next to the cloud's `ends`.
void add_ends(CoarseShape& shape, const Positions& cloud, std::span<const Index> ends) {
    if (ends.empty()) return;
    shape.ends.assign(to_size(shape.size()), 0);
    const KdTree<3> tree(shape.positions);
    for (const Index row : ends) {
        Index nearest;
        double squared;
        tree.nearest(cloud.row(row).data(), {&nearest, 1}, {&squared, 1});
        shape.ends[to_size(nearest)] = 1;
    }
}

}  // namespace

UnitClouds at_unit_area(const GivenClouds& given, Progress& progress) {
    UnitClouds unit;
    on_both(progress, [&](bool is_source, Progress&) {
        (is_source ? unit.source : unit.target) =
            at_unit_area(is_source ? given.source : given.target);
    });
    return unit;
}

FirstAlignment first_alignment(const UnitClouds& unit, const Marks& marks,
                               const RefinementStart* start, Index features_that_fix_the_pose) {
    if (start)
        return {fit_similarity(unit.target.positions,
                               unit.source.placement.apply(start->target_images)),
                true};
    const PosePlaces places = places_of(unit, marks.pose_pairs);
    if (!fix_the_pose(marks, places, features_that_fix_the_pose)) return {};
    return {alignment_by(places), true};
}

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
    add_ends(coarse_source, source->positions(), given.source.ends);
    add_ends(coarse_target, target->positions(), given.target.ends);
    marks.curves = with_target_moved(std::move(marks.curves), alignment);
    add_marks(coarse_source, coarse_target, marks, options);
    return {std::move(*source),       std::move(*target),       std::move(marks),
            std::move(coarse_source), std::move(coarse_target), std::move(required.features)};
}

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

Scene with_coarse_target_moved(Scene scene, const Similarity& move) {
    scene.coarse_target = moved(scene.coarse_target, move);
    scene.marks.curves = with_target_moved(std::move(scene.marks.curves), move);
    return scene;
}

}  // namespace pointmorph

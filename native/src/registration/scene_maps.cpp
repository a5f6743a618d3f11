#include "registration/scene_maps.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "base/unused_memory.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/surface/projection.hpp"
#include "registration/pinning.hpp"
#include "registration/unfolding.hpp"

namespace pointmorph {

namespace {

/// One direction of the map: whose points it takes, and onto what.
struct Direction {
    const PlacedCloud& here;
    const PlacedCloud& there;
    const Labels& members_here;
    const Labels& members_there;
    Positions CurvePlaces::*curve_here, CurvePlaces::*curve_there;
    Normals CurvePlaces::*curve_normals;
    Index IndexPair::*row_here, IndexPair::*row_there;
};

Direction forward(const MarkedClouds& scene) {
    return {.here = scene.source,
            .there = scene.target,
            .members_here = scene.marks.source_members,
            .members_there = scene.marks.target_members,
            .curve_here = &CurvePlaces::source,
            .curve_there = &CurvePlaces::target,
            .curve_normals = &CurvePlaces::source_normals,
            .row_here = &IndexPair::source,
            .row_there = &IndexPair::target};
}

Direction backward(const MarkedClouds& scene) {
    return {.here = scene.target,
            .there = scene.source,
            .members_here = scene.marks.target_members,
            .members_there = scene.marks.source_members,
            .curve_here = &CurvePlaces::target,
            .curve_there = &CurvePlaces::source,
            .curve_normals = &CurvePlaces::target_normals,
            .row_here = &IndexPair::target,
            .row_there = &IndexPair::source};
}

/// So moved that hard marks meet.
OrientedPoints with_marks_met(OrientedPoints images, const Direction& map, const Marks& marks,
                              const std::function<Matrix3(Index)>& linear, Progress& progress) {
    const PlacedCloud &here = map.here, &there = map.there;
    const ImagedSurface surface{here.tree, here.normals, here.spacing(), linear};
    for (const MarkedCurve& curve : marks.curves) {
        if (!curve.hard) continue;
        const CurvePlaces along =
            places_along(curve, 0.5 * std::min(here.spacing(), there.spacing()));
        images.positions = pinned_to_curve(std::move(images.positions), surface,
                                           {along.*map.curve_here, along.*map.curve_normals},
                                           along.*map.curve_there, progress);
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

ProductClouds product_clouds(const MarkedClouds& scene, const SceneImages& images,
                             double normal_weight) {
    const OrientedView source{scene.source.positions(), scene.source.normals},
        target{scene.target.positions(), scene.target.normals};
    ProductClouds product;
    parallel_invoke(2, [&](int k, bool) {
        if (k == 0)
            product.source = product_points(oriented(images.source), source, normal_weight);
        else
            product.target = product_points(target, oriented(images.target), normal_weight);
    });
    return product;
}

/// The nearest both ways, those of regions among themselves.
Pairing paired(const ProductClouds& product, const MarkedClouds& scene, Progress& progress) {
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
    const auto count = to_size(images.rows());
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

/// Weight of unit normals against lengths in the last matching.
double last_normal_weight(const MarkedClouds& scene, double largest) {
    constexpr double kReferencePoints = 1e4;
    return largest * std::min(1.0, std::sqrt(kReferencePoints) * scene.source.spacing());
}

/// Which rows of a side stay where hard marks have them.
std::vector<std::uint8_t> held_rows(const Direction& map, const Marks& marks) {
    constexpr double kCurveReach = 1.5;  // spacings
    const PlacedCloud& here = map.here;
    std::vector<std::uint8_t> held(to_size(here.tree.size()), 0);
    for (const IndexPair& f : marks.pinned) held[to_size(f.*map.row_here)] = 1;
    std::vector<std::pair<Index, double>> ball;
    for (const MarkedCurve& curve : marks.curves) {
        if (!curve.hard) continue;
        const CurvePlaces along = places_along(curve, here.spacing());
        const Positions& places = along.*map.curve_here;
        for (Eigen::Index k = 0; k < places.rows(); ++k) {
            here.tree.within(places.row(k).data(), kCurveReach * here.spacing(), ball);
            for (const auto& [i, squared_distance] : ball) held[to_size(i)] = 1;
        }
    }
    for (std::size_t r = 0; r < marks.regions.size(); ++r) {
        if (!marks.regions[r].feature->hard) continue;
        for (std::size_t i = 0; i < held.size(); ++i)
            if (map.members_here(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(r)) > 0.0)
                held[i] = 1;
    }
    return held;
}

/// Images on the other surface, without folds, those of hard regions in their partners, in given
/// coordinates.
Positions given_images(const Positions& images, const Pairing& pairs, const Marks& marks,
                       const Direction& map, double normal_weight, Progress& progress) {
    const PlacedCloud &here = map.here, &there = map.there;
    LandedImages landed{{}, nearest_partners(images, pairs, map)};
    constexpr double kLanded = 0.7;  // share of the time
    {
        const Progress::Part part(progress, 0.0, kLanded);
        landed.positions = project_onto_surface(images, landed.anchors, there.tree, there.normals,
                                                progress, there.nearest);
    }
    for (std::size_t r = 0; r < marks.regions.size(); ++r) {
        if (!marks.regions[r].feature->hard) continue;
        const auto column = static_cast<Eigen::Index>(r);
        landed.positions =
            clamped_to_region(std::move(landed.positions), map.members_here.col(column), there.tree,
                              map.members_there.col(column));
    }
    const Progress::Part part(progress, kLanded, 1.0);
    unfold(landed, {here.tree, here.normals, here.nearest},
           {there.tree, there.normals, there.nearest}, held_rows(map, marks), normal_weight,
           progress);
    return there.placement.inverse().apply(landed.positions);
}

/// Images of all points where both clouds were given, those of pinned rows on their partners.
RefinementStart given_maps(SceneImages images, const Pairing& pairs, const MarkedClouds& scene,
                           const GivenClouds& given, double normal_weight, Progress& progress) {
    const Marks& marks = scene.marks;
    RefinementStart maps;
    on_both(progress, [&](bool is_source, Progress& its) {
        Positions& of_side = (is_source ? images.source : images.target).positions;
        (is_source ? maps.source_images : maps.target_images) =
            given_images(of_side, pairs, marks, is_source ? forward(scene) : backward(scene),
                         normal_weight, its);
        of_side.resize(0, 3);
    });
    for (const IndexPair& f : marks.pinned) {
        maps.source_images.row(f.source) = given.target.positions.row(f.target);
        maps.target_images.row(f.target) = given.source.positions.row(f.source);
    }
    return maps;
}

}  // namespace

Prolongation prolongation(const PlacedCloud& cloud, const CoarseShape& coarse, Progress& progress) {
    return {coarse, cloud.positions(), cloud.normals, progress};
}

OrientedPoints prolonged(const PlacedCloud& cloud, const CoarseShape& coarse,
                         const Prolongation& prolongation, const DeformedCloud& images,
                         Progress& progress) {
    return prolongation(coarse, images, cloud.positions(), cloud.normals, progress);
}

SceneImages with_marks_met(SceneImages images, const MarkedClouds& scene, const LinearMaps& linear,
                           Progress& progress) {
    return {with_marks_met(std::move(images.source), forward(scene), scene.marks, linear.source,
                           progress),
            with_marks_met(std::move(images.target), backward(scene), scene.marks, linear.target,
                           progress)};
}

Refinement on_surfaces(SceneImages images, const MarkedClouds& scene, const GivenClouds& given,
                       double normal_weight, Progress& progress) {
    progress.enter("product space");
    const auto points = to_index(images.source.positions.rows() + images.target.positions.rows());
    give_back_unused_memory(points);
    const double weight = last_normal_weight(scene, normal_weight);
    ProductClouds product = product_clouds(scene, images, weight);
    // The product has them: the fewer large arrays meanwhile, the better.
    free_both(points, [&](bool is_source) {
        (is_source ? images.source : images.target).normals.resize(0, 3);
    });
    Pairing pairs = paired(product, scene, progress);
    progress.enter("landing");
    RefinementStart maps = given_maps(std::move(images), pairs, scene, given, weight, progress);
    Refinement result;
    result.source_images = std::move(maps.source_images);
    result.target_images = std::move(maps.target_images);
    result.alignment = composed(scene.source.placement.inverse(), scene.target.placement);
    result.pairs = std::move(pairs);
    result.source_product = std::move(product.source);
    result.target_product = std::move(product.target);
    return result;
}

}  // namespace pointmorph

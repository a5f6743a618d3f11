#include "morph/network_route.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

#include "morph/patch_cloud.hpp"
#include "morph/point_features.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/disk/network.hpp"
#include "surface/coarse_cloud.hpp"

namespace pointmorph {

namespace {

SurfaceCurve reversed(const SurfaceCurve& curve) {
    return {curve.points.colwise().reverse(), curve.normals.colwise().reverse()};
}

/// The curves around a patch as one closed curve, and where each of them begins.
struct Rim {
    SurfaceCurve curve;
    std::vector<Index> corners;

    Rim(const Network& network, std::span<const Dart> darts, std::size_t model) {
        std::vector<SurfaceCurve> parts;
        Index count = 0;
        for (const Dart dart : darts) {
            const SurfaceCurve& part = network.curves[to_size(dart / 2)].on[model];
            parts.push_back(dart % 2 == 0 ? part : reversed(part));
            count += part.size() - 1;
        }
        curve = {Positions(count, 3), Normals(count, 3)};
        Index row = 0;
        for (const SurfaceCurve& part : parts) {
            corners.push_back(row);
            curve.points.middleRows(row, part.size() - 1) = part.points.topRows(part.size() - 1);
            curve.normals.middleRows(row, part.size() - 1) = part.normals.topRows(part.size() - 1);
            row += part.size() - 1;
        }
    }
};

/// All curves would fit much better if one model were a mirror image.
bool looks_mirrored(const Network& network) {
    constexpr Index kSamples = 16;
    std::array<Positions, 2> places;
    for (const std::size_t m : {0u, 1u}) {
        places[m].resize(static_cast<Eigen::Index>(network.curves.size()) * kSamples, 3);
        Eigen::Index row = 0;
        for (const NetworkCurve& curve : network.curves)
            for (Index k = 0; k < kSamples; ++k)
                places[m].row(row++) =
                    curve.on[m].points.row((curve.on[m].size() - 1) * k / (kSamples - 1));
    }
    return fits_better_mirrored(places[0], places[1]);
}

/// Tips without a mark that belong together whatever the map: as far from all features.
std::vector<IndexPair> tips_alike(const Side& source, const KdTree<3>& source_tree,
                                  const Side& target, const KdTree<3>& target_tree,
                                  std::span<const PointFeature> known,
                                  const DecompositionOptions& options, Progress& progress) {
    const auto tips = [&](const Side& side, const KdTree<3>& tree, Index IndexPair::*row) {
        std::vector<Index> features;
        for (const PointFeature& f : known) features.push_back(f.rows.*row);
        const CoarseCloud coarse({side.positions, side.normals, side.nearest, side.cloud.name},
                                 tree, features, options.points, progress);
        return unmarked_extremities(coarse, distances_from_features(coarse, features.size()),
                                    options.tips, progress);
    };
    return paired_extremities(tips(source, source_tree, &IndexPair::source),
                              tips(target, target_tree, &IndexPair::target), kLargestDifference,
                              [](Index, Index) { return 0.0; });
}

}  // namespace

TracedNetwork traced_network(const Side& source, const Side& target, const MorphInput& input,
                             std::span<const Feature> marked, const MorphOptions& options,
                             MorphReport& report, Progress& progress) {
    progress.enter("network");
    TracedNetwork result;
    result.known = point_features(source, target, marked, options, report, progress);
    for (const PointFeature& f : result.known) result.names.push_back(f.name);
    std::vector<std::vector<std::string>> given = input.more_loops;
    if (!input.loop.empty()) given.insert(given.begin(), input.loop);
    std::vector<std::vector<Index>> loops;
    for (const auto& loop : given) {
        loops.emplace_back();
        for (const std::string& name : loop)
            loops.back().push_back(
                static_cast<Index>(std::ranges::find(result.names, name) - result.names.begin()));
    }
    const KdTree<3> source_tree(source.positions), target_tree(target.positions);
    for (const IndexPair& tip : tips_alike(source, source_tree, target, target_tree, result.known,
                                           options.decomposition, progress)) {
        result.names.push_back("tip " + std::to_string(report.tips.size() + 1));
        result.known.push_back({result.names.back(), tip});
        report.tips.push_back(
            {source.order[to_size(tip.source)], target.order[to_size(tip.target)]});
    }
    const auto side_of = [&](const Side& side, const KdTree<3>& tree, Index IndexPair::*row) {
        const Component& largest = side.topology.components.front();
        NetworkShape shape{
            {side.positions, side.normals, side.nearest, side.cloud.name}, tree, {}, largest.genus};
        for (const PointFeature& f : result.known) shape.features.push_back(f.rows.*row);
        return shape;
    };
    result.network = trace_network({side_of(source, source_tree, &IndexPair::source),
                                    side_of(target, target_tree, &IndexPair::target)},
                                   result.names, loops, options.decomposition, progress);
    return result;
}

NetworkRoute match_in_network(Side& source, Side& target, const MorphInput& input,
                              std::span<const Feature> marked, const MorphOptions& options,
                              MorphReport& report, Progress& progress) {
    const TracedNetwork traced =
        traced_network(source, target, input, marked, options, report, progress);
    const auto& [network, known, names] = traced;
    for (const NetworkCurve& curve : network.curves)
        report.curves.push_back({names[to_size(curve.from)], names[to_size(curve.to)]});
    report.patches = static_cast<Index>(network.patches.size());
    if (looks_mirrored(network))
        report.warnings.emplace_back(
            "The curves fit much better when one model is mirrored: check that left and right are "
            "not swapped and that the normals of both point outwards.");

    for (Side* side : {&source, &target}) side->topology.components.front().genus = network.genus;
    constexpr double kLongDetour = 0.15;
    if (network.detour > kLongDetour)
        report.warnings.emplace_back(
            "The curves between the features run long ways round each other: check that all "
            "features are in the same places on both models, and that left and right are not "
            "swapped.");

    const std::array<const Side*, 2> sides{&source, &target};
    NetworkRoute route;
    const std::array<DiskPoints*, 2> domains{&route.source, &route.target};
    const std::array<Positions*, 2> images{&route.source_images, &route.target_images};
    for (const std::size_t m : {0u, 1u}) {
        domains[m]->resize(sides[m]->positions.rows(), 2);
        images[m]->resize(sides[m]->positions.rows(), 3);
    }
    const auto row_of = [&](std::size_t m, Index corner) {
        const IndexPair& rows = traced.known[to_size(corner)].rows;
        return m == 0 ? rows.source : rows.target;
    };
    const auto patches = static_cast<Index>(network.patches.size());
    for (Index p = 0; p < patches; ++p) {
        progress.enter("parameterization");
        const auto& darts = network.patches[to_size(p)];
        const std::array<Rim, 2> rims{Rim(network, darts, 0), Rim(network, darts, 1)};
        const auto angles = rim_angles(rims[0].curve, rims[0].corners, rims[1].curve,
                                       rims[1].corners, options.parameterization.boundary_spacing);
        std::vector<PatchCloud> clouds;
        std::array<DiskPoints, 2> disks;
        for (const std::size_t m : {0u, 1u}) {
            std::vector<Index> rows;
            for (Index i = 0; i < sides[m]->positions.rows(); ++i)
                if (network.labels[m][to_size(i)] == p) rows.push_back(i);
            clouds.emplace_back(*sides[m], std::move(rows), rims[m].curve);
            auto& said = m == 0 ? report.source_parameterization : report.target_parameterization;
            said.boundary_points += static_cast<Index>(clouds[m].loop.size());
            const Progress::Part part(progress, (p + 0.5 * static_cast<double>(m)) / patches,
                                      (p + 0.5 * static_cast<double>(m + 1)) / patches);
            disks[m] = on_disk(*sides[m], clouds[m], angles[m], options, said, report, progress);
        }
        progress.enter("alignment");
        const auto tips = paired_extremities(
            network.unmarked[0], network.unmarked[1], kLargestDifference, [&](Index s, Index t) {
                return network.labels[0][to_size(s)] != p || network.labels[1][to_size(t)] != p
                           ? kNoPair
                           : (disks[0].row(clouds[0].place(s)) - disks[1].row(clouds[1].place(t)))
                                 .norm();
            });
        std::vector<IndexPair> together;
        for (const auto& [s, t] : tips) {
            together.push_back({clouds[0].place(s), clouds[1].place(t)});
            report.tips.push_back({source.order[to_size(s)], target.order[to_size(t)]});
        }
        const Alignment alignment =
            align_features(disks[0], disks[1], together, true, options.alignment, progress);
        report.feature_residual = std::max(report.feature_residual, alignment.residual);
        report.alignment_sweeps = std::max(report.alignment_sweeps, alignment.sweeps);
        progress.enter("pairing");
        // Where one model has no points of its own in a patch, its corners stand for it.
        std::array<std::vector<Index>, 2> rows{clouds[0].rows, clouds[1].rows};
        std::array<DiskPoints, 2> inside;
        for (const std::size_t m : {0u, 1u}) {
            inside[m] = disks[m].topRows(static_cast<Eigen::Index>(rows[m].size()));
            if (!rows[m].empty()) continue;
            inside[m].resize(static_cast<Eigen::Index>(darts.size()), 2);
            for (std::size_t k = 0; k < darts.size(); ++k) {
                const NetworkCurve& curve = network.curves[to_size(darts[k] / 2)];
                rows[m].push_back(row_of(m, darts[k] % 2 == 0 ? curve.from : curve.to));
                inside[m].row(static_cast<Eigen::Index>(k)) =
                    disks[m].row(clouds[m].loop[to_size(rims[m].corners[k])]);
            }
        }
        if (!clouds[0].rows.empty() || !clouds[1].rows.empty())
            for (const auto& [s, t] :
                 pair_points<2>(inside[0], inside[1], {}, options.pairing, progress))
                route.pairs.push_back({rows[0][to_size(s)], rows[1][to_size(t)]});
        progress.enter("transfer");
        for (const std::size_t m : {0u, 1u}) {
            const auto count = static_cast<Eigen::Index>(clouds[m].rows.size());
            const Positions landed =
                transfer<2>(KdTree<2>(disks[1 - m]), clouds[1 - m].positions,
                            disks[m].topRows(count), options.transfer, progress);
            constexpr double kApart = 4.0;
            for (Eigen::Index i = 0; i < count; ++i) {
                const Index row = clouds[m].rows[to_size(i)];
                domains[m]->row(row) = disks[m].row(i) + Eigen::RowVector2d(kApart * p, 0.0);
                images[m]->row(row) = landed.row(i);
            }
            for (std::size_t k = 0; k < darts.size(); ++k) {
                const NetworkCurve& curve = network.curves[to_size(darts[k] / 2)];
                const Index corner = darts[k] % 2 == 0 ? curve.from : curve.to;
                domains[m]->row(row_of(m, corner)) =
                    disks[m].row(clouds[m].loop[to_size(rims[m].corners[k])]) +
                    Eigen::RowVector2d(kApart * p, 0.0);
            }
        }
    }
    for (const PointFeature& f : known) {
        route.pairs.push_back(f.rows);
        route.source_images.row(f.rows.source) = target.positions.row(f.rows.target);
        route.target_images.row(f.rows.target) = source.positions.row(f.rows.source);
    }
    std::ranges::sort(route.pairs);
    route.pairs.erase(std::ranges::unique(route.pairs).begin(), route.pairs.end());
    return route;
}

}  // namespace pointmorph

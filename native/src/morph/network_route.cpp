#include "morph/network_route.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "morph/words.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "surface/coarse_cloud.hpp"

namespace pointmorph {

namespace {

SurfaceCurve reversed(const SurfaceCurve& curve) {
    return {curve.points.colwise().reverse(), curve.normals.colwise().reverse()};
}

/// The curves around a patch of one of the models, each as it is passed.
ClosedCurve rim_of(const Network& network, std::span<const Dart> darts, std::size_t model) {
    std::vector<SurfaceCurve> parts;
    for (const Dart dart : darts) {
        const SurfaceCurve& part = network.curves[to_size(dart / 2)].on[model];
        parts.push_back(dart % 2 == 0 ? part : reversed(part));
    }
    return closed_curve(parts);
}

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

/// Unmarked extremities that belong together whatever the map: as far from all features.
Pairing extremities_alike(const RouteInput& input, const KdTree<3>& source_tree,
                          const KdTree<3>& target_tree, std::span<const PointFeature> known,
                          const DecompositionOptions& options, Progress& progress) {
    const auto extremities = [&](const PreparedShape& shape, const KdTree<3>& tree,
                                 Index IndexPair::*row) {
        std::vector<Index> features;
        for (const PointFeature& f : known) features.push_back(f.rows.*row);
        const CoarseCloud coarse(shape.surface(), tree, features, options.points, progress);
        return unmarked_extremities(coarse, distances_from_features(coarse, features.size()),
                                    options.extremities, progress);
    };
    return paired_extremities(extremities(input.source, source_tree, &IndexPair::source),
                              extremities(input.target, target_tree, &IndexPair::target),
                              kLargestDifference, [](Index, Index) { return 0.0; });
}

/// Lays patch after patch of both models over each other and gathers what comes of it. Model 0 is
/// the source.
class PatchMatcher {
public:
    PatchMatcher(const RouteInput& input, const TracedNetwork& traced,
                 const NetworkRouteOptions& options, RouteResult& result)
        : input_(input), traced_(traced), options_(options), result_(result) {
        for (const std::size_t m : {0u, 1u}) {
            domain(m).resize(shape(m).size(), 2);
            images(m).resize(shape(m).size(), 3);
        }
    }

    void match(Index patch, Progress& progress) {
        progress.enter("parameterization");
        const OnDisk on_disk = parameterized(patch, progress);
        progress.enter("alignment");
        const auto disks = aligned(patch, on_disk, progress);
        progress.enter("pairing");
        pair(patch, on_disk, disks, progress);
        progress.enter("transfer");
        place(patch, on_disk, disks, progress);
    }

private:
    struct OnDisk {
        std::array<ClosedCurve, 2> rims;
        std::vector<PatchCloud> clouds;
        std::array<DiskPoints, 2> disks;
    };

    const Network& network() const { return traced_.network; }
    const PreparedShape& shape(std::size_t m) const {
        return m == 0 ? input_.source : input_.target;
    }
    DomainPoints& domain(std::size_t m) {
        return m == 0 ? result_.source_domain : result_.target_domain;
    }
    Positions& images(std::size_t m) {
        return m == 0 ? result_.images.source_images : result_.images.target_images;
    }

    /// The sorted row of the corner at which a dart begins.
    Index corner_row(std::size_t m, Dart dart) const {
        const NetworkCurve& curve = network().curves[to_size(dart / 2)];
        const IndexPair& rows =
            traced_.corners[to_size(dart % 2 == 0 ? curve.from : curve.to)].rows;
        return m == 0 ? rows.source : rows.target;
    }

    OnDisk parameterized(Index patch, Progress& progress) {
        const auto& darts = network().patches[to_size(patch)];
        OnDisk result{{rim_of(network(), darts, 0), rim_of(network(), darts, 1)}, {}, {}};
        const auto angles =
            rim_angles(result.rims[0].curve, result.rims[0].corners, result.rims[1].curve,
                       result.rims[1].corners, options_.patches.parameterization.boundary_spacing);
        const auto patches = static_cast<double>(network().patches.size());
        for (const std::size_t m : {0u, 1u}) {
            std::vector<Index> rows;
            for (Index i = 0; i < shape(m).size(); ++i)
                if (network().labels[m][to_size(i)] == patch) rows.push_back(i);
            const PatchCloud& cloud =
                result.clouds.emplace_back(shape(m), std::move(rows), result.rims[m].curve);
            const Progress::Part part(progress, (patch + 0.5 * static_cast<double>(m)) / patches,
                                      (patch + 0.5 * static_cast<double>(m + 1)) / patches);
            PatchOnDisk disk = on_disk(shape(m), cloud, angles[m], options_.patches, progress);
            auto& said = m == 0 ? result_.facts.source_parameterization
                                : result_.facts.target_parameterization;
            said.add(disk.facts);
            said.boundary_points += to_index(cloud.loop.size());
            warn_of_joined(disk, shape(m), result_.warnings);
            result.disks[m] = std::move(disk.points);
        }
        return result;
    }

    std::array<DiskPoints, 2> aligned(Index patch, const OnDisk& on_disk, Progress& progress) {
        const auto& clouds = on_disk.clouds;
        std::array<DiskPoints, 2> disks = on_disk.disks;
        const auto extremities = paired_extremities(
            network().unmarked[0], network().unmarked[1], kLargestDifference,
            [&](Index s, Index t) {
                if (network().labels[0][to_size(s)] != patch ||
                    network().labels[1][to_size(t)] != patch)
                    return kNoPair;
                return (disks[0].row(clouds[0].patch_row(s)) - disks[1].row(clouds[1].patch_row(t)))
                    .norm();
            });
        std::vector<IndexPair> together;
        for (const auto& [s, t] : extremities) {
            together.push_back({clouds[0].patch_row(s), clouds[1].patch_row(t)});
            result_.facts.extremities.push_back({s, t});
        }
        const Alignment alignment = align_features(disks[0], disks[1], together, true,
                                                   options_.patches.alignment, progress);
        RouteFacts& facts = result_.facts;
        facts.feature_residual = std::max(facts.feature_residual, alignment.residual);
        facts.alignment_sweeps = std::max(facts.alignment_sweeps, alignment.sweeps);
        return disks;
    }

    void pair(Index patch, const OnDisk& on_disk, const std::array<DiskPoints, 2>& disks,
              Progress& progress) {
        const auto& clouds = on_disk.clouds;
        if (clouds[0].rows.empty() && clouds[1].rows.empty()) return;
        const auto& darts = network().patches[to_size(patch)];
        // Where one model has no points of its own in a patch, its corners stand for it.
        std::array<std::vector<Index>, 2> rows{clouds[0].rows, clouds[1].rows};
        std::array<DiskPoints, 2> inside;
        for (const std::size_t m : {0u, 1u}) {
            inside[m] = disks[m].topRows(static_cast<Eigen::Index>(rows[m].size()));
            if (!rows[m].empty()) continue;
            inside[m].resize(static_cast<Eigen::Index>(darts.size()), 2);
            for (std::size_t k = 0; k < darts.size(); ++k) {
                rows[m].push_back(corner_row(m, darts[k]));
                inside[m].row(static_cast<Eigen::Index>(k)) =
                    disks[m].row(clouds[m].loop[to_size(on_disk.rims[m].corners[k])]);
            }
        }
        for (const auto& [s, t] :
             pair_points<2>(inside[0], inside[1], {}, options_.patches.pairing, progress))
            result_.pairs.push_back({rows[0][to_size(s)], rows[1][to_size(t)]});
    }

    /// Points of the patch into the domain, and where they end on the other model.
    void place(Index patch, const OnDisk& on_disk, const std::array<DiskPoints, 2>& disks,
               Progress& progress) {
        constexpr double kApart = 4.0;
        const auto& clouds = on_disk.clouds;
        const auto& darts = network().patches[to_size(patch)];
        const Eigen::RowVector2d center(kApart * patch, 0.0);
        for (const std::size_t m : {0u, 1u}) {
            const auto count = static_cast<Eigen::Index>(clouds[m].rows.size());
            const Positions ends =
                transfer<2>(KdTree<2>(disks[1 - m]), clouds[1 - m].positions,
                            disks[m].topRows(count), options_.transfer, progress);
            for (Eigen::Index i = 0; i < count; ++i) {
                const Index row = clouds[m].rows[to_size(i)];
                domain(m).row(row) = disks[m].row(i) + center;
                images(m).row(row) = ends.row(i);
            }
            for (std::size_t k = 0; k < darts.size(); ++k)
                domain(m).row(corner_row(m, darts[k])) =
                    disks[m].row(clouds[m].loop[to_size(on_disk.rims[m].corners[k])]) + center;
        }
    }

    const RouteInput& input_;
    const TracedNetwork& traced_;
    const NetworkRouteOptions& options_;
    RouteResult& result_;
};

}  // namespace

TracedNetwork traced_network(const RouteInput& input, const Loops& loops,
                             const DecompositionOptions& options, Progress& progress) {
    progress.enter("network");
    TracedNetwork result;
    result.corners = point_features(input, {}, progress);
    for (const PointFeature& f : result.corners) result.names.push_back(f.name);
    std::vector<std::vector<Index>> loop_corners;
    for (const auto& loop : loops) {
        loop_corners.emplace_back();
        for (const std::string& name : loop)
            loop_corners.back().push_back(
                to_index(std::ranges::find(result.names, name) - result.names.begin()));
    }
    const KdTree<3> source_tree(input.source.positions), target_tree(input.target.positions);
    result.extremities =
        extremities_alike(input, source_tree, target_tree, result.corners, options, progress);
    for (std::size_t k = 0; k < result.extremities.size(); ++k) {
        result.names.push_back("tip " + std::to_string(k + 1));
        result.corners.push_back({result.names.back(), result.extremities[k]});
    }
    const auto to_trace = [&](const PreparedShape& shape, const KdTree<3>& tree,
                              Index IndexPair::*row) {
        NetworkShape traced{shape.surface(), tree, {}, shape.topology.components.front().genus};
        for (const PointFeature& f : result.corners) traced.features.push_back(f.rows.*row);
        return traced;
    };
    result.network = trace_network({to_trace(input.source, source_tree, &IndexPair::source),
                                    to_trace(input.target, target_tree, &IndexPair::target)},
                                   result.names, loop_corners, options, progress);
    return result;
}

RouteResult match_in_network(const RouteInput& input, const Loops& loops,
                             const NetworkRouteOptions& options, Progress& progress) {
    const TracedNetwork traced = traced_network(input, loops, options.decomposition, progress);
    const Network& network = traced.network;
    RouteResult result;
    result.domain = "network";
    result.genus = network.genus;
    result.facts.extremities = traced.extremities;
    for (const NetworkCurve& curve : network.curves)
        result.facts.curves.push_back(
            {traced.names[to_size(curve.from)], traced.names[to_size(curve.to)]});
    result.facts.patches = to_index(network.patches.size());
    if (looks_mirrored(network)) result.warnings.push_back(fits_mirrored("The curves fit"));
    constexpr double kLongDetour = 0.15;
    if (network.detour > kLongDetour) result.warnings.push_back(curves_take_detours());

    PatchMatcher matcher(input, traced, options, result);
    for (Index patch = 0; patch < result.facts.patches; ++patch) matcher.match(patch, progress);
    for (const PointFeature& f : traced.corners) {
        result.pairs.push_back(f.rows);
        result.images.source_images.row(f.rows.source) = input.target.positions.row(f.rows.target);
        result.images.target_images.row(f.rows.target) = input.source.positions.row(f.rows.source);
    }
    std::ranges::sort(result.pairs);
    result.pairs.erase(std::ranges::unique(result.pairs).begin(), result.pairs.end());
    return result;
}

}  // namespace pointmorph

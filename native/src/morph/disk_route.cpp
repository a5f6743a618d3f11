#include "morph/disk_route.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <unordered_map>

#include "morph/point_features.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

/// Mirroring one disk must bring the features this much closer before estimated normals are taken
/// to point inwards on one side.
constexpr double kMirrorFactor = 0.5;

/// Positions of the boundary features in their loops. A feature lies on both boundaries or on
/// neither.
std::vector<IndexPair> boundary_features(const Side& source, const Side& target,
                                         std::span<const PointFeature> features) {
    const auto positions_in = [](const Side& side) {
        std::unordered_map<Index, Index> result;
        for (std::size_t i = 0; i < side.loop.size(); ++i)
            result.emplace(side.loop[i], static_cast<Index>(i));
        return result;
    };
    const auto on_source = positions_in(source), on_target = positions_in(target);
    std::vector<IndexPair> result;
    for (std::size_t i = 0; i < features.size(); ++i) {
        const auto s = on_source.find(features[i].rows.source);
        const auto t = on_target.find(features[i].rows.target);
        if ((s == on_source.end()) != (t == on_target.end())) {
            const bool source_has_it = s != on_source.end();
            const std::string& has = source_has_it ? source.cloud.name : target.cloud.name;
            const std::string& lacks = source_has_it ? target.cloud.name : source.cloud.name;
            throw FeatureError(
                "feature \"" + features[i].name + "\"", "a place on both boundaries or on neither",
                "one on the boundary of " + has + " and inside " + lacks,
                "Move it onto the boundary of " + lacks + ", or off that of " + has + ".");
        }
        if (s != on_source.end()) result.push_back({s->second, t->second});
    }
    return result;
}

/// Summed squared distance of the features after the best rotation of the source disk.
double misfit(const DiskPoints& source, const DiskPoints& target,
              std::span<const IndexPair> features) {
    const double angle = best_rotation(source, target, features);
    const Eigen::Rotation2Dd rotation(angle);
    double sum = 0.0;
    for (const auto& [s, t] : features)
        sum += (rotation * source.row(s).transpose() - target.row(t).transpose()).squaredNorm();
    return sum;
}

ParameterizationReport report_of(const Parameterization& p, std::size_t boundary_points) {
    return {p.unknowns, p.iterations, p.relative_residual, p.solve_seconds,
            static_cast<Index>(boundary_points)};
}

/// The rim of the disk.
void need_boundary(Side& side, const BoundaryLoop& given, const BoundaryOptions& options,
                   std::vector<std::string>& warnings, Progress& progress) {
    const Index count = side.find_boundary(given, options, progress);
    if (count == 0)
        throw TopologyError(
            side.cloud.name, "an open patch with a boundary", "a closed surface",
            "Take method auto, which needs no boundary; or domain sphere, for closed "
            "models without handles; or domain network with features all over both models; "
            "or list features in a loop, along which both models are cut; or give the rows of its "
            "boundary.");
    if (count > 1)
        warnings.push_back(side.cloud.name + ": the longest of " + std::to_string(count) +
                           " boundary loops goes to the rim of the disk, the others are treated "
                           "as holes in the patch.");
}

}  // namespace

DiskRoute match_in_disk(Side& source, Side& target, const MorphInput& input,
                        std::span<const Feature> marked, const MorphOptions& options,
                        MorphReport& report, Progress& progress) {
    progress.enter("boundary");
    need_boundary(source, input.source_boundary, options.boundary, report.warnings, progress);
    need_boundary(target, input.target_boundary, options.boundary, report.warnings, progress);
    if (!input.loop.empty())
        throw FeatureError("loop", "no loop for open patches, whose boundary is known",
                           "one of " + std::to_string(input.loop.size()) + " features",
                           "Leave the loop out.");

    progress.enter("parameterization");
    const auto& parameterization = options.parameterization;
    const std::vector<PointFeature> known =
        point_features(source, target, marked, options, report, progress);
    auto on_boundary = boundary_features(source, target, known);
    Side* const turnable = !target.normals_given   ? &target
                           : !source.normals_given ? &source
                                                   : nullptr;
    MatchedPins pins;
    const auto match = [&] {
        pins = match_pins(source.positions, source.loop, target.positions, target.loop,
                          parameterization.boundary_spacing, on_boundary);
    };
    try {
        match();
    } catch (const FeatureError&) {  // the order may only seem wrong, seen from the wrong side
        if (!turnable) throw;
        turnable->flip();
        on_boundary = boundary_features(source, target, known);
        match();
    }
    const auto onto_disk = [&](Side& side, std::span<const BoundaryPin> side_pins, double first,
                               double last) {
        const Progress::Part part(progress, first, last);
        const auto angles = boundary_angles(side.positions, side.loop,
                                            parameterization.boundary_spacing, side_pins);
        auto result = parameterize({side.positions, side.normals, side.nearest, side.cloud.name},
                                   {side.loop, angles}, parameterization, progress);
        (&side == &source ? report.source_parameterization : report.target_parameterization) =
            report_of(result, side.loop.size());
        side.nearest = {};
        return std::move(result.points);
    };
    DiskRoute route;
    route.source = onto_disk(source, pins.source, 0.0, 0.5);
    route.target = onto_disk(target, pins.target, 0.5, 1.0);

    progress.enter("alignment");
    std::vector<IndexPair> features;
    for (const PointFeature& feature : known) features.push_back(feature.rows);
    if (features.size() >= 3 && on_boundary.empty()) {
        DiskPoints mirrored = route.target;
        mirrored.col(1) *= -1.0;
        const double straight = misfit(route.source, route.target, features);
        if (misfit(route.source, mirrored, features) < kMirrorFactor * kMirrorFactor * straight) {
            if (turnable) {
                turnable->flip();
                (turnable == &source ? route.source : route.target).col(1) *= -1.0;
            } else {
                report.warnings.emplace_back(
                    "The features fit much better when one model is mirrored: check that left and "
                    "right are not swapped and that the normals of both point outwards.");
            }
        }
    }
    const Alignment alignment = align_features(route.source, route.target, features,
                                               !on_boundary.empty(), options.alignment, progress);

    report.feature_residual = alignment.residual;
    report.alignment_rotation = alignment.rotation;
    report.alignment_sweeps = alignment.sweeps;

    progress.enter("pairing");
    route.pairs = pair_points<2>(route.source, route.target, features, options.pairing, progress);
    return route;
}

}  // namespace pointmorph

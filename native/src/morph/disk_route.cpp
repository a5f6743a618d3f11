#include "morph/disk_route.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <unordered_map>
#include <utility>

#include "morph/point_features.hpp"
#include "morph/words.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

/// Mirroring one disk must bring the features this much closer before estimated normals are taken
/// to point inward on one side.
constexpr double kMirrorFactor = 0.5;

/// One of the two patches, seen from the side that its normals face.
struct DiskPatch {
    const PreparedShape& shape;
    Normals normals;
    BoundaryLoop rim;
    bool normals_reversed = false;

    DiskPatch(const PreparedShape& patch, const Boundary& boundary)
        : shape(patch), normals(patch.normals), rim(boundary.loop) {
        if (rim.empty())
            throw TopologyError(shape.name, "an open surface with a boundary", "a closed surface",
                                "Use method auto, which needs no boundary; or domain sphere, for "
                                "closed models without handles; or domain network, with features "
                                "all over both models; or list features in a loop, along which "
                                "both models are cut; or give the rows of its boundary.");
    }

    void reverse_normals() {
        normals = -normals;
        std::reverse(rim.begin(), rim.end());
        normals_reversed = !normals_reversed;
    }
};

/// Where the features on the boundary are in their rims. A feature lies on both boundaries or on
/// neither.
std::vector<IndexPair> boundary_features(const DiskPatch& source, const DiskPatch& target,
                                         std::span<const PointFeature> features) {
    const auto places_in = [](const DiskPatch& patch) {
        std::unordered_map<Index, Index> result;
        for (std::size_t i = 0; i < patch.rim.size(); ++i)
            result.emplace(patch.rim[i], to_index(i));
        return result;
    };
    const auto on_source = places_in(source), on_target = places_in(target);
    std::vector<IndexPair> result;
    for (const PointFeature& feature : features) {
        const auto s = on_source.find(feature.rows.source);
        const auto t = on_target.find(feature.rows.target);
        if ((s == on_source.end()) != (t == on_target.end())) {
            const bool source_has_it = s != on_source.end();
            const std::string& has = (source_has_it ? source : target).shape.name;
            const std::string& lacks = (source_has_it ? target : source).shape.name;
            throw FeatureError(
                "feature \"" + feature.name + "\"", "a place on both boundaries or on neither",
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

bool fits_better_mirrored(const DiskPoints& source, const DiskPoints& target,
                          std::span<const IndexPair> features) {
    DiskPoints mirrored = target;
    mirrored.col(1) *= -1.0;
    return misfit(source, mirrored, features) <
           kMirrorFactor * kMirrorFactor * misfit(source, target, features);
}

/// Onto the disk with the rim at the angles that `pins` ask for.
DiskPoints on_disk(const DiskPatch& patch, std::span<const BoundaryPin> pins,
                   const ParameterizationOptions& options, ParameterizationReport& facts,
                   Progress& progress) {
    const PreparedShape& shape = patch.shape;
    const auto angles = boundary_angles(shape.positions, patch.rim, options.boundary_spacing, pins);
    auto result = parameterize({shape.positions, patch.normals, shape.nearest, shape.name},
                               {patch.rim, angles}, options, progress);
    facts = {result.unknowns, result.iterations, result.relative_residual, result.solve_seconds,
             to_index(patch.rim.size())};
    return std::move(result.points);
}

void warn_of_holes(const PreparedShape& shape, const Boundary& boundary,
                   std::vector<std::string>& warnings) {
    if (boundary.found > 1) warnings.push_back(patch_has_holes(shape.name, boundary.found));
}

}  // namespace

RouteResult match_in_disk(const RouteInput& input, const Boundary& source_boundary,
                          const Boundary& target_boundary, const DiskRouteOptions& options,
                          Progress& progress) {
    RouteResult result;
    result.domain = "disk";
    DiskPatch source(input.source, source_boundary), target(input.target, target_boundary);
    warn_of_holes(input.source, source_boundary, result.warnings);
    warn_of_holes(input.target, target_boundary, result.warnings);

    progress.enter("parameterization");
    const std::vector<PointFeature> known =
        point_features(input, {source.rim, target.rim}, progress);
    auto on_boundary = boundary_features(source, target, known);
    DiskPatch* const reversible = !target.shape.normals_given   ? &target
                                  : !source.shape.normals_given ? &source
                                                                : nullptr;
    MatchedPins pins;
    const auto match = [&] {
        pins = match_pins(source.shape.positions, source.rim, target.shape.positions, target.rim,
                          options.parameterization.boundary_spacing, on_boundary);
    };
    try {
        match();
    } catch (const FeatureError&) {  // the order may only seem wrong, seen from the wrong side
        if (!reversible) throw;
        reversible->reverse_normals();
        on_boundary = boundary_features(source, target, known);
        match();
    }
    DiskPoints source_disk, target_disk;
    on_both(progress, [&](bool is_source, Progress& its) {
        RouteFacts& facts = result.facts;
        if (is_source)
            source_disk = on_disk(source, pins.source, options.parameterization,
                                  facts.source_parameterization, its);
        else
            target_disk = on_disk(target, pins.target, options.parameterization,
                                  facts.target_parameterization, its);
    });

    progress.enter("alignment");
    const std::vector<IndexPair> features = rows_of(known);
    if (features.size() >= 3 && on_boundary.empty() &&
        fits_better_mirrored(source_disk, target_disk, features)) {
        if (reversible) {
            reversible->reverse_normals();
            (reversible == &source ? source_disk : target_disk).col(1) *= -1.0;
        } else {
            result.warnings.push_back(fits_mirrored("The features fit"));
        }
    }
    const Alignment alignment = align_features(source_disk, target_disk, features,
                                               !on_boundary.empty(), options.alignment, progress);
    result.facts.feature_residual = alignment.residual;
    result.facts.alignment_rotation = alignment.rotation;
    result.facts.alignment_sweeps = alignment.sweeps;

    progress.enter("pairing");
    result.pairs = pair_points<2>(source_disk, target_disk, features, options.pairing, progress);
    result.source_domain = source_disk;
    result.target_domain = target_disk;
    result.source_boundary = std::move(source.rim);
    result.target_boundary = std::move(target.rim);
    result.source_is_inside_out = source.normals_reversed;
    result.target_is_inside_out = target.normals_reversed;
    return result;
}

}  // namespace pointmorph

#include "morph/sphere_route.hpp"

#include <algorithm>
#include <string>
#include <vector>

#include "morph/point_features.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/sphere/spherical_alignment.hpp"
#include "pointmorph/sphere/spherical_parameterization.hpp"

namespace pointmorph {

namespace {

void need_closed(Side& side, const BoundaryLoop& given, const BoundaryOptions& options,
                 Progress& progress) {
    side.find_boundary(given, options, progress);
    const bool open = side.is_open();
    side.loop.clear();
    if (open)
        throw TopologyError(side.cloud.name, "a closed surface for domain sphere", "an open patch",
                            "Take domain disk for open patches, or method auto with domain auto, "
                            "which asks nothing of the topology.");
}

}  // namespace

SphereRoute match_on_sphere(Side& source, Side& target, const MorphInput& input,
                            std::span<const Feature> marked, const MorphOptions& options,
                            MorphReport& report, Progress& progress) {
    progress.enter("boundary");
    need_closed(source, input.source_boundary, options.boundary, progress);
    need_closed(target, input.target_boundary, options.boundary, progress);

    progress.enter("spherical parameterization");
    const std::vector<PointFeature> known =
        point_features(source, target, marked, options, report, progress);
    const auto mesh_of = [&](const Side& side, Index IndexPair::*row, double first, double last) {
        const Progress::Part part(progress, first, last);
        std::vector<Index> rows;
        for (const PointFeature& f : known) rows.push_back(f.rows.*row);
        SphericalMesh mesh =
            spherical_mesh({side.positions, side.normals, side.nearest, side.cloud.name}, rows,
                           options.spherical_parameterization, progress);
        if (mesh.loose > 0)
            report.warnings.push_back(side.cloud.name + ": " + std::to_string(mesh.loose) +
                                      " points in separate parts go with the nearest places of the "
                                      "largest part.");
        return mesh;
    };
    SphericalMesh source_mesh = mesh_of(source, &IndexPair::source, 0.0, 0.5);
    SphericalMesh target_mesh = mesh_of(target, &IndexPair::target, 0.5, 1.0);

    progress.enter("spherical alignment");
    std::vector<IndexPair> meet, features;
    for (const PointFeature& f : known) {
        const auto k = static_cast<Index>(meet.size());
        meet.push_back({k, k});
        features.push_back(f.rows);
    }
    const SphericalAlignment alignment =
        align_on_sphere(source_mesh, target_mesh, meet, options.spherical_alignment, progress);
    report.alignment_sweeps = alignment.steps;
    for (const auto& [s, t] : alignment.tips)
        report.tips.push_back({source.order[to_size(source_mesh.rows[to_size(s)])],
                               target.order[to_size(target_mesh.rows[to_size(t)])]});
    if (alignment.searched)
        report.warnings.emplace_back(
            "Fewer than three places are marked: how " + source.cloud.name + " lies to " +
            target.cloud.name +
            " on the sphere was found by trying. Mark three or more if it is wrong.");

    // Maps that are right have 2.4 to 4 between models of one kind; exchanged marks and limbs that
    // are twisted about their axis have more.
    constexpr double kMuch = 4.5;
    if (alignment.energy > kMuch)
        report.warnings.emplace_back(
            "The map over the sphere is stretched much: limbs may have arrived twisted, or marks "
            "may "
            "be exchanged. Mark more places around the limbs, or take domain auto.");

    SphereRoute route;
    route.source = onto_sphere(source_mesh, source.positions, source.normals, progress);
    route.target = onto_sphere(target_mesh, target.positions, target.normals, progress);

    progress.enter("pairing");
    route.pairs = pair_points<3>(route.source, route.target, features, options.pairing, progress);
    return route;
}

}  // namespace pointmorph

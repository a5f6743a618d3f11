#include "morph/sphere_route.hpp"

#include <algorithm>
#include <string>
#include <vector>

#include "morph/point_features.hpp"
#include "morph/words.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

SphericalMesh mesh_of(const PreparedShape& shape, std::span<const Index> features,
                      const SphericalOptions& options, std::vector<std::string>& warnings,
                      Progress& progress) {
    SphericalMesh mesh = spherical_mesh(shape.surface(), features, options, progress);
    if (mesh.loose > 0) warnings.push_back(separate_parts(shape.name, mesh.loose));
    return mesh;
}

}  // namespace

RouteResult match_on_sphere(const RouteInput& input, const SphereRouteOptions& options,
                            Progress& progress) {
    const PreparedShape &source = input.source, &target = input.target;
    RouteResult result;
    result.domain = "sphere";
    progress.enter("spherical parameterization");
    const std::vector<IndexPair> features = rows_of(point_features(input, {}, progress));
    const auto mesh = [&](const PreparedShape& shape, Index IndexPair::*row, double first,
                          double last) {
        const Progress::Part part(progress, first, last);
        std::vector<Index> rows;
        for (const IndexPair& f : features) rows.push_back(f.*row);
        return mesh_of(shape, rows, options.parameterization, result.warnings, progress);
    };
    SphericalMesh source_mesh = mesh(source, &IndexPair::source, 0.0, 0.5);
    SphericalMesh target_mesh = mesh(target, &IndexPair::target, 0.5, 1.0);

    progress.enter("spherical alignment");
    std::vector<IndexPair> meet;  // the features are the meshes' first nodes
    for (Index k = 0; k < to_index(features.size()); ++k) meet.push_back({k, k});
    const SphericalAlignment alignment =
        align_on_sphere(source_mesh, target_mesh, meet, options.alignment, progress);
    result.facts.alignment_sweeps = alignment.steps;
    for (const auto& [s, t] : alignment.extremities)
        result.facts.extremities.push_back(
            {source_mesh.rows[to_size(s)], target_mesh.rows[to_size(t)]});
    if (alignment.searched)
        result.warnings.push_back(orientation_was_searched(source.name, target.name));

    // Maps that are right have 2.4 to 4 between models of one kind; exchanged marks and limbs that
    // are twisted about their axis have more.
    constexpr double kMuch = 4.5;
    if (alignment.energy > kMuch) result.warnings.push_back(sphere_is_stretched());

    const KdTree<3>::Points source_sphere =
        onto_sphere(source_mesh, source.positions, source.normals, progress);
    const KdTree<3>::Points target_sphere =
        onto_sphere(target_mesh, target.positions, target.normals, progress);
    progress.enter("pairing");
    result.pairs =
        pair_points<3>(source_sphere, target_sphere, features, options.pairing, progress);
    result.source_domain = source_sphere;
    result.target_domain = target_sphere;
    return result;
}

}  // namespace pointmorph

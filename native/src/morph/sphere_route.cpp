#include "morph/sphere_route.hpp"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "morph/point_features.hpp"
#include "morph/words.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

RouteResult match_on_sphere(const RouteInput& input, const SphereRouteOptions& options,
                            Progress& progress) {
    const PreparedShape &source = input.source, &target = input.target;
    RouteResult result;
    result.domain = "sphere";
    progress.enter("spherical parameterization");
    const std::vector<IndexPair> features = rows_of(point_features(input, {}, progress));
    SphericalMesh source_mesh, target_mesh;
    on_both(progress, [&](bool is_source, Progress& its) {
        std::vector<Index> rows;
        for (const IndexPair& f : features) rows.push_back(is_source ? f.source : f.target);
        const PreparedShape& shape = is_source ? source : target;
        (is_source ? source_mesh : target_mesh) = spherical_mesh(
            shape.surface(), rows, options.parameterization, its, shape.kept_tree.get());
    });
    if (source_mesh.loose > 0)
        result.warnings.push_back(separate_parts(source.name, source_mesh.loose));
    if (target_mesh.loose > 0)
        result.warnings.push_back(separate_parts(target.name, target_mesh.loose));

    progress.enter("spherical alignment");
    std::vector<IndexPair> meet;  // the features are the meshes' first nodes
    for (Index k = 0; k < to_index(features.size()); ++k) meet.push_back({k, k});
    const MeshPlaces in_source(source_mesh), in_target(target_mesh);
    std::vector<PlaceInMesh> source_places(to_size(source.size())),
        target_places(to_size(target.size()));
    const auto find_places = [&](bool is_source, Index part, Index parts, Progress& its) {
        const PreparedShape& shape = is_source ? source : target;
        const auto row = [&](Index k) { return to_index(std::int64_t{shape.size()} * k / parts); };
        (is_source ? in_source : in_target)
            .find(shape.positions, shape.normals, row(part), row(part + 1),
                  is_source ? source_places : target_places, its);
    };
    // Alignment doesn't change where points lie in the meshes. Small parts of them, so that the
    // thread that aligns takes some when it is done. Many points take all threads.
    constexpr Index kMany = 1'000'000, kParts = 16;
    const bool are_many = source.size() + target.size() >= kMany;
    std::atomic<Index> next{0};
    const auto take_parts = [&](Progress& its) {
        for (Index k = next++; k < 2 * kParts; k = next++) {
            const Progress::Part part(its, k / (2.0 * kParts), (k + 1) / (2.0 * kParts));
            find_places(k < kParts, k % kParts, kParts, its);
        }
    };
    const WorkBeside beside = are_many ? WorkBeside{} : WorkBeside{take_parts, take_parts};
    SphericalAlignment alignment;
    {
        const Progress::Part part(progress, 0.0, are_many ? 0.9 : 1.0);
        alignment =
            align_on_sphere(source_mesh, target_mesh, meet, options.alignment, progress, beside);
    }
    if (are_many)
        for (const bool is_source : {true, false}) {
            const Progress::Part part(progress, is_source ? 0.9 : 0.95, is_source ? 0.95 : 1.0);
            find_places(is_source, 0, 1, progress);
        }
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

    KdTree<3>::Points source_sphere, target_sphere;
    on_both(progress, [&](bool is_source, Progress&) {
        const SphericalMesh& mesh = is_source ? source_mesh : target_mesh;
        auto& sphere = is_source ? source_sphere : target_sphere;
        sphere = onto_sphere(mesh, is_source ? source_places : target_places);
        (is_source ? result.source_domain : result.target_domain) = sphere;
    });
    progress.enter("pairing");
    result.pairs =
        pair_points<3>(source_sphere, target_sphere, features, options.pairing, progress);
    return result;
}

}  // namespace pointmorph

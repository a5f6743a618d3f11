#include "pointmorph/morph/network_preview.hpp"

#include <array>
#include <utility>

#include "morph/input_checks.hpp"
#include "morph/mesh_side.hpp"
#include "morph/network_route.hpp"
#include "morph/prepared_shape.hpp"
#include "morph/routes.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

NamedNetwork preview_network(const MorphInput& given, const MorphOptions& given_options,
                             Progress& progress) {
    MorphOptions options = given_options;
    options.domain = Domain::kNetwork;
    const ThreadCount threads(options.threads);
    progress.enter("cloud");
    check_shapes(given, options);
    check_loops(given, options);
    check_start(given.start, given.source, given.target);
    if (options.method == Method::kPaper) check_for_paper(given.features);
    const MeshSides meshes = mesh_sides(given, options, progress);
    const MorphInput input = sampled_input(given, meshes);
    const PreparedShapes shapes = prepare_both(input, preparation(options), progress);
    const auto& [source, target] = shapes;
    require_closed(Closed::kNetwork, shapes, input, options, progress);
    const std::vector<Feature> features =
        canonical(input.features, source.sorted_rows, target.sorted_rows);
    check_places(features, source, target);
    TracedNetwork traced = traced_network({source, target, features}, loops_of(input),
                                          options.decomposition, progress);
    progress.finish();

    NamedNetwork result{std::move(traced.network), std::move(traced.names)};
    const auto give_back = [&](std::size_t m, const PreparedShape& shape,
                               const std::optional<MeshSide>& mesh) {
        for (NetworkCurve& curve : result.network.curves)
            curve.on[m].points = shape.unit.restore(curve.on[m].points);
        std::vector<Index>& labels = result.network.labels[m];
        labels = gather(labels, shape.sorted_rows);
        if (mesh) labels = gather(labels, mesh->samples_of_vertices());
    };
    give_back(0, source, meshes.source);
    give_back(1, target, meshes.target);
    return result;
}

}  // namespace pointmorph

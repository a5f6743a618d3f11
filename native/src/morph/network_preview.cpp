#include "pointmorph/morph/network_preview.hpp"

#include <array>
#include <utility>

#include "morph/input_checks.hpp"
#include "morph/network_route.hpp"
#include "morph/prepared_shape.hpp"
#include "morph/routes.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

NamedNetwork preview_network(const MorphInput& input, const MorphOptions& given_options,
                             Progress& progress) {
    MorphOptions options = given_options;
    options.domain = Domain::kNetwork;
    const ThreadCount threads(options.threads);
    progress.enter("cloud");
    check_shapes(input, options);
    check_loops(input, options);
    if (options.method == Method::kPaper) check_for_paper(input.features);
    const auto [source, target] =
        prepare_both({input.source, input.source_parts}, {input.target, input.target_parts},
                     {.neighbors = options.covariance_neighbors,
                      .boundary = options.boundary,
                      .topology = options.topology},
                     progress);
    progress.enter("boundary");
    require_closed(Closed::kNetwork, source, {}, options.boundary, progress);
    require_closed(Closed::kNetwork, target, {}, options.boundary, progress);
    const std::vector<Feature> features =
        canonical(input.features, source.sorted_rows, target.sorted_rows);
    check_places(features, source, target);
    TracedNetwork traced = traced_network({source, target, features}, loops_of(input),
                                          options.decomposition, progress);
    progress.finish();

    NamedNetwork result{std::move(traced.network), std::move(traced.names)};
    const std::array<const PreparedShape*, 2> shapes{&source, &target};
    for (const std::size_t m : {0u, 1u}) {
        for (NetworkCurve& curve : result.network.curves)
            curve.on[m].points = shapes[m]->unit.restore(curve.on[m].points);
        std::vector<Index> labels;
        for (const Index sorted : shapes[m]->sorted_rows)
            labels.push_back(result.network.labels[m][to_size(sorted)]);
        result.network.labels[m] = std::move(labels);
    }
    return result;
}

}  // namespace pointmorph

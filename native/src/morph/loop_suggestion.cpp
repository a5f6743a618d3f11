#include "pointmorph/morph/loop_suggestion.hpp"

#include "morph/input_checks.hpp"
#include "morph/prepared_shape.hpp"
#include "morph/routes.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

std::vector<std::string> suggest_loop(const MorphInput& input, const MorphOptions& options,
                                      Progress& progress) {
    const ThreadCount threads(options.threads);
    progress.enter("cloud");
    check_shapes(input, options);
    const auto [source, target] = prepare_both(
        {input.source}, {input.target},
        {.neighbors = options.covariance_neighbors, .boundary = options.boundary}, progress);
    progress.enter("boundary");
    require_closed(Closed::kLoop, source, {}, options.boundary, progress);
    require_closed(Closed::kLoop, target, {}, options.boundary, progress);
    progress.enter("decomposition");
    const std::vector<Feature> features =
        canonical(input.features, source.sorted_rows, target.sorted_rows);
    std::vector<std::string> loop =
        loop_through({source, target, features}, options.decomposition, progress);
    progress.finish();
    return loop;
}

}  // namespace pointmorph

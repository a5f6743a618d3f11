#include "pointmorph/morph/loop_suggestion.hpp"

#include "morph/input_checks.hpp"
#include "morph/mesh_side.hpp"
#include "morph/prepared_shape.hpp"
#include "morph/routes.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

std::vector<std::string> suggest_loop(const MorphInput& given, const MorphOptions& options,
                                      Progress& progress) {
    const ThreadCount threads(options.threads);
    progress.enter("cloud");
    check_shapes(given, options);
    check_start(given.start, given.source, given.target);
    const MorphInput input = sampled_input(given, mesh_sides(given, options, progress));
    const PreparedShapes shapes = prepare_both(input, preparation(options), progress);
    require_closed(Closed::kLoop, shapes, input, options, progress);
    progress.enter("decomposition");
    const std::vector<Feature> features =
        canonical(input.features, shapes.source.sorted_rows, shapes.target.sorted_rows);
    const RouteInput both{shapes.source, shapes.target, features};
    const CutGrounds grounds(both, single_points(features), options.decomposition, progress);
    std::vector<std::string> loop = loop_through(both, grounds);
    progress.finish();
    return loop;
}

}  // namespace pointmorph

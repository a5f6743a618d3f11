#include "pointmorph/morph/cut_preview.hpp"

#include <utility>
#include <vector>

#include "morph/input_checks.hpp"
#include "morph/prepared_shape.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

Decomposition preview_cut(const Cloud& cloud, std::span<const Index> loop,
                          std::span<const std::string> names, const MorphOptions& options,
                          Progress& progress) {
    const ThreadCount threads(options.threads);
    progress.enter("cloud");
    validate(cloud, kMinimumPoints);
    std::vector<Feature> features;
    for (std::size_t k = 0; k < loop.size(); ++k)
        features.push_back(point_feature(names[k], loop[k], loop[k]));
    validate(features, cloud, cloud);
    check_loop(names, features);
    const PreparedShape shape =
        prepare({cloud}, {.neighbors = options.covariance_neighbors, .boundary = options.boundary},
                progress);
    progress.enter("boundary");
    require_closed(Closed::kLoop, shape, {}, options.boundary, progress);

    progress.enter("decomposition");
    std::vector<Index> rows;
    for (const Index given : loop) rows.push_back(shape.sorted_rows[to_size(given)]);
    Decomposition cut = decompose(shape.surface(), KdTree<3>(shape.positions), {rows, names},
                                  options.decomposition, progress);
    progress.finish();
    cut.curve.points = shape.unit.restore(cut.curve.points);
    std::vector<Patch> patches;
    for (const Index sorted : shape.sorted_rows) patches.push_back(cut.patches[to_size(sorted)]);
    cut.patches = std::move(patches);
    return cut;
}

}  // namespace pointmorph

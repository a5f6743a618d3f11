#include "pointmorph/morph/cut_preview.hpp"

#include <utility>
#include <vector>

#include "morph/input_checks.hpp"
#include "morph/mesh_side.hpp"
#include "morph/prepared_shape.hpp"
#include "morph/routes.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

CutPreview preview_cut(const Cloud& cloud, std::span<const Index> loop,
                       std::span<const std::string> names, const MorphOptions& options,
                       Progress& progress) {
    const ThreadCount threads(options.threads);
    progress.enter("cloud");
    validate(cloud, is_sampled(cloud, options) ? 0 : kMinimumPoints);
    std::vector<Feature> features;
    for (std::size_t k = 0; k < loop.size(); ++k)
        features.push_back(point_feature(names[k], loop[k], loop[k]));
    validate(features, cloud, cloud);
    check_loop(names, features);
    const auto mesh = mesh_side(cloud, features, &Feature::source, options, progress);
    const Cloud samples = mesh ? mesh->sampled(cloud) : Cloud{};
    const MeshSamples of_faces = mesh ? mesh->samples() : MeshSamples{};
    const std::vector<PartCounts> counts =
        mesh ? count_parts(mesh->mesh()) : std::vector<PartCounts>{};
    std::vector<Index> marked;
    for (const Feature& f : features)
        marked.push_back((mesh ? mesh->sampled(f, f.source) : f.source).rows.front());
    const PreparedShape shape = prepare({mesh ? samples : cloud, of_faces.parts, counts, marked},
                                        preparation(options), progress);
    progress.enter("boundary");
    require_closed(Closed::kLoop, shape, of_faces.border, options.boundary, progress);

    progress.enter("decomposition");
    std::vector<Index> rows;
    for (const Index row : marked) rows.push_back(shape.sorted_rows[to_size(row)]);
    Decomposition cut = decompose(shape.surface(), KdTree<3>(shape.positions), {rows, names},
                                  options.decomposition, progress);
    progress.finish();
    cut.curve.points = shape.unit.restore(cut.curve.points);
    cut.patches = gather(cut.patches, shape.sorted_rows);
    if (mesh) cut.patches = gather(cut.patches, mesh->samples_of_vertices());
    return {std::move(cut.curve), std::move(cut.corners), std::move(cut.patches)};
}

}  // namespace pointmorph

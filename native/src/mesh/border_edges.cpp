#include "mesh/border_edges.hpp"

#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

std::vector<char> beyond_ends(const Mesh& mesh, const TriangleTree& tree, const Positions& x,
                              const Normals& normals, Progress& progress) {
    constexpr double kBeyond = 0.01;
    const BorderEdges borders(mesh);
    std::vector<char> is_beyond(to_size(x.rows()), 0);
    parallel_for(to_index(x.rows()), progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v) {
            const SurfacePoint point = tree.closest(x.row(v).transpose());
            is_beyond[to_size(v)] =
                point.squared_distance > kBeyond * kBeyond &&
                (borders.hold(point) || mesh.normals.row(point.triangle).dot(normals.row(v)) < 0.0);
        }
    });
    return is_beyond;
}

}  // namespace pointmorph

#include "mesh/mesh_patches.hpp"

#include <algorithm>
#include <utility>

namespace pointmorph {

std::vector<MeshPatch> patches_around(const Mesh& mesh, const ElasticSheet& sheet,
                                      const std::vector<Index>& faces,
                                      const std::vector<char>& is_fixed, int rings) {
    std::vector<char> inside(to_size(mesh.triangles.rows()), 0);
    std::vector<Index> front = faces;
    for (const Index f : faces) inside[to_size(f)] = 1;
    // Each vertex is passed once, however many faces meet at it.
    std::vector<char> passed(to_size(mesh.positions.rows()), 0);
    for (int ring = 0; ring < rings; ++ring) {
        std::vector<Index> next;
        for (const Index f : front)
            for (const Index v : mesh.triangles.row(f)) {
                if (std::exchange(passed[to_size(v)], 1)) continue;
                for (const Index c : sheet.around(v))
                    if (!std::exchange(inside[to_size(c / 3)], 1)) next.push_back(c / 3);
            }
        front = std::move(next);
    }
    std::vector<MeshPatch> patches;
    passed.assign(passed.size(), 0);
    for (const Index seed : faces) {
        if (inside[to_size(seed)] != 1) continue;
        MeshPatch& patch = patches.emplace_back();
        patch.faces.push_back(seed);
        inside[to_size(seed)] = 2;
        for (std::size_t next = 0; next < patch.faces.size(); ++next)
            for (Index k = 0; k < 3; ++k) {
                const Index v = mesh.triangles(patch.faces[next], k);
                if (std::exchange(passed[to_size(v)], 1)) continue;
                bool is_inner = true;
                for (const Index c : sheet.around(v)) {
                    is_inner = is_inner && inside[to_size(c / 3)] != 0;
                    if (inside[to_size(c / 3)] != 1) continue;
                    inside[to_size(c / 3)] = 2;
                    patch.faces.push_back(c / 3);
                }
                if (is_inner && !is_fixed[to_size(v)]) patch.vertices.push_back(v);
            }
        std::ranges::sort(patch.faces);
        std::ranges::sort(patch.vertices);
    }
    return patches;
}

}  // namespace pointmorph

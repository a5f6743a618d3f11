// Which points of a mesh lie on its borders, and which places beyond them. Not for callers of the
// library.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "pointmorph/mesh/closest_point.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

class BorderEdges {
public:
    /// Keeps a reference to the mesh.
    explicit BorderEdges(const Mesh& mesh) : mesh_(mesh) {
        for (const std::vector<Index>& border : mesh.borders)
            for (std::size_t k = 0; k < border.size(); ++k) {
                const Index a = border[k], b = border[(k + 1) % border.size()];
                edges_.push_back({std::min(a, b), std::max(a, b)});
                edges_.push_back({a, a});
            }
        std::ranges::sort(edges_);
    }

    bool empty() const { return edges_.empty(); }

    /// Whether a point of the mesh lies on one of these edges or corners.
    bool hold(const SurfacePoint& point) const {
        constexpr double kNone = 1e-9;
        const auto corners = mesh_.triangles.row(point.triangle);
        for (Index k = 0; k < 3; ++k) {
            const Index own = corners[k];
            if (point.weights[k] >= 1.0 - kNone &&
                std::ranges::binary_search(edges_, std::array{own, own}))
                return true;
            const Index a = corners[(k + 1) % 3], b = corners[(k + 2) % 3];
            if (point.weights[k] <= kNone &&
                std::ranges::binary_search(edges_, std::array{std::min(a, b), std::max(a, b)}))
                return true;
        }
        return false;
    }

private:
    const Mesh& mesh_;
    /// Corners of edges along borders, the lower row first, and each corner with itself; ascending.
    std::vector<std::array<Index, 2>> edges_;
};

/// Of each place, facing so, whether it is beyond an end of a mesh: more than 0.01 from its nearest
/// point, which is on a border, or on a face that shows its inside: that of the other wall, across
/// an opening. `tree` holds the triangles of the mesh, in the lengths of `x`.
std::vector<char> beyond_ends(const Mesh& mesh, const TriangleTree& tree, const Positions& x,
                              const Normals& normals, Progress& progress);

}  // namespace pointmorph

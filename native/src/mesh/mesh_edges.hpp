// The edges of triangles, and the triangles at each. Not for callers of the library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

class MeshEdges {
public:
    explicit MeshEdges(const Triangles& triangles);

    /// Side k of triangle f runs from its corner k to the next one.
    struct Side {
        Index triangle;
        Index k;
    };

    Index size() const { return to_index(offsets_.size()) - 1; }
    std::span<const Side> operator[](Index edge) const {
        return {sides_.data() + offsets_[to_size(edge)],
                sides_.data() + offsets_[to_size(edge) + 1]};
    }
    /// The edge of side k of a triangle.
    Index edge_of(Index triangle, Index k) const { return edges_[to_size(3 * triangle + k)]; }

private:
    std::vector<Index> offsets_{0};
    std::vector<Side> sides_;   ///< edge by edge, ascending
    std::vector<Index> edges_;  ///< of each side
};

/// The corner at the start of a side, and that at its end.
inline Index start_of(const Triangles& triangles, MeshEdges::Side side) {
    return triangles(side.triangle, side.k);
}
inline Index end_of(const Triangles& triangles, MeshEdges::Side side) {
    return triangles(side.triangle, (side.k + 1) % 3);
}

}  // namespace pointmorph

// A closed triangulated surface that may be taken apart and put together again, as combinatorics;
// not for callers of the library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/surface/local_triangles.hpp"

namespace pointmorph {

/// Around each vertex, the ring of its neighbors anticlockwise seen from outside: vertex v and two
/// neighbors that follow each other make a triangle. Every operation keeps the surface closed and
/// of its genus.
class RingMesh {
public:
    /// With `count` vertices, of which six, `corners`, are those of an octahedron: +x, −x, +y, −y,
    /// +z, −z. The others have no triangles yet.
    RingMesh(Index count, std::span<const Index, 6> corners);

    std::span<const Index> ring(Index v) const { return rings_[to_size(v)]; }
    bool joined(Index a, Index b) const;
    /// Corners of the triangles left and right of the edge from a to b.
    Index left_of(Index a, Index b) const;
    Index right_of(Index a, Index b) const;

    /// Each once, its lowest vertex first.
    std::vector<Triangle> triangles() const;

    /// A new vertex in the triangle a, b, c.
    void insert(Index v, Index a, Index b, Index c);

    /// Whether the edge can be replaced by that between the corners left and right of it: these
    /// aren't joined, and no vertex is left with fewer than three neighbors.
    bool can_flip(Index a, Index b) const;
    void flip(Index a, Index b);

    /// What was there before a vertex was drawn into `ring.front()`, one of its neighbors.
    struct Removal {
        Index vertex;
        std::vector<Index> ring;
    };
    bool can_remove(Index v, Index into) const;
    Removal remove(Index v, Index into);
    /// Undoes the last removal that hasn't been undone.
    void restore(const Removal& removal);

private:
    std::vector<Index>& at(Index v) { return rings_[to_size(v)]; }
    std::vector<std::vector<Index>> rings_;
};

}  // namespace pointmorph

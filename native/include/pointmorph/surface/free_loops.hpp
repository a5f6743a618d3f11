// Stage `free_loops`: how many loops in a complex of triangles bound nothing.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// Vertices, edges and triangles, put together from simplices.
class Complex {
public:
    explicit Complex(Index vertices);
    /// The edges of a graph, symmetric and ascending, and all triangles that they make.
    explicit Complex(const Neighborhoods& graph);

    Index size() const { return to_index(edges_.size()); }
    Index add_vertex();

    /// All edges and triangles of a set of vertices, ascending, none twice. What is there already
    /// isn't added again.
    void add(std::span<const Index> simplex);

    /// Vertices next to each, ascending.
    Neighborhoods neighbors() const;

private:
    friend struct EdgeLoops;
    friend struct FreeLoops;

    // Of each vertex, some of them more than once: those of higher number that it has an edge with,
    // and, both in one number so that they sort quickly, the two that it has a triangle with.
    std::vector<std::vector<Index>> edges_;
    std::vector<std::vector<std::uint64_t>> triangles_;
};

/// What edges come to where those of every triangle come to nothing, over two elements: sums of
/// some of `count` free loops. The edges of a loop come to nothing exactly where triangles span it.
struct EdgeLoops {
    Index count = 0;  ///< the first Betti number
    /// Of `complex.neighbors()`, edge by edge, the same both ways: ascending numbers below `count`.
    std::vector<std::vector<Index>> sums;

    explicit EdgeLoops(const Complex& complex);
};

/// Loops that no triangles span, counted over two elements: a loop and another one around the same
/// are one, and two of them together a third that isn't counted.
struct FreeLoops {
    Index all = 0;  ///< the first Betti number
    /// Those that are left where every loop of three or four edges is taken to be spanned.
    Index wide = 0;

    explicit FreeLoops(const Complex& complex);
};

}  // namespace pointmorph

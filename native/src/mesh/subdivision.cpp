#include "pointmorph/mesh/subdivision.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "mesh/mesh_edges.hpp"

namespace pointmorph {

namespace {

double edge_length(const Positions& positions, const Triangles& triangles, MeshEdges::Side side) {
    return (positions.row(start_of(triangles, side)) - positions.row(end_of(triangles, side)))
        .norm();
}

/// The pieces of a triangle, some sides of which have a middle (at `p` or −1).
void cut(const Positions& p, Index triangle, const std::array<Index, 6>& rows,
         std::vector<Piece>& out) {
    Index halved = 0, first = 0;
    const auto is_halved = [&](Index k) { return rows[to_size(3 + k)] >= 0; };
    for (Index k = 0; k < 3; ++k) halved += is_halved(k);
    // The corner from which to count: that before the one halved side, or that between two.
    for (Index k = 0; k < 3; ++k) {
        const bool here = is_halved(k), before = is_halved((k + 2) % 3);
        if ((halved == 1 && here) || (halved == 2 && here && before)) first = k;
    }
    const auto corner = [&](Index k) { return (first + k) % 3; };
    const auto mid = [&](Index k) { return 3 + (first + k) % 3; };
    const auto add = [&](Index i, Index j, Index k) { out.push_back({triangle, {i, j, k}}); };
    const auto squared = [&](Index i, Index j) {
        return (p.row(rows[to_size(i)]) - p.row(rows[to_size(j)])).squaredNorm();
    };
    const Index a = corner(0), b = corner(1), c = corner(2);
    const Index ab = mid(0), bc = mid(1), ca = mid(2);
    if (halved == 0) {
        add(a, b, c);
    } else if (halved == 1) {
        add(a, ab, c);
        add(ab, b, c);
    } else if (halved == 2) {  // sides a b and c a; the rest along its shorter diagonal
        add(a, ab, ca);
        const bool from_middle = squared(ab, c) <= squared(b, ca);
        add(ab, b, from_middle ? c : ca);
        if (from_middle)
            add(ab, c, ca);
        else
            add(b, c, ca);
    } else {
        add(a, ab, ca);
        add(b, bc, ab);
        add(c, ca, bc);
        add(ab, bc, ca);
    }
}

/// The rows that the middles of long edges would get, −1 for the others; empty where no edge is
/// long, or there would be too many places.
std::vector<Index> middles_of_long(const Positions& positions, const Triangles& triangles,
                                   const MeshEdges& edges, double longest, Index most_places) {
    std::vector<Index> middles(to_size(edges.size()), -1);
    const auto before = to_index(positions.rows());
    Index count = before;
    for (Index e = 0; e < edges.size(); ++e)
        if (edge_length(positions, triangles, edges[e].front()) > longest)
            middles[to_size(e)] = count++;
    if (count == before || count > most_places) middles.clear();
    return middles;
}

}  // namespace

std::vector<Piece> pieces_of(const Positions& positions, const Triangles& triangles,
                             const Triangles& middles) {
    std::vector<Piece> pieces;
    for (Index f = 0; f < triangles.rows(); ++f)
        cut(positions, f,
            {triangles(f, 0), triangles(f, 1), triangles(f, 2), middles(f, 0), middles(f, 1),
             middles(f, 2)},
            pieces);
    return pieces;
}

Triangles triangles_of(std::span<const Piece> pieces, const Triangles& corners,
                       const Triangles& middles) {
    Triangles result(static_cast<Eigen::Index>(pieces.size()), 3);
    for (std::size_t i = 0; i < pieces.size(); ++i)
        for (Index c = 0; c < 3; ++c) {
            const auto& [f, codes] = pieces[i];
            const Index code = codes[to_size(c)];
            result(static_cast<Eigen::Index>(i), c) =
                code < 3 ? corners(f, code) : middles(f, code - 3);
        }
    return result;
}

bool has_long_edges(const Mesh& mesh, const SubdivisionOptions& options) {
    const double longest = options.longest * std::sqrt(mesh.area());
    const auto is_long = [&](Index f) {
        for (Index k = 0; k < 3; ++k)
            if (edge_length(mesh.positions, mesh.triangles, {f, k}) > longest) return true;
        return false;
    };
    bool is_any = false;
    for (Index f = 0; f < mesh.triangles.rows() && !is_any; ++f) is_any = is_long(f);
    return is_any && !middles_of_long(mesh.positions, mesh.triangles, MeshEdges(mesh.triangles),
                                      longest, options.most_places)
                          .empty();
}

Subdivision subdivided(const Mesh& mesh, const SubdivisionOptions& options) {
    const double longest = options.longest * std::sqrt(mesh.area());
    Positions positions = mesh.positions;
    Triangles triangles = mesh.triangles;
    std::vector<EdgeEnds> ends;
    for (;;) {
        const MeshEdges edges(triangles);
        const std::vector<Index> middles =
            middles_of_long(positions, triangles, edges, longest, options.most_places);
        if (middles.empty()) break;
        positions.conservativeResize(std::ranges::max(middles) + 1, 3);
        for (Index e = 0; e < edges.size(); ++e) {
            if (middles[to_size(e)] < 0) continue;
            const MeshEdges::Side side = edges[e].front();
            ends.push_back({start_of(triangles, side), end_of(triangles, side)});
            positions.row(middles[to_size(e)]) =
                0.5 * (positions.row(ends.back()[0]) + positions.row(ends.back()[1]));
        }
        Triangles sides(triangles.rows(), 3);
        for (Index f = 0; f < triangles.rows(); ++f)
            for (Index k = 0; k < 3; ++k) sides(f, k) = middles[to_size(edges.edge_of(f, k))];
        triangles = triangles_of(pieces_of(positions, triangles, sides), triangles, sides);
    }
    if (ends.empty()) return {mesh, {}};
    Mesh result = mesh_of(mesh.unit, std::move(positions), std::move(triangles));
    result.places = mesh.places;
    result.parts_turned = mesh.parts_turned;
    return {std::move(result), std::move(ends)};
}

}  // namespace pointmorph

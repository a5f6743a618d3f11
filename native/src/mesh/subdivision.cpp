#include "pointmorph/mesh/subdivision.hpp"

#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "mesh/mesh_edges.hpp"

namespace pointmorph {

namespace {

using Corners = std::array<Index, 3>;

/// The triangles of one whose sides (from corner k to the next) have a middle, or −1.
void cut(const Positions& p, const Corners& t, const Corners& middle, std::vector<Corners>& out) {
    Index halved = 0, first = 0;
    for (Index k = 0; k < 3; ++k) halved += middle[to_size(k)] >= 0;
    // The corner from which to count: that before the one halved side, or that between two.
    for (Index k = 0; k < 3; ++k) {
        const bool here = middle[to_size(k)] >= 0, before = middle[to_size((k + 2) % 3)] >= 0;
        if ((halved == 1 && here) || (halved == 2 && here && before)) first = k;
    }
    const auto corner = [&](Index k) { return t[to_size((first + k) % 3)]; };
    const auto mid = [&](Index k) { return middle[to_size((first + k) % 3)]; };
    const Index a = corner(0), b = corner(1), c = corner(2);
    if (halved == 0) {
        out.push_back(t);
    } else if (halved == 1) {
        out.insert(out.end(), {{a, mid(0), c}, {mid(0), b, c}});
    } else if (halved == 2) {  // sides a b and c a; the rest along its shorter diagonal
        const Index ab = mid(0), ca = mid(2);
        out.push_back({a, ab, ca});
        if ((p.row(ab) - p.row(c)).squaredNorm() <= (p.row(b) - p.row(ca)).squaredNorm())
            out.insert(out.end(), {{ab, b, c}, {ab, c, ca}});
        else
            out.insert(out.end(), {{ab, b, ca}, {b, c, ca}});
    } else {
        const Index ab = mid(0), bc = mid(1), ca = mid(2);
        out.insert(out.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
}

}  // namespace

Mesh subdivided(const Mesh& mesh, const SubdivisionOptions& options) {
    const double longest = options.longest * std::sqrt(mesh.area());
    Positions positions = mesh.positions;
    Triangles triangles = mesh.triangles;
    bool changed = false;
    for (;;) {
        const MeshEdges edges(triangles);
        std::vector<Index> middles(to_size(edges.size()), -1);
        const auto before = static_cast<Index>(positions.rows());
        Index count = before;
        for (Index e = 0; e < edges.size(); ++e) {
            const MeshEdges::Side side = edges[e].front();
            const double length =
                (positions.row(start_of(triangles, side)) - positions.row(end_of(triangles, side)))
                    .norm();
            if (length > longest) middles[to_size(e)] = count++;
        }
        if (count == before || count > options.most_places) break;
        changed = true;
        positions.conservativeResize(count, 3);
        for (Index e = 0; e < edges.size(); ++e) {
            if (middles[to_size(e)] < 0) continue;
            const MeshEdges::Side side = edges[e].front();
            positions.row(middles[to_size(e)]) = 0.5 * (positions.row(start_of(triangles, side)) +
                                                        positions.row(end_of(triangles, side)));
        }
        std::vector<Corners> finer;
        for (Index f = 0; f < triangles.rows(); ++f) {
            const Corners t{triangles(f, 0), triangles(f, 1), triangles(f, 2)};
            Corners middle;
            for (Index k = 0; k < 3; ++k)
                middle[to_size(k)] = middles[to_size(edges.edge_of(f, k))];
            cut(positions, t, middle, finer);
        }
        triangles.resize(static_cast<Eigen::Index>(finer.size()), 3);
        for (std::size_t f = 0; f < finer.size(); ++f)
            triangles.row(static_cast<Eigen::Index>(f)) << finer[f][0], finer[f][1], finer[f][2];
    }
    if (!changed) return mesh;
    Mesh result = mesh_of(mesh.unit, std::move(positions), std::move(triangles));
    result.places = mesh.places;
    result.turned_outwards = mesh.turned_outwards;
    return result;
}

}  // namespace pointmorph

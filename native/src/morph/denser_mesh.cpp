#include "pointmorph/morph/denser_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

#include "mesh/mesh_edges.hpp"
#include "morph/wrapped_mesh.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/mesh/subdivision.hpp"

namespace pointmorph {

namespace {

/// A mesh whose edges are halved again and again, as places and as vertices.
class GrowingMesh {
public:
    explicit GrowingMesh(const Mesh& mesh)
        : mesh_(mesh),
          vertices_(mesh.vertices),
          polygons_(mesh.polygons),
          places_(mesh.places),
          first_new_(to_index(mesh.places.size())) {}

    const Mesh& mesh() const { return mesh_; }
    /// Of each place that is new: the places that it lies between.
    const std::vector<std::array<Index, 2>>& ends() const { return ends_; }

    /// Halves edges, and the longest of each triangle that has one of them, so that no triangle
    /// gets thin. Returns how many were halved.
    Index halve(std::vector<char> is_halved) {
        const MeshEdges edges(mesh_.triangles);
        add_longest(edges, is_halved);
        const auto before = to_index(mesh_.positions.rows());
        std::vector<Index> middles(to_size(edges.size()), -1);
        for (Index e = 0; e < edges.size(); ++e) {
            if (!is_halved[to_size(e)]) continue;
            middles[to_size(e)] = to_index(before + (ends_.size() - old_ends_));
            ends_.push_back({start_of(mesh_.triangles, edges[e].front()),
                             end_of(mesh_.triangles, edges[e].front())});
        }
        const auto count = to_index(ends_.size() - old_ends_);
        Positions positions = mesh_.positions;
        positions.conservativeResize(before + count, 3);
        for (Index k = 0; k < count; ++k) {
            const auto& [a, b] = ends_[old_ends_ + to_size(k)];
            positions.row(before + k) = 0.5 * (positions.row(a) + positions.row(b));
        }
        old_ends_ = ends_.size();
        cut(edges, middles, std::move(positions));
        return count;
    }

    /// As the caller gets it; `x` are the places, where they end.
    DenserMesh result(const Positions& x) const {
        return {vertices_, polygons_, vertex_ends_, gather(x, places_)};
    }
    Index size() const { return to_index(places_.size()); }

private:
    double squared_length(MeshEdges::Side side) const {
        return (mesh_.positions.row(start_of(mesh_.triangles, side)) -
                mesh_.positions.row(end_of(mesh_.triangles, side)))
            .squaredNorm();
    }

    void add_longest(const MeshEdges& edges, std::vector<char>& is_halved) const {
        std::vector<Index> longest(to_size(mesh_.triangles.rows()));
        for (Index f = 0; f < mesh_.triangles.rows(); ++f) {
            std::pair<double, Index> most{-1.0, 0};
            for (Index k = 0; k < 3; ++k)
                most = std::max(most, {squared_length(edges[edges.edge_of(f, k)].front()),
                                       edges.edge_of(f, k)});
            longest[to_size(f)] = most.second;
        }
        std::vector<Index> next;
        for (Index e = 0; e < edges.size(); ++e)
            if (is_halved[to_size(e)]) next.push_back(e);
        for (std::size_t i = 0; i < next.size(); ++i)
            for (const MeshEdges::Side& side : edges[next[i]]) {
                const Index e = longest[to_size(side.triangle)];
                if (!std::exchange(is_halved[to_size(e)], 1)) next.push_back(e);
            }
    }

    void cut(const MeshEdges& edges, const std::vector<Index>& middles, Positions positions) {
        Triangles sides(mesh_.triangles.rows(), 3), vertex_sides(mesh_.triangles.rows(), 3);
        std::map<std::array<Index, 2>, Index> between;  // a vertex for each pair along a seam
        for (Index f = 0; f < mesh_.triangles.rows(); ++f)
            for (Index k = 0; k < 3; ++k) {
                const Index middle = middles[to_size(edges.edge_of(f, k))];
                sides(f, k) = middle;
                vertex_sides(f, k) = -1;
                if (middle < 0) continue;
                const auto [low, high] = std::minmax(vertices_(f, k), vertices_(f, (k + 1) % 3));
                const auto [entry, is_new] = between.try_emplace({low, high}, size());
                vertex_sides(f, k) = entry->second;
                if (!is_new) continue;
                vertex_ends_.push_back({low, high});
                places_.push_back(middle);
            }
        const std::vector<Piece> pieces = pieces_of(positions, mesh_.triangles, sides);
        std::vector<Index> polygons;
        for (const Piece& piece : pieces) polygons.push_back(polygons_[to_size(piece.triangle)]);
        polygons_ = std::move(polygons);
        vertices_ = triangles_of(pieces, vertices_, vertex_sides);
        Mesh finer =
            mesh_of(mesh_.unit, std::move(positions), triangles_of(pieces, mesh_.triangles, sides));
        finer.places = std::move(mesh_.places);
        finer.turned_outwards = mesh_.turned_outwards;
        mesh_ = std::move(finer);
    }

    Mesh mesh_;
    Triangles vertices_;
    std::vector<Index> polygons_;
    std::vector<Index> places_;  ///< of the vertices
    Index first_new_;
    std::vector<std::array<Index, 2>> ends_, vertex_ends_;
    std::size_t old_ends_ = 0;
};

/// The surface that a mesh should show, in lengths of the target's unit.
class Shown {
public:
    Shown(const WrapTarget& target, Progress& progress) : target_(target) {
        if (target.mesh)
            tree_.emplace(target.mesh->positions, target.mesh->triangles, progress);
        else
            points_.emplace(target.fine.positions);
    }

    double distance(const Vector3& place) const {
        if (tree_) return std::sqrt(tree_->closest(place).squared_distance);
        Index row = 0;
        double squared = 0.0;
        points_->nearest(place.data(), {&row, 1}, {&squared, 1});
        return std::abs((place.transpose() - target_.fine.positions.row(row))
                            .dot(target_.fine.normals.row(row)));
    }

private:
    const WrapTarget& target_;
    std::optional<TriangleTree> tree_;
    std::optional<KdTree<3>> points_;
};

/// Edges to halve: those whose middle is off the target; the longest of triangles whose middle is,
/// or that are nearest to what no face reaches. None that is short.
std::vector<char> edges_to_halve(const Mesh& mesh, const Positions& x, const WrapTarget& target,
                                 const Shown& shown, double tolerance, Progress& progress) {
    const MeshEdges edges(mesh.triangles);
    const auto length = [&](Index e) {
        const MeshEdges::Side side = edges[e].front();
        return (x.row(start_of(mesh.triangles, side)) - x.row(end_of(mesh.triangles, side))).norm();
    };
    std::vector<char> result(to_size(edges.size()), 0);
    parallel_for(
        edges.size(), progress,
        [&](Index begin, Index end) {
            for (Index e = begin; e < end; ++e) {
                const MeshEdges::Side side = edges[e].front();
                const Vector3 middle = 0.5 * (x.row(start_of(mesh.triangles, side)) +
                                              x.row(end_of(mesh.triangles, side)))
                                                 .transpose();
                result[to_size(e)] = shown.distance(middle) > tolerance;
            }
        },
        0.0, 0.5, 128);
    const auto longest = [&](Index f) {
        Index best = edges.edge_of(f, 0);
        for (Index k = 1; k < 3; ++k)
            if (length(edges.edge_of(f, k)) > length(best)) best = edges.edge_of(f, k);
        return best;
    };
    std::vector<char> is_off(to_size(mesh.triangles.rows()), 0);
    parallel_for(
        to_index(mesh.triangles.rows()), progress,
        [&](Index begin, Index end) {
            for (Index f = begin; f < end; ++f) {
                const auto t = mesh.triangles.row(f);
                const Vector3 middle = (x.row(t[0]) + x.row(t[1]) + x.row(t[2])).transpose() / 3.0;
                is_off[to_size(f)] = shown.distance(middle) > tolerance;
            }
        },
        0.5, 1.0, 128);
    const TriangleTree tree(x, mesh.triangles, progress);
    for (Eigen::Index s = 0; s < target.coarse.positions.rows(); ++s) {
        const SurfacePoint point = tree.closest(target.coarse.positions.row(s).transpose());
        if (point.squared_distance > tolerance * tolerance) is_off[to_size(point.triangle)] = 1;
    }
    for (Index f = 0; f < mesh.triangles.rows(); ++f)
        if (is_off[to_size(f)]) result[to_size(longest(f))] = 1;
    constexpr double kShort = 2.0;  // tolerances
    for (Index e = 0; e < edges.size(); ++e)
        if (length(e) < kShort * tolerance) result[to_size(e)] = 0;
    return result;
}

}  // namespace

DenserMesh denser_mesh(const WrapSource& source, const WrapSide& target,
                       std::span<const IndexPair> pinned, const WrapOptions& wrapping,
                       const DensityOptions& options, Progress& progress) {
    if (is_same_mesh(source, target))
        return {source.mesh.mesh().vertices, source.mesh.mesh().polygons, {}, source.images};
    WrapOnto onto(source, target, pinned, progress);
    const Shown shown(onto.target(), progress);
    const double tolerance = options.tolerance * std::sqrt(onto.target().area);
    GrowingMesh growing(source.mesh.mesh());
    Positions x;
    for (Index round = 0; round <= options.rounds; ++round) {
        const double count = static_cast<double>(options.rounds + 1);
        const Progress::Part part(progress, round / count, (round + 1) / count);
        Subdivision divided = subdivided(growing.mesh(), {});
        divided.ends.insert(divided.ends.begin(), growing.ends().begin(), growing.ends().end());
        const Positions all = onto.wrapped(divided.mesh, divided.ends, wrapping, progress);
        x = all.topRows(growing.mesh().positions.rows());
        if (round == options.rounds) break;
        const TriangleTree tree(divided.mesh.positions, divided.mesh.triangles, progress);
        constexpr int kMost = 8;
        bool has_grown = false;
        for (int again = 0; again < kMost; ++again) {
            const Mesh& mesh = growing.mesh();
            std::vector<char> edges =
                edges_to_halve(mesh, x, onto.target(), shown, tolerance, progress);
            const auto more = std::ranges::count(edges, 1);
            if (more == 0 || growing.size() + 2 * more > options.most_vertices) break;
            const Index before = to_index(mesh.positions.rows());
            const Index added = growing.halve(std::move(edges));
            has_grown = true;
            x.conservativeResize(before + added, 3);
            for (Index p = before; p < before + added; ++p) {
                const SurfacePoint on = tree.closest(growing.mesh().positions.row(p).transpose());
                x.row(p) = place_of(on, divided.mesh.triangles, all).transpose();
            }
        }
        if (!has_grown) break;
    }
    DenserMesh result = growing.result(x);
    result.positions = onto.restored(result.positions);
    return result;
}

}  // namespace pointmorph

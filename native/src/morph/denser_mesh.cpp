#include "pointmorph/morph/denser_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <optional>
#include <span>
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
        : mesh_(mesh), vertices_(mesh.vertices), polygons_(mesh.polygons), places_(mesh.places) {}

    const Mesh& mesh() const { return mesh_; }
    /// Of each place that is new: the places that it lies between.
    const std::vector<std::array<Index, 2>>& ends() const { return ends_; }

    /// Halves edges, and the longest of each triangle that has a much shorter one of them, so that
    /// no triangle gets thin.
    void halve(std::vector<char> is_halved) {
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
                constexpr double kMuchLonger = 1.5 * 1.5;
                const Index e = longest[to_size(side.triangle)];
                if (squared_length(edges[e].front()) < kMuchLonger * squared_length(side)) continue;
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
        finer.parts_turned = mesh_.parts_turned;
        mesh_ = std::move(finer);
    }

    Mesh mesh_;
    Triangles vertices_;
    std::vector<Index> polygons_;
    std::vector<Index> places_;  ///< of the vertices
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

    /// The place itself where the target has no faces.
    Vector3 nearest(const Vector3& place) const {
        if (!tree_) return place;
        const Mesh& mesh = *target_.mesh;
        return place_of(tree_->closest(place), mesh.triangles, mesh.positions);
    }

private:
    const WrapTarget& target_;
    std::optional<TriangleTree> tree_;
    std::optional<KdTree<3>> points_;
};

/// How far the middles of a mesh's edges and faces are off what it should show. What isn't halved
/// keeps its own while no vertex moves.
struct Measured {
    std::vector<std::array<Index, 2>> ends;  ///< of the edges, the lower first; ascending
    std::vector<double> edges;
    Triangles triangles{0, 3};
    std::vector<double> faces;
};

/// What halving each edge would mend: how far its middle is off the target, times its length; so
/// much of the longest edge of a triangle whose middle is, or that is nearest to what no face
/// reaches. 0 for what is near enough, for edges that are short, and for those that lie off as a
/// whole: halves of them would as well.
class Misses {
public:
    Misses(const Mesh& mesh, const Positions& x, const Shown& shown, double tolerance)
        : mesh_(mesh),
          x_(x),
          shown_(shown),
          tolerance_(tolerance),
          edges_(mesh.triangles),
          misses_(to_size(edges_.size()), 0.0) {}

    /// Nothing where what is left doesn't show. `known` is what was measured before edges were
    /// halved, and becomes what is measured now.
    std::vector<double> found(const WrapTarget& target, Measured& known, Progress& progress) && {
        measure(known, progress);
        for (Index e = 0; e < edges_.size(); ++e) add(e, known.edges[to_size(e)]);
        std::vector<double> off = known.faces;
        double faces = 0.0, samples = 0.0;  // that are off
        for (Index f = 0; f < mesh_.triangles.rows(); ++f)
            if (off[to_size(f)] > tolerance_) faces += area(f);
        const TriangleTree tree(x_, mesh_.triangles, progress);
        std::vector<SurfacePoint> nearest(to_size(target.coarse.positions.rows()));
        parallel_for(
            to_index(nearest.size()), progress,
            [&](Index begin, Index end) {
                for (Index s = begin; s < end; ++s)
                    nearest[to_size(s)] = tree.closest(target.coarse.positions.row(s).transpose());
            },
            1.0, 1.0, 64);
        for (const SurfacePoint& point : nearest) {
            double& worst = off[to_size(point.triangle)];
            const double distance = std::sqrt(point.squared_distance);
            if (distance > tolerance_) samples += 1.0;
            worst = std::max(worst, distance);
        }
        constexpr double kFew = 0.05;
        if (faces < kFew * target.area &&
            samples < kFew * static_cast<double>(target.coarse.positions.rows()))
            return {};
        for (Index f = 0; f < mesh_.triangles.rows(); ++f) add(longest(f), off[to_size(f)]);
        return std::move(misses_);
    }

private:
    void measure(Measured& known, Progress& progress) const {
        constexpr double kUnknown = -1.0;
        const Triangles& triangles = mesh_.triangles;
        Measured now{{},
                     std::vector<double>(to_size(edges_.size()), kUnknown),
                     triangles,
                     std::vector<double>(to_size(triangles.rows()), kUnknown)};
        for (Index e = 0; e < edges_.size(); ++e) {
            const MeshEdges::Side side = edges_[e].front();
            const auto [low, high] =
                std::minmax({start_of(triangles, side), end_of(triangles, side)});
            now.ends.push_back({low, high});
        }
        // What is left of both is in the same order.
        for (std::size_t e = 0, k = 0; e < now.ends.size() && k < known.ends.size(); ++e) {
            while (k < known.ends.size() && known.ends[k] < now.ends[e]) ++k;
            if (k < known.ends.size() && known.ends[k] == now.ends[e])
                now.edges[e] = known.edges[k];
        }
        const Index old = known.triangles.size() > 0 ? known.triangles.maxCoeff() + 1 : 0;
        for (Index f = 0, k = 0; f < triangles.rows(); ++f) {
            if (triangles.row(f).maxCoeff() >= old) continue;  // has a corner that is new
            while (known.triangles.row(k) != triangles.row(f)) ++k;
            now.faces[to_size(f)] = known.faces[to_size(k)];
        }
        const auto fill = [&](std::vector<double>& distances, double from, auto&& middle) {
            parallel_for(
                to_index(distances.size()), progress,
                [&](Index begin, Index end) {
                    for (Index i = begin; i < end; ++i)
                        if (double& its = distances[to_size(i)]; its == kUnknown)
                            its = shown_.distance(middle(i));
                },
                from, from + 0.5, 128);
        };
        fill(now.edges, 0.0, [&](Index e) -> Vector3 { return 0.5 * (start(e) + finish(e)); });
        fill(now.faces, 0.5, [&](Index f) -> Vector3 {
            const auto t = triangles.row(f);
            return (x_.row(t[0]) + x_.row(t[1]) + x_.row(t[2])).transpose() / 3.0;
        });
        known = std::move(now);
    }

    Vector3 start(Index e) const {
        return x_.row(start_of(mesh_.triangles, edges_[e].front())).transpose();
    }
    Vector3 finish(Index e) const {
        return x_.row(end_of(mesh_.triangles, edges_[e].front())).transpose();
    }
    double area(Index f) const {
        const auto t = mesh_.triangles.row(f);
        const Vector3 u = (x_.row(t[1]) - x_.row(t[0])).transpose(),
                      v = (x_.row(t[2]) - x_.row(t[0])).transpose();
        return 0.5 * u.cross(v).norm();
    }
    double length(Index e) const { return (finish(e) - start(e)).norm(); }

    Index longest(Index f) const {
        Index best = edges_.edge_of(f, 0);
        for (Index k = 1; k < 3; ++k)
            if (length(edges_.edge_of(f, k)) > length(best)) best = edges_.edge_of(f, k);
        return best;
    }

    void add(Index e, double distance) {
        constexpr double kShort = 2.0;  // tolerances
        constexpr double kWhole = 1.5;  // distances
        const double along = length(e);
        if (distance > tolerance_ && along > std::max(kShort * tolerance_, kWhole * distance))
            misses_[to_size(e)] = std::max(misses_[to_size(e)], distance * along);
    }

    const Mesh& mesh_;
    const Positions& x_;
    const Shown& shown_;
    double tolerance_;
    MeshEdges edges_;
    std::vector<double> misses_;
};

/// The edges that miss most; about half as many as there is room for, since others go with them.
std::vector<char> edges_to_halve(std::span<const double> misses, Index room) {
    std::vector<Index> order;
    for (std::size_t e = 0; e < misses.size(); ++e)
        if (misses[e] > 0.0) order.push_back(to_index(e));
    std::ranges::stable_sort(order, std::greater{}, [&](Index e) { return misses[to_size(e)]; });
    if (to_index(order.size()) > room / 2) order.resize(to_size(room / 2));
    std::vector<char> result(misses.size(), 0);
    for (const Index e : order) result[to_size(e)] = 1;
    return result;
}

/// More vertices than so many show no more of the target: what it has between its own is flat.
Index enough_vertices(Index own, const WrapTarget& target, Index most) {
    constexpr Index kOfEach = 8, kLeast = 500;
    const auto places =
        to_index(target.mesh ? target.mesh->positions.rows() : target.coarse.positions.rows());
    return std::min(most, own + std::max(kLeast, kOfEach * std::min(places, most)));
}

/// A mesh that has been wrapped onto the target, where it lies at `x`.
struct OnTarget {
    const Mesh& mesh;
    const Positions& x;
    const TriangleTree tree;  ///< of the mesh at rest
};

/// Puts the last places where the wrapped mesh is there, and then onto what is to be shown.
void place_new(const Mesh& grown, Index first, const OnTarget& wrapped, const Shown& shown,
               Positions& x, Progress& progress) {
    x.conservativeResize(grown.positions.rows(), 3);
    parallel_for(
        to_index(x.rows()) - first, progress,
        [&](Index begin, Index end) {
            for (Index p = first + begin; p < first + end; ++p) {
                const SurfacePoint on = wrapped.tree.closest(grown.positions.row(p).transpose());
                x.row(p) =
                    shown.nearest(place_of(on, wrapped.mesh.triangles, wrapped.x)).transpose();
            }
        },
        1.0, 1.0, 64);
}

}  // namespace

DenserMesh denser_mesh(const WrapSource& source, const WrapSide& target,
                       std::span<const IndexPair> pinned, const WrapOptions& wrapping,
                       const DensityOptions& options, Progress& progress) {
    if (is_same_mesh(source, target))
        return {source.mesh.mesh().vertices, source.mesh.mesh().polygons, {}, source.images};
    constexpr double kSamples = 0.05;  // of the time
    std::optional<WrapOnto> made;
    std::optional<Shown> its_surface;
    {
        const Progress::Part part(progress, 0.0, kSamples);
        made.emplace(source, target, pinned, progress);
        its_surface.emplace(made->target(), progress);
    }
    const Progress::Part rounds(progress, kSamples, 1.0);
    WrapOnto& onto = *made;
    const Shown& shown = *its_surface;
    const double tolerance = options.tolerance * std::sqrt(onto.target().area);
    GrowingMesh growing(source.mesh.mesh());
    const Index own = growing.size();
    const Index most = enough_vertices(own, onto.target(), options.most_vertices);
    Positions x;
    for (Index round = 0; round <= options.rounds; ++round) {
        const double count = static_cast<double>(options.rounds + 1);
        const Progress::Part part(progress, round / count, (round + 1) / count);
        Subdivision divided = subdivided(growing.mesh(), {});
        divided.ends.insert(divided.ends.begin(), growing.ends().begin(), growing.ends().end());
        const Positions all = onto.wrapped(divided.mesh, divided.ends, wrapping, progress);
        x = all.topRows(growing.mesh().positions.rows());
        if (round == options.rounds) break;
        const OnTarget wrapped{
            divided.mesh, all, {divided.mesh.positions, divided.mesh.triangles, progress}};
        // The later rounds, which know better, have their share.
        const Index end = own + (most - own) / options.rounds * (round + 1);
        constexpr int kMost = 12;
        constexpr Index kFew = 4;
        bool has_grown = false;
        Measured known;
        for (int again = 0; again < kMost && growing.size() + kFew < end; ++again) {
            const std::vector<char> edges = edges_to_halve(
                Misses(growing.mesh(), x, shown, tolerance).found(onto.target(), known, progress),
                end - growing.size());
            if (std::ranges::count(edges, 1) == 0) break;  // also if there are none
            const Index before = to_index(x.rows());
            growing.halve(edges);
            has_grown = true;
            place_new(growing.mesh(), before, wrapped, shown, x, progress);
        }
        if (!has_grown) break;
    }
    DenserMesh result = growing.result(x);
    result.positions = onto.restored(result.positions);
    return result;
}

}  // namespace pointmorph

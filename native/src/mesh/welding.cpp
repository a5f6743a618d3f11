#include "mesh/welding.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/angle.hpp"
#include "mesh/mesh_edges.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

namespace {

using Side = MeshEdges::Side;

/// Joins the corners of triangles at edges.
class Seams {
public:
    Seams(const Mesh& mesh, GrowingComponents& vertices, Progress& progress)
        : mesh_(mesh), vertices_(vertices), progress_(progress) {
        double volume = 0.0;  // six times
        for (Index f = 0; f < to_index(mesh.triangles.rows()); ++f) {
            const auto corner = [&](Index k) -> Vector3 {
                return mesh.positions.row(mesh.triangles(f, k)).transpose();
            };
            volume += corner(0).dot(corner(1).cross(corner(2)));
        }
        inward_ = volume < 0.0;
    }

    void close(std::span<const Side> sides) {
        if (sides.size() < 2) return;
        if (sides.size() == 2) {
            join(sides[0], sides[1]);
            return;
        }
        // Those with no other triangle at the same two vertices.
        alone_.clear();
        std::vector<std::array<Index, 2>> all;
        for (const Side& side : sides) all.push_back(ends(side));
        std::ranges::sort(all);
        for (const Side& side : sides)
            if (std::ranges::equal_range(all, ends(side)).size() == 1) alone_.push_back(side);
        if (alone_.size() == 2)
            join(alone_[0], alone_[1]);
        else
            join_around_insides();
    }

private:
    Index vertex(const Side& side, Index k) const {
        return mesh_.vertices(side.triangle, (side.k + k) % 3);
    }
    std::array<Index, 2> ends(const Side& side) const {
        const auto [low, high] = std::minmax({vertex(side, 0), vertex(side, 1)});
        return {low, high};
    }

    void join(const Side& one, const Side& other) {
        const bool agree = start_of(mesh_.triangles, one) != start_of(mesh_.triangles, other);
        vertices_.join(vertex(one, 0), vertex(other, agree ? 1 : 0));
        vertices_.join(vertex(one, 1), vertex(other, agree ? 0 : 1));
    }

    /// Which way triangles lie around the edge at which all of them are.
    class Around {
    public:
        Around(const Mesh& mesh, const Side& first, bool inward) : mesh_(mesh), inward_(inward) {
            start_ = corner(first, 0);
            along_ = (corner(first, 1) - start_).normalized();
            zero_ = along_.unitOrthogonal();
            quarter_ = along_.cross(zero_);
        }
        /// Over −π to π, and growing through the inside, which is behind the triangles that run as
        /// the first one does. Of one without area there is none.
        std::optional<double> angle(const Side& side) const {
            const Vector3 to = across(side);
            if (to.isZero(0.0)) return {};
            const double sine = quarter_.dot(to);
            return angle_of(inward_ ? sine : -sine, zero_.dot(to));
        }

    private:
        Vector3 corner(const Side& side, Index k) const {
            return mesh_.positions.row(mesh_.triangles(side.triangle, (side.k + k) % 3))
                .transpose();
        }
        Vector3 across(const Side& side) const {
            const Vector3 to = corner(side, 2) - start_;
            return (to - to.dot(along_) * along_).normalized();
        }

        const Mesh& mesh_;
        bool inward_;
        Vector3 start_, along_, zero_, quarter_;
    };

    /// From one angle around the edge on to another: over 0 to 2π. Triangles that lie on each other
    /// have nothing between them.
    static double angle_behind(double one, double other) {
        constexpr double kAll = 2.0 * std::numbers::pi;
        const double angle = other < one ? other - one + kAll : other - one;
        return angle < kOnEachOther ? kAll - angle : angle;
    }

    /// Which one of `others`, by their angles, is the first behind one with this angle.
    static std::size_t first_behind(double angle,
                                    std::span<const std::pair<double, std::size_t>> others) {
        const auto behind =
            std::ranges::lower_bound(others, std::pair(angle + kOnEachOther, std::size_t{0}));
        const auto next = to_size(behind - others.begin()) % others.size();
        // Where all of them lie on it, the one before may be the first.
        const auto before = (next + others.size() - 1) % others.size();
        const bool is_before =
            angle_behind(angle, others[before].first) < angle_behind(angle, others[next].first);
        return others[is_before ? before : next].second;
    }

    /// Nothing where the triangles can't all be paired, each with one that runs the other way.
    void join_around_insides() {
        if (alone_.empty()) return;
        const auto runs_along =
            [&, start = start_of(mesh_.triangles, alone_.front())](const Side& side) {
                return start_of(mesh_.triangles, side) == start;
            };
        if (2 * std::ranges::count_if(alone_, runs_along) != std::ssize(alone_)) return;
        const Around around(mesh_, alone_.front(), inward_);
        std::vector<std::pair<double, std::size_t>> others;  // angles, and which of those alone
        for (std::size_t j = 0; j < alone_.size(); ++j)
            if (!runs_along(alone_[j]))
                if (const auto angle = around.angle(alone_[j])) others.emplace_back(*angle, j);
        std::ranges::sort(others);
        const auto first_other =
            to_size(std::ranges::find_if_not(alone_, runs_along) - alone_.begin());
        std::vector<std::pair<Side, Side>> pairs;
        std::vector<char> is_taken(alone_.size(), 0);
        for (const Side& side : alone_) {
            if (!runs_along(side)) continue;
            progress_.report(0.0);
            const auto angle = around.angle(side);
            const std::size_t other =
                angle && !others.empty() ? first_behind(*angle, others) : first_other;
            if (std::exchange(is_taken[other], 1)) return;
            pairs.emplace_back(side, alone_[other]);
        }
        for (const auto& [one, other] : pairs) join(one, other);
    }

    static constexpr double kOnEachOther = 1e-6;
    const Mesh& mesh_;
    GrowingComponents& vertices_;
    Progress& progress_;
    std::vector<Side> alone_;
    bool inward_ = false;  ///< whether faces show their inside
};

/// Places at the ends of edges that one triangle has.
struct OpenPlaces {
    std::vector<Index> places;    ///< ascending
    std::vector<double> lengths;  ///< of the shortest edge of the triangles at each
};

OpenPlaces open_places(const MeshEdges& edges, const Mesh& mesh) {
    constexpr double kNone = -1.0;
    std::vector<double> lengths(to_size(mesh.positions.rows()), kNone);
    bool any = false;
    for (Index e = 0; e < edges.size(); ++e) {
        if (edges[e].size() != 1) continue;
        any = true;
        for (const Index place :
             {start_of(mesh.triangles, edges[e].front()), end_of(mesh.triangles, edges[e].front())})
            lengths[to_size(place)] = std::numeric_limits<double>::infinity();
    }
    OpenPlaces result;
    if (!any) return result;
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
        const auto corners = mesh.triangles.row(f);
        double shortest = std::numeric_limits<double>::infinity();
        for (Index k = 0; k < 3; ++k)
            shortest = std::min(
                shortest,
                (mesh.positions.row(corners[k]) - mesh.positions.row(corners[(k + 1) % 3])).norm());
        for (Index k = 0; k < 3; ++k)
            lengths[to_size(corners[k])] = std::min(lengths[to_size(corners[k])], shortest);
    }
    for (Index p = 0; p < to_index(lengths.size()); ++p)
        if (lengths[to_size(p)] > kNone) {
            result.places.push_back(p);
            result.lengths.push_back(lengths[to_size(p)]);
        }
    return result;
}

/// Which place each one becomes: the first of those that lie within rounding of it.
std::vector<Index> but_for_rounding(const OpenPlaces& open, const Mesh& mesh, Progress& progress) {
    constexpr double kRounding = 1e-5;
    constexpr double kOfEdges = 0.05;  // at most: the smallest faces are no rounding
    std::vector<Index> first(to_size(mesh.positions.rows()));
    std::iota(first.begin(), first.end(), 0);
    const Positions at = gather(mesh.positions, open.places);
    const KdTree<3> tree(at);
    std::vector<std::pair<Index, double>> near;
    for (std::size_t i = 0; i < open.places.size(); ++i) {
        if (i % 1024 == 0) progress.report(0.0);
        const Index place = open.places[i];
        if (first[to_size(place)] != place) continue;
        const double reach = std::min(kRounding, kOfEdges * open.lengths[i]);
        tree.within_unsorted(at.row(to_index(i)).data(), reach, near);
        for (const auto& [j, squared] : near) {
            Index& other = first[to_size(open.places[to_size(j)])];
            if (to_size(j) > i && other == open.places[to_size(j)] &&
                std::sqrt(squared) < kOfEdges * open.lengths[to_size(j)])
                other = place;
        }
    }
    return first;
}

/// Joins vertices that no triangle has to those that stand for them.
void take_unused(const Polygons& faces, const Mesh& mesh, GrowingComponents& vertices) {
    std::vector<char> is_used(mesh.places.size(), 0);
    for (Index c = 0; c < mesh.vertices.size(); ++c)
        is_used[to_size(mesh.vertices(c / 3, c % 3))] = 1;
    for (Index f = 0; f < faces.size(); ++f)
        for (const Index vertex : faces[f]) {
            if (is_used[to_size(vertex)]) continue;
            const auto other = std::ranges::find_if(faces[f], [&](Index v) {
                return is_used[to_size(v)] &&
                       mesh.places[to_size(v)] == mesh.places[to_size(vertex)];
            });
            if (other == faces[f].end()) continue;
            vertices.join(vertex, *other);
            is_used[to_size(vertex)] = 1;
        }
    std::vector<Index> first(to_size(mesh.positions.rows()), -1);
    for (const bool used : {true, false})
        for (std::size_t v = 0; v < is_used.size(); ++v)
            if (Index& one = first[to_size(mesh.places[v])]; (is_used[v] != 0) == used && one < 0)
                one = to_index(v);
    for (std::size_t v = 0; v < is_used.size(); ++v)
        if (!is_used[v]) vertices.join(to_index(v), first[to_size(mesh.places[v])]);
}

}  // namespace

void weld(const Positions& vertices, Mesh& mesh) {
    const auto count = to_index(vertices.rows());
    std::vector<Index> order(to_size(count));
    std::iota(order.begin(), order.end(), 0);
    const auto less = [&](Index i, Index j) {
        const auto a = vertices.row(i), b = vertices.row(j);
        return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end());
    };
    std::ranges::stable_sort(order, less);
    std::vector<Index> first(to_size(count));  // the first vertex at the place of each
    for (std::size_t k = 0; k < order.size(); ++k) {
        const bool same = k > 0 && vertices.row(order[k]) == vertices.row(order[k - 1]);
        first[to_size(order[k])] = same ? first[to_size(order[k - 1])] : order[k];
    }
    mesh.places.resize(to_size(count));
    std::vector<Index> rows;  // places are numbered as their first vertices are
    for (Index v = 0; v < count; ++v) {
        if (first[to_size(v)] == v) {
            mesh.places[to_size(v)] = to_index(rows.size());
            rows.push_back(v);
        } else {
            mesh.places[to_size(v)] = mesh.places[to_size(first[to_size(v)])];
        }
    }
    mesh.positions = mesh.unit.apply(gather(vertices, rows));
}

bool close_rounded_seams(const MeshEdges& edges, Mesh& mesh, Progress& progress) {
    const OpenPlaces open = open_places(edges, mesh);
    if (open.places.empty()) return false;
    const std::vector<Index> first = but_for_rounding(open, mesh, progress);
    const auto count = to_index(first.size());
    std::vector<Index> number(to_size(count)), rows;
    for (Index p = 0; p < count; ++p) {
        if (first[to_size(p)] == p) {
            number[to_size(p)] = to_index(rows.size());
            rows.push_back(p);
        } else {
            number[to_size(p)] = number[to_size(first[to_size(p)])];
        }
    }
    if (to_index(rows.size()) == count) return false;
    for (Index& place : mesh.places) place = number[to_size(place)];
    mesh.positions = gather(mesh.positions, rows);
    return true;
}

bool part_what_touches(const Polygons& faces, const MeshEdges& edges, Mesh& mesh,
                       Progress& progress) {
    if (mesh.positions.rows() == static_cast<Eigen::Index>(mesh.places.size())) return false;
    GrowingComponents vertices(to_index(mesh.places.size()));
    Seams seams(mesh, vertices, progress);
    for (Index e = 0; e < edges.size(); ++e) seams.close(edges[e]);
    take_unused(faces, mesh, vertices);

    std::vector<Index> places = vertices.components().label, spots;
    for (std::size_t v = 0; v < places.size(); ++v)
        if (to_size(places[v]) == spots.size()) spots.push_back(mesh.places[v]);
    if (to_index(spots.size()) == to_index(mesh.positions.rows())) return false;
    mesh.positions = gather(mesh.positions, spots);
    mesh.places = std::move(places);
    for (Index c = 0; c < mesh.triangles.size(); ++c)
        mesh.triangles(c / 3, c % 3) = mesh.places[to_size(mesh.vertices(c / 3, c % 3))];
    return true;
}

}  // namespace pointmorph

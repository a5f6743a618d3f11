#include "pointmorph/mesh/mesh_samples.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <optional>

#include "base/grouped.hpp"
#include "cloud/closed_length.hpp"
#include "mesh/mesh_edges.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/sampling.hpp"

namespace pointmorph {

namespace {

/// Places on the faces, not all of which become samples.
struct Candidates {
    std::vector<Index> triangles;
    std::vector<Eigen::RowVector3d> weights;
    std::vector<Eigen::RowVector3d> facing;  ///< 0 where the triangle tells

    Index size() const { return to_index(triangles.size()); }
    void add(Index triangle, const Eigen::RowVector3d& w,
             const Eigen::RowVector3d& normal = Eigen::RowVector3d::Zero()) {
        triangles.push_back(triangle);
        weights.push_back(w);
        facing.push_back(normal);
    }
    void add(const Candidates& other, Index i) {
        add(other.triangles[to_size(i)], other.weights[to_size(i)], other.facing[to_size(i)]);
    }
    void add(const Candidates& other) {
        triangles.insert(triangles.end(), other.triangles.begin(), other.triangles.end());
        weights.insert(weights.end(), other.weights.begin(), other.weights.end());
        facing.insert(facing.end(), other.facing.begin(), other.facing.end());
    }
    void resize(Index count) {
        triangles.resize(to_size(count));
        weights.resize(to_size(count));
        facing.resize(to_size(count), Eigen::RowVector3d::Zero());
    }
};

/// Uniform in [0, 1), the same for the same number everywhere (Steele et al., SplitMix, 2014).
double random_number(std::uint64_t number) {
    std::uint64_t z = (number + 1) * 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1.0p-53;
}

/// Random points, uniform by area, one in each of `count` equal shares of it.
void add_random(Candidates& candidates, const Mesh& mesh, std::span<const Index> triangles,
                Index count, Progress& progress) {
    std::vector<double> ends;
    double sum = 0.0;
    for (const Index f : triangles) ends.push_back(sum += mesh.areas[f]);
    const Index first = candidates.size();
    candidates.resize(first + count);
    const auto one = [&](Index i) {
        const auto number = 3 * static_cast<std::uint64_t>(i);
        const double place = (i + random_number(number)) / count * sum;
        const auto k = std::min(to_size(std::ranges::upper_bound(ends, place) - ends.begin()),
                                ends.size() - 1);
        const double root = std::sqrt(random_number(number + 1));
        const double other = random_number(number + 2);
        candidates.triangles[to_size(first + i)] = triangles[k];
        candidates.weights[to_size(first + i)] = {1.0 - root, root * (1.0 - other), root * other};
    };
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) one(i);
        },
        0.0, 0.0);
}

/// A triangle at each place, and its corner there.
struct SomeTriangle {
    std::vector<Index> triangle, corner;

    explicit SomeTriangle(const Mesh& mesh)
        : triangle(to_size(mesh.positions.rows()), -1), corner(triangle.size(), -1) {
        for (Index f = to_index(mesh.triangles.rows()) - 1; f >= 0; --f)
            for (Index k = 0; k < 3; ++k) {
                triangle[to_size(mesh.triangles(f, k))] = f;
                corner[to_size(mesh.triangles(f, k))] = k;
            }
    }
};

/// The triangle at the border that runs from one place to the next, and the side that lies there.
struct BorderSide {
    Index triangle, k;
};
std::vector<BorderSide> sides_along(const Mesh& mesh, const std::vector<Index>& loop,
                                    const std::vector<std::vector<Index>>& around) {
    std::vector<BorderSide> sides;
    for (std::size_t i = 0; i < loop.size(); ++i) {
        const Index from = loop[i], to = loop[(i + 1) % loop.size()];
        for (const Index f : around[to_size(from)])
            for (Index k = 0; k < 3; ++k)
                if (mesh.triangles(f, k) == from && mesh.triangles(f, (k + 1) % 3) == to) {
                    sides.push_back({f, k});
                    goto found;
                }
        sides.push_back({around[to_size(from)].front(), 0});
    found:;
    }
    return sides;
}

/// What a part of the mesh is sampled from: kept places, points along borders and sharp edges, then
/// random ones.
struct PartCandidates {
    Candidates places;
    Index fixed = 0;            ///< the first of them, which stay
    std::vector<Index> kept;    ///< numbers of kept places, in the order in which they were asked
    std::vector<Index> border;  ///< fixed candidates along the longest border of the mesh
};

class Sampler {
public:
    Sampler(const Mesh& mesh, std::span<const Index> kept, const MeshSampleOptions& options)
        : mesh_(mesh), options_(options), some_(mesh), kept_(kept) {
        const Index count = options.count > 0 ? options.count : sample_count(mesh);
        spacing_ = std::sqrt(mesh.area() / count);
        const auto parts = static_cast<std::size_t>(mesh.part_areas.size());
        triangles_.resize(parts);
        for (Index f = 0; f < mesh.triangles.rows(); ++f)
            triangles_[to_size(mesh.parts[to_size(mesh.triangles(f, 0))])].push_back(f);
        const auto of_parts = [&](std::size_t count, auto&& place) {
            return Grouped<Index>(to_index(parts), [&](auto&& take) {
                for (std::size_t k = 0; k < count; ++k)
                    if (const Index part = mesh.parts[to_size(place(k))]; part >= 0)
                        take(part, to_index(k));
            });
        };
        kept_of_ = of_parts(kept.size(), [&](std::size_t k) { return kept[k]; });
        if (mesh.borders.empty()) return;
        borders_of_ =
            of_parts(mesh.borders.size(), [&](std::size_t b) { return mesh.borders[b].front(); });
        kept_at_.assign(mesh.parts.size(), -1);
        for (Index part = 0; part < to_index(parts); ++part) {
            Index number = 0;
            for (const Index k : kept_of_[part]) {
                Index& at = kept_at_[to_size(kept[to_size(k)])];
                if (at < 0) at = number;
                ++number;
            }
        }
        std::vector<char> is_border(mesh.parts.size(), 0);
        for (const std::vector<Index>& border : mesh.borders)
            for (const Index place : border) is_border[to_size(place)] = 1;
        around_.resize(mesh.parts.size());
        for (Index c = 0; c < mesh.triangles.size(); ++c)
            if (const std::size_t place = to_size(mesh.triangles(c / 3, c % 3)); is_border[place])
                around_[place].push_back(c / 3);
    }

    MeshSamples all(Progress& progress) const {
        const auto parts = to_index(triangles_.size());
        MeshSamples result;
        result.kept.assign(kept_.size(), -1);
        Candidates chosen;
        const double total = mesh_.area();
        std::optional<MeshEdges> edges;
        double done = 0.0;
        for (Index part = 0; part < parts; ++part) {
            const double share = mesh_.part_areas[part] / total;
            const Progress::Part of_progress(progress, std::min(done, 1.0),
                                             std::min(done + share, 1.0));
            add_part(part, edges, chosen, result, progress);
            done += share;
        }
        finish(chosen, result, progress);
        return result;
    }

private:
    Index count_of(Index part) const {
        const double even = mesh_.part_areas[part] / (spacing_ * spacing_);
        const double all = mesh_.area() / (spacing_ * spacing_);
        const double least = std::min<double>(options_.least_per_part,
                                              0.25 * all / static_cast<double>(triangles_.size()));
        return to_index(std::lround(std::max({even, least, 1.0})));
    }

    /// `edges` are those of the whole mesh, found when first needed.
    void add_part(Index part, std::optional<MeshEdges>& edges, Candidates& chosen,
                  MeshSamples& result, Progress& progress) const {
        constexpr Index kCandidates = 4;  // a sample
        const Index even = count_of(part);
        PartCandidates from;
        add_kept(part, from);
        const double spacing = std::sqrt(mesh_.part_areas[part] / even);
        if (!mesh_.borders.empty()) {
            const double apart = distance_along_borders(part, even, spacing);
            for (const Index b : borders_of_[part]) add_border(to_size(b), apart, from);
        }
        if (options_.even) add_sharp_edges(part, even, spacing, edges, from.places);
        from.fixed = from.places.size();
        const Index count = std::max(even, from.fixed);
        if (!options_.even) {
            const Index first = chosen.size();
            for (std::size_t k = 0; k < from.kept.size(); ++k)
                result.kept[to_size(from.kept[k])] = first + to_index(k);
            for (const Index row : from.border) result.border.push_back(first + row);
            add_random(from.places, mesh_, triangles_[to_size(part)], count - from.fixed, progress);
            chosen.add(from.places);
            result.parts.insert(result.parts.end(), to_size(count), part);
            return;
        }
        add_random(from.places, mesh_, triangles_[to_size(part)], kCandidates * count, progress);

        Positions positions(from.places.size(), 3);
        Normals normals(from.places.size(), 3);
        parallel_for(
            from.places.size(), progress,
            [&](Index begin, Index end) {
                for (Index i = begin; i < end; ++i) {
                    positions.row(i) = position(from.places, i);
                    const Eigen::RowVector3d& facing = from.places.facing[to_size(i)];
                    normals.row(i) = facing.isZero()
                                         ? mesh_.normals.row(from.places.triangles[to_size(i)])
                                         : Eigen::RowVector3d(facing);
                }
            },
            0.0, 0.0);
        std::vector<Index> keep(to_size(from.fixed));
        std::iota(keep.begin(), keep.end(), 0);
        const Index first = chosen.size();
        for (const Index row : blue_noise(positions, normals, count, keep, progress))
            chosen.add(from.places, row);
        for (std::size_t k = 0; k < from.kept.size(); ++k)
            result.kept[to_size(from.kept[k])] = first + to_index(k);
        for (const Index row : from.border) result.border.push_back(first + row);
        result.parts.insert(result.parts.end(), to_size(count), part);
    }

    void add_kept(Index part, PartCandidates& from) const {
        for (const Index k : kept_of_[part]) {
            const Index place = kept_[to_size(k)];
            Eigen::RowVector3d at = Eigen::RowVector3d::Zero();
            at[some_.corner[to_size(place)]] = 1.0;
            from.places.add(some_.triangle[to_size(place)], at, mesh_.place_normals.row(place));
            from.kept.push_back(k);
        }
    }

    /// As far apart as samples, but where borders are so long for the area, as those of slivers and
    /// of very many faces that meet at one vertex, that hardly anything else would be sampled.
    double distance_along_borders(Index part, Index even, double spacing) const {
        constexpr double kMost = 16.0, kFew = 64.0;  // points along borders for each other sample
        double length = 0.0;
        for (const Index b : borders_of_[part])
            length += closed_length(mesh_.positions, mesh_.borders[to_size(b)]);
        return std::max(spacing, length / (kMost * even + kFew));
    }

    /// Kept places along the border, and between them points so far apart.
    void add_border(std::size_t which, double spacing, PartCandidates& from) const {
        const std::vector<Index>& loop = mesh_.borders[which];
        const std::vector<BorderSide> sides = sides_along(mesh_, loop, around_);
        std::vector<Index> along;
        double ahead = 0.0;  // to the next point
        for (std::size_t i = 0; i < loop.size(); ++i) {
            const Index place = loop[i], to = loop[(i + 1) % loop.size()];
            if (const Index kept = kept_at_[to_size(place)]; kept >= 0) {
                along.push_back(kept);
                ahead = spacing;
            }
            const double length = (mesh_.positions.row(to) - mesh_.positions.row(place)).norm();
            for (; ahead < length; ahead += spacing) {
                along.push_back(from.places.size());
                Eigen::RowVector3d at = Eigen::RowVector3d::Zero();
                at[sides[i].k] = 1.0 - ahead / length;
                at[(sides[i].k + 1) % 3] = ahead / length;
                from.places.add(sides[i].triangle, at);
            }
            ahead -= length;
        }
        if (which == 0) from.border = std::move(along);
    }

    /// Points along edges at which the surface bends so much that samples on both sides don't pass
    /// for neighbors: they face halfway between, and join them. Where edges are shorter than the
    /// distance between samples, the surface bends little by little. At most a third of the
    /// samples: where edges lie closer than samples, as those of wires do, most belong on the
    /// faces.
    void add_sharp_edges(Index part, Index count, double spacing, std::optional<MeshEdges>& edges,
                         Candidates& places) const {
        constexpr double kSharp = 0.25;  // cosine of the bend
        const auto length = [&](Index f, Index k) {
            return (mesh_.positions.row(mesh_.triangles(f, (k + 1) % 3)) -
                    mesh_.positions.row(mesh_.triangles(f, k)))
                .norm();
        };
        std::vector<Index> sides;
        for (const Index f : triangles_[to_size(part)])
            for (Index k = 0; k < 3; ++k)
                if (length(f, k) > 2.0 * spacing) sides.push_back(3 * f + k);
        if (sides.empty()) return;
        if (!edges) edges.emplace(mesh_.triangles);
        std::vector<std::pair<Index, Eigen::RowVector3d>> sharp;  // sides, and where they face
        double total = 0.0;
        for (const Index side : sides) {
            const Index f = side / 3, k = side % 3;
            const auto both = (*edges)[edges->edge_of(f, k)];
            if (both.size() != 2 || both[0].triangle != f || both[0].k != k) continue;
            // Faces wound against each other tell no bend.
            if (start_of(mesh_.triangles, both[0]) != end_of(mesh_.triangles, both[1])) continue;
            const auto normal = mesh_.normals.row(f);
            const auto other = mesh_.normals.row(both[1].triangle);
            const Eigen::RowVector3d facing = normal + other;
            constexpr double kNone = 1e-3;
            if (normal.dot(other) > kSharp || facing.norm() < kNone) continue;
            sharp.emplace_back(side, facing.normalized());
            total += length(f, k);
        }
        const double apart = std::max(spacing, 3.0 * total / static_cast<double>(count));
        for (const auto& [side, facing] : sharp) {
            const Index f = side / 3, k = side % 3;
            const auto steps = to_index(std::lround(length(f, k) / apart));
            for (Index i = 1; i < steps; ++i) {
                Eigen::RowVector3d at = Eigen::RowVector3d::Zero();
                at[(k + 1) % 3] = static_cast<double>(i) / static_cast<double>(steps);
                at[k] = 1.0 - at[(k + 1) % 3];
                places.add(f, at, facing);
            }
        }
    }

    Eigen::RowVector3d position(const Candidates& places, Index i) const {
        const auto t = mesh_.triangles.row(places.triangles[to_size(i)]);
        const auto& w = places.weights[to_size(i)];
        return w[0] * mesh_.positions.row(t[0]) + w[1] * mesh_.positions.row(t[1]) +
               w[2] * mesh_.positions.row(t[2]);
    }

    /// Smooth where the normals around are near that of the face.
    Eigen::RowVector3d normal(const Candidates& places, Index i) const {
        if (!places.facing[to_size(i)].isZero()) return places.facing[to_size(i)];
        const double least = std::cos(options_.crease * std::numbers::pi / 180.0);
        const Index f = places.triangles[to_size(i)];
        const Eigen::RowVector3d own = mesh_.normals.row(f);
        Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
        for (Index k = 0; k < 3; ++k) {
            const auto corner = mesh_.place_normals.row(mesh_.triangles(f, k));
            sum += places.weights[to_size(i)][k] * (corner.dot(own) < least ? own : corner);
        }
        return sum.normalized();
    }

    void finish(const Candidates& chosen, MeshSamples& result, Progress& progress) const {
        result.triangles = chosen.triangles;
        result.positions.resize(chosen.size(), 3);
        result.normals.resize(chosen.size(), 3);
        result.weights.resize(chosen.size(), 3);
        parallel_for(chosen.size(), progress, [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                result.positions.row(i) = position(chosen, i);
                result.normals.row(i) = normal(chosen, i);
                result.weights.row(i) = chosen.weights[to_size(i)];
            }
        });
    }

    const Mesh& mesh_;
    const MeshSampleOptions& options_;
    SomeTriangle some_;
    std::span<const Index> kept_;
    double spacing_ = 0.0;
    std::vector<std::vector<Index>> triangles_;  ///< of each part
    Grouped<Index> kept_of_, borders_of_;        ///< of each part
    std::vector<std::vector<Index>> around_;     ///< triangles at each place of a border
    std::vector<Index> kept_at_;  ///< which of its part's kept places a place is, or −1
};

}  // namespace

Index sample_count(const Mesh& mesh) {
    const auto places = static_cast<std::int64_t>(mesh.positions.rows());
    const auto few = std::clamp<std::int64_t>(8 * places, 3000, 12000);
    return to_index(std::clamp<std::int64_t>(places / 4, few, 50000));
}

MeshSamples sample_mesh(const Mesh& mesh, std::span<const Index> kept,
                        const MeshSampleOptions& options, Progress& progress) {
    return Sampler(mesh, kept, options).all(progress);
}

}  // namespace pointmorph

#include "pointmorph/mesh/wrapping.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "mesh/block_system.hpp"
#include "mesh/border_edges.hpp"
#include "mesh/carried_parts.hpp"
#include "mesh/coarse_mesh.hpp"
#include "mesh/creases.hpp"
#include "mesh/elastic_sheet.hpp"
#include "mesh/membrane.hpp"
#include "mesh/mending.hpp"
#include "mesh/relaxing.hpp"
#include "mesh/rigid_regions.hpp"
#include "mesh/untangling.hpp"
#include "mesh/wrap_borders.hpp"
#include "mesh/wrap_samples.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/mesh/vertex_images.hpp"

namespace pointmorph {

namespace {

/// Down to the first of these lengths the sheet keeps to its own bends; from the second on, it has
/// taken on those of the target. Earlier, what is folded more finely, such as an ear, would be
/// flattened, and wouldn't come back.
constexpr double kOwnBends = 0.07, kTargetBends = 0.02;
/// Down to this length it looks for its partners among the coarse samples.
constexpr double kCoarsePartners = 0.06;
/// Samples farther from the mesh pull, with at most the weight that they have at this length.
constexpr double kUncovered = 0.006;

/// 0 while the sheet keeps its own bends, 1 once it takes on the target's.
double flatness(double length) {
    return std::clamp(std::log(kOwnBends / length) / std::log(kOwnBends / kTargetBends), 0.0, 1.0);
}

std::vector<Positions> scaled(std::vector<Positions> lines, double scale) {
    for (Positions& line : lines) line *= scale;
    return lines;
}

/// The target's own faces, in √area.
struct Faces {
    const Mesh& mesh;
    Positions corners;
    TriangleTree tree;

    Faces(const Mesh& surface, double scale, Progress& progress)
        : mesh(surface),
          corners(surface.positions * scale),
          tree(corners, surface.triangles, progress) {}
    Faces(const Faces&) = delete;

    /// The rest of the way to them for a place on the plane at its partner, which is what the
    /// surface bends between samples: along the normal of the closest face, where that faces as the
    /// partner does. Not onto the closest point, which would fold faces at edges and borders.
    Vector3 way(const Vector3& place, const Vector3& facing) const {
        constexpr double kFar = 0.002, kAgree = 0.5;
        const SurfacePoint point = tree.closest(place, kFar);
        if (point.triangle < 0) return Vector3::Zero();
        const Vector3 normal = mesh.normals.row(point.triangle).transpose();
        if (normal.dot(facing) < kAgree) return Vector3::Zero();
        const Vector3 on = corners.row(mesh.triangles(point.triangle, 0)).transpose();
        return (on - place).dot(normal) * normal;
    }
};

/// What a mesh is wrapped onto, with `on_mesh` of WrapTarget for this mesh.
struct Ground {
    WrapTrees& trees;
    const std::vector<SurfacePoint>& on_mesh;
};

/// Lengths in √area of both surfaces.
class Wrapping {
public:
    /// `start` in √area.
    Wrapping(const Mesh& mesh, Positions start, const Ground& ground, const WrapHolds& holds,
             const WrapOptions& options, Progress& progress)
        : mesh_(mesh),
          options_(options),
          scale_(ground.trees.scale()),
          x_(std::move(start)),
          sheet_(mesh.positions, mesh.triangles, progress, 1.0 / std::sqrt(mesh.area())),
          samples_(mesh, x_, ground.on_mesh, ground.trees),
          borders_(mesh, x_, scaled(ground.trees.target().borders, scale_), progress),
          tree_(x_, mesh.triangles, progress),
          rigid_(mesh, holds.rigid),
          fixed_(holds.fixed),
          held_(holds.places * scale_) {
        for (const WrapMark& mark : holds.marks)
            marks_.push_back({mark.place, mark.target * scale_});
        double edges = 0.0;
        for (const double sum : sheet_.laplacian().sums) edges += sum > 0.0 ? 1.0 : 0.0;
        spacing_ = 1.0 / std::sqrt(std::max(edges, 1.0));
    }

    /// Gives way over each of the lengths in turn.
    void settle(std::span<const double> lengths, Progress& progress) {
        const double count = static_cast<double>(lengths.size());
        for (std::size_t k = 0; k < lengths.size(); ++k) {
            const Progress::Part part(progress, static_cast<double>(k) / count,
                                      static_cast<double>(k + 1) / count);
            settle(lengths[k], progress);
        }
    }

    /// Turns back what lies against the target, puts all onto it, and onto the faces of `surface`
    /// where there is one, lets them slide, and smooths what is creased. Where that takes the mesh
    /// off much of the target, what keeps it there stays as it lies: the wall of a hole that the
    /// target doesn't have.
    void finish(const Mesh* surface, Progress& progress) {
        std::optional<Faces> faces;
        if (surface) faces.emplace(*surface, scale_, progress);
        finish(faces ? &*faces : nullptr, progress);
        if (faces) span_openings(*faces, progress);
    }

    /// In √area.
    Positions places() && { return std::move(x_); }

private:
    void finish(const Faces* faces, Progress& progress) {
        // Of 40 pairs of things, turning back bared 65 to 71 % where a torus became a ball, and
        // otherwise less than 2 %, but for a torus on a head with two holes.
        constexpr double kMuch = 0.03;  // of the area
        const Positions settled = x_;
        finish_on(faces, progress);
        const double bare = bare_by_face(x_, progress).sum();
        if (bare < kMuch || !(bare > bare_by_face(settled, progress).sum() + kMuch)) return;
        const Positions bared = std::exchange(x_, settled);
        stays_on_ = true;
        finish_on(faces, progress);
        if (!(bare_by_face(x_, progress).sum() < bare)) x_ = bared;
    }

    /// What has gone beyond the target's ends spans its openings as a membrane, unless that bares
    /// what was reached. Drawn to planes that go on beyond them, it would stick out of them.
    void span_openings(const Faces& faces, Progress& progress) {
        // Of things, up to .01 were bared; of a ball on loose cards, .26 to .46.
        constexpr double kMuch = 0.05;  // of the area
        if (faces.mesh.borders.empty()) return;
        const std::vector<char> is_beyond =
            beyond_ends(faces.mesh, faces.tree, x_, sheet_.normals(x_, progress), progress);
        const std::vector<char> is_fixed = fixed(0.0);
        std::vector<Index> beyond;
        for (Index v = 0; v < x_.rows(); ++v)
            if (is_beyond[to_size(v)] && !is_fixed[to_size(v)] && !sheet_.around(v).empty())
                beyond.push_back(v);
        if (beyond.empty()) return;
        const auto unreached = [&] {
            tree_.move(x_, progress);
            return samples_.share() *
                   static_cast<double>(samples_.uncovered(tree_, kUncovered, progress).size());
        };
        const Positions before = x_;
        const double least = unreached();
        span_membrane(sheet_.laplacian(), beyond, x_, progress);
        if (unreached() > least + kMuch) x_ = before;
    }

    void finish_on(const Faces* faces, Progress& progress) {
        sides_ =
            samples_.partners(x_, sheet_.normals(x_, progress), WrapTrees::kFine, progress).normals;
        turn_back(progress);
        land(faces, progress);
        slide(faces, progress);
        smooth_creases(faces, progress);
    }

    void settle(double length, Progress& progress) {
        const double rings = length / spacing_;
        const int sweeps = static_cast<int>(std::clamp(0.3 * rings * rings, 3.0, 60.0));
        {
            const Progress::Part part(progress, 0.0, 0.0);
            sheet_.set_metric(x_, sweeps, progress);
            find_areas(progress);
            find_pulls(length, progress);
        }
        // Much shorter than the sides of triangles, a length only brings vertices to the surface.
        constexpr double kShort = 0.3;
        const Index iterations = length < kShort * spacing_ ? 1 : options_.iterations;
        // Creases of long lengths are smoothed by shorter ones; those of the last ones stay, and
        // around marks, where the sheet can't slide, those of longer ones, too.
        constexpr double kLasts = 0.005, kLastsAtMarks = 0.02;
        const bool lasts = length < kLasts;
        const bool lasts_at_marks = !lasts && length < kLastsAtMarks && !marks_.empty();
        const Positions before = lasts || lasts_at_marks ? x_ : Positions();
        for (Index i = 0; i < iterations; ++i) {
            const Progress::Part part(progress, static_cast<double>(i) / iterations,
                                      static_cast<double>(i + 1) / iterations);
            step(length, progress);
        }
        if (lasts) take_back(before, {}, progress);
        if (lasts_at_marks) take_back(before, far_from_marks(length), progress);
    }

    /// Of each vertex, whether it is too far from all marks for one to hold it.
    std::vector<char> far_from_marks(double length) const {
        constexpr double kAround = 12.0;  // lengths
        const double squared = kAround * kAround * length * length;
        std::vector<char> result(to_size(x_.rows()), 1);
        for (Index v = 0; v < x_.rows(); ++v)
            result[to_size(v)] = std::ranges::none_of(marks_, [&](const WrapMark& mark) {
                return (x_.row(v).transpose() - mark.target).squaredNorm() < squared;
            });
        return result;
    }

    void take_back(const Positions& before, const std::vector<char>& stays, Progress& progress) {
        if (options_.keep_uncreased) take_back_creases(mesh_, sheet_, before, stays, x_, progress);
    }

    /// Areas around vertices as the metric would have them.
    void find_areas(Progress& progress) {
        areas_ = Values::Zero(x_.rows());
        const double all = mesh_.area();
        parallel_for(to_index(x_.rows()), progress, [&](Index begin, Index end) {
            for (Index v = begin; v < end; ++v)
                for (const Index c : sheet_.around(v))
                    areas_[v] += mesh_.areas[c / 3] / all * sheet_.area_ratio(c / 3) / 3.0;
        });
    }

    /// Coarse samples that no face reaches.
    void find_pulls(double length, Progress& progress) {
        tree_.move(x_, progress);
        pulls_.clear();
        const double reach = std::max(length, kUncovered);
        for (const Index s : samples_.uncovered(tree_, kUncovered, progress))
            pulls_.push_back({s, 0.5 * samples_.share() / (reach * reach)});
    }

    void step(double length, Progress& progress) {
        Positions right;
        std::vector<SymmetricBlock> blocks;
        add_partners(length, blocks, right, progress);
        add_pulls(blocks, right);
        hold_fixed(blocks, right);
        borders_.draw(x_, length, blocks, right);
        constexpr double kMark = 1e4;
        for (const WrapMark& mark : marks_) {
            blocks[to_size(mark.place)].add_isotropic(kMark);
            right.row(mark.place) += kMark * mark.target.transpose();
        }
        solve(sheet_.laplacian(), blocks, std::move(right), {}, x_, progress);
        rigid_.keep(x_);
    }

    /// What the sheet would be, and what its vertices are drawn to.
    void add_partners(double length, std::vector<SymmetricBlock>& blocks, Positions& right,
                      Progress& progress) {
        const double flat = flatness(length);
        const auto kind = length > kCoarsePartners ? WrapTrees::kCoarse : WrapTrees::kFine;
        const Normals normals = sheet_.normals(x_, progress);
        const WrapPartners partners = samples_.partners(x_, normals, kind, progress);
        right = sheet_.forces(x_, partners.normals, flat, progress);
        blocks.assign(to_size(x_.rows()), {});
        constexpr double kFull = 0.5;  // cosine between normals at which a partner counts in full
        parallel_for(to_index(x_.rows()), progress, [&](Index begin, Index end) {
            for (Index v = begin; v < end; ++v) {
                const Vector3 normal = partners.normals.row(v).transpose();
                const double agreement =
                    std::clamp(normals.row(v).dot(partners.normals.row(v)) / kFull, 0.0, 1.0);
                const double weight = options_.conform * agreement * areas_[v] / (length * length);
                blocks[to_size(v)].add_along(normal, weight);
                right.row(v) += weight * partners.positions.row(v).dot(partners.normals.row(v)) *
                                partners.normals.row(v);
            }
        });
    }

    void hold_fixed(std::vector<SymmetricBlock>& blocks, Positions& right) const {
        constexpr double kFixed = 1e3;
        for (Eigen::Index v = 0; v < fixed_.rows(); ++v) {
            if (!(fixed_[v] > 0.0)) continue;
            blocks[to_size(v)].add_isotropic(kFixed * fixed_[v]);
            right.row(v) += kFixed * fixed_[v] * held_.row(v);
        }
    }

    void add_pulls(std::vector<SymmetricBlock>& blocks, Positions& right) const {
        for (const auto& [sample, weight] : pulls_) {
            const SurfacePoint& point = samples_.on_mesh(sample);
            const auto corners = mesh_.triangles.row(point.triangle);
            const Vector3 way = samples_.position(sample) - place_of(point, mesh_.triangles, x_);
            for (Index k = 0; k < 3; ++k) {
                const double share = options_.conform * weight * point.weights[k];
                blocks[to_size(corners[k])].add_isotropic(share);
                right.row(corners[k]) += share * (x_.row(corners[k]) + way.transpose());
            }
        }
    }

    /// Marks, and what is held more than this.
    std::vector<char> fixed(double most) const {
        std::vector<char> result(to_size(x_.rows()), 0);
        for (const WrapMark& mark : marks_) result[to_size(mark.place)] = 1;
        for (Index v = 0; v < x_.rows(); ++v)
            if (held(v) > most) result[to_size(v)] = 1;
        return result;
    }

    /// Turns faces that lie against the target, where that doesn't crease more of them. Which side
    /// of a sheet a vertex is on, its partner knows: its own faces may lie against it.
    void turn_back(Progress& progress) {
        constexpr double kHeld = 0.5;
        const std::vector<char> is_fixed = fixed(kHeld);
        sheet_.set_metric(x_, 8, progress);
        const Creases creases(mesh_, sheet_);
        for (Index round = 0; round < options_.untangling; ++round) {
            const WrapPartners partners = samples_.partners(x_, sides_, WrapTrees::kFine, progress);
            sides_ = partners.normals;
            const Index before = left_;
            UntangleOptions untangling;
            if (options_.keep_uncreased) untangling.creases = &creases;
            untangling.off = [&](Index v, const Vector3& place) {
                return (samples_.partner(v, place, sides_.row(v).transpose()).first - place).norm();
            };
            if (stays_on_)
                untangling.bare = [&](const Positions& at) { return bare_by_face(at, progress); };
            left_ = untangle(mesh_, sheet_, partners, is_fixed, untangling, x_, progress);
            if (left_ == 0 || (round > 0 && left_ >= before)) break;
        }
    }

    /// Of each face: the area of the samples that lie there by the inverse map and that no face of
    /// the mesh reaches, with vertices at `x`.
    Values bare_by_face(const Positions& x, Progress& progress) {
        constexpr double kFar = 0.05;
        tree_.move(x, progress);
        Values result = Values::Zero(mesh_.triangles.rows());
        for (const Index s : samples_.uncovered(tree_, kFar, progress))
            result[samples_.on_mesh(s).triangle] += samples_.share();
        return result;
    }

    /// fixed(), and the vertices of borders.
    std::vector<char> fixed_and_borders() const {
        std::vector<char> result = fixed(0.0);
        for (const std::vector<Index>& border : mesh_.borders)
            for (const Index v : border) result[to_size(v)] = 1;
        return result;
    }

    /// Slides along the surface, each vertex at its distance from it.
    void slide(const Faces* faces, Progress& progress) {
        if (options_.relaxing == 0) return;
        RelaxGround ground{.is_fixed = fixed_and_borders(),
                           .landed = {},
                           .sides = sides_,
                           .is_onto = options_.conform == 1.0};
        ground.landed = [&](Index v, const Vector3& place, const Vector3& facing) {
            const auto [at, normal] = samples_.partner(v, place, facing);
            const Vector3 on = place + (at - place).dot(normal) * normal;
            return std::pair<Vector3, Vector3>(faces ? Vector3(on + faces->way(on, normal)) : on,
                                               normal);
        };
        relax(mesh_, sheet_, ground, options_.relaxing, x_, progress);
    }

    void smooth_creases(const Faces* faces, Progress& progress) {
        if (creased_faces(mesh_, sheet_, x_, progress).empty()) return;
        const std::vector<char> is_fixed = fixed_and_borders();
        MendTarget target;
        target.landed = [&](Index v, const Vector3& place, const Vector3& facing) -> Vector3 {
            const auto [at, normal] = samples_.partner(v, place, facing);
            const Vector3 on = place + landing(v) * (at - place).dot(normal) * normal;
            return faces ? Vector3(on + landing(v) * faces->way(on, normal)) : on;
        };
        target.samples.resize(samples_.size(), 3);
        for (Index s = 0; s < samples_.size(); ++s)
            target.samples.row(s) = samples_.position(s).transpose();
        mend(mesh_, sheet_, target, is_fixed, tree_, x_, progress);
    }

    /// Onto the planes of the closest samples, and marks onto their targets. What that would crease
    /// stays off the surface, unless it is held elsewhere.
    void land(const Faces* faces, Progress& progress) {
        const Positions before = x_;
        const WrapPartners partners = samples_.partners(x_, sides_, WrapTrees::kFine, progress);
        for (Index v = 0; v < x_.rows(); ++v) {
            if (sheet_.around(v).empty()) continue;
            const Eigen::RowVector3d normal = partners.normals.row(v);
            x_.row(v) += landing(v) * (partners.positions.row(v) - x_.row(v)).dot(normal) * normal;
        }
        if (faces) onto_faces(*faces, partners, progress);
        if (options_.conform == 1.0) borders_.land(x_);
        rigid_.keep(x_);
        for (Eigen::Index v = 0; v < fixed_.rows(); ++v)
            if (fixed_[v] > 0.0) x_.row(v) += fixed_[v] * (held_.row(v) - x_.row(v));
        for (const WrapMark& mark : marks_) x_.row(mark.place) = mark.target.transpose();
        take_back(before, fixed(0.0), progress);
    }

    void onto_faces(const Faces& faces, const WrapPartners& partners, Progress& progress) {
        parallel_for(to_index(x_.rows()), progress, [&](Index begin, Index end) {
            for (Index v = begin; v < end; ++v) {
                if (sheet_.around(v).empty()) continue;
                const Vector3 place = x_.row(v).transpose();
                const Vector3 normal = partners.normals.row(v).transpose();
                x_.row(v) += landing(v) * faces.way(place, normal).transpose();
            }
        });
    }

    /// How much a place is kept from going where it would.
    double held(Index v) const {
        return std::max(rigid_.weight(v), fixed_.rows() > 0 ? fixed_[v] : 0.0);
    }
    /// How far of the way to the surface it lands.
    double landing(Index v) const { return options_.conform * (1.0 - held(v)); }

    struct Pull {
        Index sample;
        double weight;
    };

    const Mesh& mesh_;
    const WrapOptions& options_;
    double scale_;
    Positions x_;
    ElasticSheet sheet_;
    WrapSamples samples_;
    WrapBorders borders_;
    TriangleTree tree_;
    RigidRegions rigid_;
    Values fixed_;    ///< none, or one a place
    Positions held_;  ///< where fixed places stay
    std::vector<WrapMark> marks_;
    std::vector<Pull> pulls_;
    Values areas_;
    Normals sides_;          ///< of the partners
    bool stays_on_ = false;  ///< whether turning faces back may not bare the target
    Index left_ = 0;         ///< faces that lie against the target
    double spacing_ = 0.0;
};

std::vector<double> all_lengths(const WrapOptions& options) {
    std::vector<double> lengths;
    // The last is no more than half a step from the one before.
    const double end = options.last_length / std::sqrt(options.share);
    for (double length = options.first_length; length > end; length *= options.share)
        lengths.push_back(length);
    lengths.push_back(options.last_length);
    return lengths;
}

/// A coarse mesh, and the lengths over which it stands for all.
struct Level {
    CoarseMesh coarse;
    std::span<const double> lengths;
    const WrapOptions& options;
};

/// From few places to many.
std::vector<Level> coarse_levels(const Mesh& mesh, std::span<const double> lengths,
                                 const WrapHolds& holds, const WrapOptions& options,
                                 Progress& progress) {
    std::vector<Level> levels;
    std::vector<Index> counts, kept;
    for (Index places = options.coarse_places; mesh.positions.rows() > 2 * places; places *= 4) {
        // The least length for the distance between so many places.
        const double least =
            options.coarse_length *
            std::sqrt(static_cast<double>(options.coarse_places) / static_cast<double>(places));
        const auto end = std::ranges::find_if_not(lengths, [&](double l) { return l > least; });
        if (end == lengths.begin()) continue;
        levels.push_back({{}, {lengths.begin(), end}, options});
        counts.push_back(places);
        lengths = {end, lengths.end()};
    }
    for (const WrapMark& mark : holds.marks) kept.push_back(mark.place);
    std::ranges::sort(kept);
    kept.erase(std::ranges::unique(kept).begin(), kept.end());
    std::vector<CoarseMesh> meshes = coarse_meshes(mesh, counts, kept, progress);
    for (std::size_t k = 0; k < levels.size(); ++k) levels[k].coarse = std::move(meshes[k]);
    return levels;
}

/// Where the places are once a coarse mesh has given way in place of all, in √area.
Positions after_coarse_mesh(const Mesh& mesh, const Positions& start, const Ground& ground,
                            const WrapHolds& holds, Level level, Progress& progress) {
    const CoarseMesh& coarse = level.coarse;
    std::vector<WrapMark> coarse_marks;
    for (const WrapMark& mark : holds.marks) {
        const auto row = std::ranges::lower_bound(coarse.rows, mark.place) - coarse.rows.begin();
        coarse_marks.push_back({to_index(row), mark.target});
    }
    const TriangleTree tree(coarse.mesh.positions, coarse.mesh.triangles, progress);
    std::vector<SurfacePoint> on_coarse = ground.on_mesh;
    parallel_for(
        to_index(on_coarse.size()), progress,
        [&](Index begin, Index end) {
            for (Index s = begin; s < end; ++s) {
                SurfacePoint& point = on_coarse[to_size(s)];
                if (point.triangle >= 0)
                    point = tree.closest(place_of(point, mesh.triangles, mesh.positions));
            }
        },
        0.0, 0.0, 64);
    WrapHolds coarse_holds{.marks = coarse_marks};
    if (holds.rigid.rows() > 0) coarse_holds.rigid = gather(holds.rigid, coarse.rows);
    if (holds.fixed.rows() > 0) {
        coarse_holds.fixed = gather(holds.fixed, coarse.rows);
        coarse_holds.places = gather(holds.places, coarse.rows);
    }
    Wrapping wrapping(coarse.mesh, gather(start, coarse.rows), {ground.trees, on_coarse},
                      coarse_holds, level.options, progress);
    wrapping.settle(level.lengths, progress);
    const double spacing =
        std::sqrt(mesh.area() / static_cast<double>(coarse.mesh.positions.rows()));
    const std::vector<Index> coarse_parts = gather(mesh.parts, coarse.rows);
    Positions result =
        carried_positions({mesh.positions, mesh.place_normals, mesh.parts},
                          {coarse.mesh.positions, coarse.mesh.place_normals, coarse_parts},
                          std::move(wrapping).places(), spacing, progress);
    // Small parts have too few places to be carried by: they are where the map took them.
    constexpr int kEnough = 24;
    std::vector<int> places_of_part(to_size(mesh.part_areas.size()), 0);
    for (std::size_t k = 0; k < coarse.rows.size(); ++k)
        if (const Index part = mesh.parts[to_size(coarse.rows[k])];
            part >= 0 && coarse.mesh.parts[k] >= 0)
            ++places_of_part[to_size(part)];
    for (Index p = 0; p < result.rows(); ++p) {
        const Index part = mesh.parts[to_size(p)];
        if (part < 0 || places_of_part[to_size(part)] < kEnough) result.row(p) = start.row(p);
    }
    return result;
}

/// wrap() of all parts alike.
Positions all_wrapped(const Mesh& mesh, Positions x, const Ground& ground, const WrapHolds& holds,
                      const WrapOptions& options, Progress& progress) {
    const std::vector<double> lengths = all_lengths(options);
    x *= ground.trees.scale();
    std::size_t done = 0;
    const auto share = [&](std::size_t count) {
        return static_cast<double>(count) / static_cast<double>(lengths.size());
    };
    std::vector<Level> levels = coarse_levels(mesh, lengths, holds, options, progress);
    for (Level& level : levels) {
        const std::size_t end = done + level.lengths.size();
        const Progress::Part part(progress, share(done), share(end));
        x = after_coarse_mesh(mesh, x, ground, holds, std::move(level), progress);
        done = end;
    }
    const Progress::Part part(progress, share(done), 1.0);
    Wrapping wrapping(mesh, std::move(x), ground, holds, options, progress);
    wrapping.settle(std::span(lengths).subspan(done), progress);
    wrapping.finish(ground.trees.target().mesh, progress);
    Positions result = std::move(wrapping).places();
    result /= ground.trees.scale();
    for (Eigen::Index v = 0; v < holds.fixed.rows(); ++v)
        if (holds.fixed[v] == 1.0) result.row(v) = holds.places.row(v);
    for (const WrapMark& mark : holds.marks) result.row(mark.place) = mark.target.transpose();
    return result;
}

}  // namespace

Positions wrap(const Mesh& mesh, Positions start, const WrapTarget& target, const WrapHolds& holds,
               const WrapOptions& options, Progress& progress) {
    const bool fits = target.mesh && target.mesh->triangles.rows() == mesh.triangles.rows() &&
                      target.mesh->positions.rows() == start.rows() &&
                      target.mesh->triangles == mesh.triangles && target.mesh->positions == start;
    if (fits || mesh.triangles.rows() == 0) return start;

    WrapTrees trees(target, 1.0 / std::sqrt(target.area));
    std::vector<Index> carried;
    if (mesh.part_areas.size() > 1)
        carried = parts_without_counterpart(
            mesh, parts_kept_to(mesh, start, target.coarse.positions, target.coarse_parts),
            target.on_mesh, holds);
    if (carried.empty())
        return all_wrapped(mesh, std::move(start), {trees, target.on_mesh}, holds, options,
                           progress);
    std::vector<SurfacePoint> on_mesh = target.on_mesh;
    const Mesh rest = without_parts(mesh, carried, on_mesh, progress);
    Positions result =
        all_wrapped(rest, std::move(start), {trees, on_mesh}, holds, options, progress);
    carry_parts(mesh, rest, carried, result, progress);
    if (target.mesh && target.mesh->borders.empty())
        sink_parts(mesh, carried, *target.mesh, result, progress);
    return result;
}

}  // namespace pointmorph

#include "pointmorph/measures/mesh_quality.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "measures/measured_map.hpp"
#include "measures/place_words.hpp"
#include "mesh/border_edges.hpp"
#include "mesh/mesh_edges.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/mesh/closest_point.hpp"
#include "pointmorph/mesh/mesh_samples.hpp"
#include "pointmorph/surface/boundary.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t kFigures = 4;
using Limits = std::array<double, kFigures>;
/// Of a good mesh, and of a fair one: as 22 morphs looked to the eye, see docs/stages.
constexpr Limits kGood{1e-3, 2e-3, 7e-3, 5e-4}, kFair{5e-3, 1e-2, 2e-2, 3e-3};

Limits in_order(const MeshFigures& figures) {
    return {figures.folded, figures.creased, figures.uncovered, figures.off};
}

constexpr double kFolds = -0.5;    // cosine of a bend by 120°
constexpr double kCreases = 0.0;   // of one by 90°
constexpr double kAgainst = -0.2;  // cosine between a face and the target that it lies against

/// Edges of two triangles, and the cosine of the angle by which each bends.
struct Bends {
    std::vector<std::array<MeshEdges::Side, 2>> edges;
    std::vector<double> cosines;
};

/// Normals of triangles, as long as their areas.
Normals area_normals(const Positions& x, const Triangles& triangles) {
    Normals normals(triangles.rows(), 3);
    for (Index f = 0; f < triangles.rows(); ++f) {
        const Eigen::RowVector3d p = x.row(triangles(f, 0));
        const Eigen::RowVector3d u = x.row(triangles(f, 1)) - p, v = x.row(triangles(f, 2)) - p;
        normals.row(f) = 0.5 * u.cross(v);
    }
    return normals;
}

Bends find_bends(const Triangles& triangles, const Normals& area_normals) {
    const MeshEdges edges(triangles);
    Bends bends;
    for (Index e = 0; e < edges.size(); ++e) {
        const auto sides = edges[e];
        if (sides.size() != 2) continue;
        const auto a = area_normals.row(sides[0].triangle), b = area_normals.row(sides[1].triangle);
        const double length = a.norm() * b.norm();
        bends.edges.push_back({sides[0], sides[1]});
        bends.cosines.push_back(length > 0.0 ? a.dot(b) / length : 0.0);
    }
    return bends;
}

/// Something wrong at a place; lengths in √area of the target.
struct Fault {
    Vector3 place;
    Index vertex;     ///< of the source, a place of its mesh
    double share;     ///< of what the figure counts
    double distance;  ///< 0 where that isn't a distance
    double badness;   ///< 1: the figure is at the limit of a good mesh by this alone
};

/// The target, in lengths in which its area is 1.
class Surface {
public:
    Surface(const WrappedSurface& target, Progress& progress)
        : cloud_(target.cloud),
          mesh_(target.mesh),
          unit_(mesh_ ? mesh_->unit : normalization(cloud_.positions)),
          points_(mesh_ ? mesh_->positions : unit_.apply(cloud_.positions)),
          point_tree_(points_) {
        if (mesh_) triangles_ = mesh_->triangles;
        const double area = mesh_ ? mesh_->area() : estimated_area(point_tree_);
        unit_.scale *= std::sqrt(area > 0.0 ? area : 1.0);
        points_ /= std::sqrt(area > 0.0 ? area : 1.0);
        point_tree_ = KdTree<3>(points_);
        if (mesh_) tree_.emplace(points_, triangles_, progress);
        find_samples(progress);
        sample_tree_.emplace(samples_);
    }
    Surface(const Surface&) = delete;

    const Normalization& unit() const { return unit_; }
    bool has_mesh() const { return mesh_ != nullptr; }
    /// Of its mesh, over √area; 0 of a bare cloud.
    double border_length() const { return mesh_ ? pointmorph::border_length(*mesh_) : 0.0; }
    /// Evenly spread.
    const Positions& samples() const { return samples_; }

    struct Foot {
        Vector3 normal;
        double distance;  ///< from the surface; from its plane where there are only points
    };
    Foot foot(const Vector3& place) const {
        if (tree_) {
            const SurfacePoint point = tree_->closest(place);
            return {mesh_->normals.row(point.triangle).transpose(),
                    std::sqrt(point.squared_distance)};
        }
        const Index row = nearest_point(place);
        const Vector3 normal = cloud_.normals.row(row).transpose().normalized();
        return {normal, std::abs((place - points_.row(row).transpose()).dot(normal))};
    }

    /// The row of the cloud nearest to a place.
    Index nearest_row(const Vector3& place) const {
        const Index point = nearest_point(place);
        if (!mesh_) return point;
        const auto vertex = std::ranges::find(mesh_->places, point);
        return to_index(vertex - mesh_->places.begin());
    }

    /// Whether the target bends from one of these directions to the other near a place, each up to
    /// 45°. Directions over 135° apart may also be those of both sides of a thin part, which
    /// bends at its rim only: there, all of it lies to one side.
    bool bends_between(const Vector3& place, const Vector3& one, const Vector3& other) const {
        constexpr double kNear = 0.015, kAlong = std::numbers::sqrt2 / 2.0;
        constexpr double kOneSided = 0.25;  // of the reach; at a straight rim the mean is 0.42 off
        const double spacing = 1.0 / std::sqrt(static_cast<double>(samples_.rows()));
        const double reach = std::max(kNear, 1.5 * spacing);
        std::vector<std::pair<Index, double>> near;
        sample_tree_->within_unsorted(place.data(), reach, near);
        std::vector<Index> along_one, along_other;
        Vector3 mean = Vector3::Zero();
        for (const auto& [sample, squared] : near) {
            mean += (samples_.row(sample).transpose() - place) / static_cast<double>(near.size());
            if (sample_normals_.row(sample).dot(one) > kAlong) along_one.push_back(sample);
            if (sample_normals_.row(sample).dot(other) > kAlong) along_other.push_back(sample);
        }
        if (along_one.empty() || along_other.empty()) return false;
        if (mean.norm() > kOneSided * reach) return true;
        return std::ranges::any_of(along_one, [&](Index a) {
            return std::ranges::any_of(along_other, [&](Index b) {
                return sample_normals_.row(a).dot(sample_normals_.row(b)) > -kAlong;
            });
        });
    }

private:
    Index nearest_point(const Vector3& place) const {
        Index row = 0;
        double squared = 0.0;
        point_tree_.nearest(place.data(), {&row, 1}, {&squared, 1});
        return row;
    }

    void find_samples(Progress& progress) {
        constexpr Index kSamples = 30000;
        if (mesh_) {
            const MeshSamples made =
                sample_mesh(*mesh_, {}, {.count = kSamples, .even = false}, progress);
            // Those along borders would be too many.
            std::vector<Index> inner;
            for (Index i = 0; i < made.size(); ++i)
                if (made.weights.row(i).minCoeff() > 0.0) inner.push_back(i);
            samples_ = gather(made.positions, inner) * (mesh_->unit.scale / unit_.scale);
            sample_normals_ = gather(made.normals, inner);
            return;
        }
        const auto count = to_index(points_.rows());
        const Index step = (count + kSamples - 1) / kSamples;
        samples_.resize((count + step - 1) / step, 3);
        sample_normals_.resize(samples_.rows(), 3);
        for (Index i = 0; i < samples_.rows(); ++i) {
            samples_.row(i) = points_.row(i * step);
            sample_normals_.row(i) = cloud_.normals.row(i * step).normalized();
        }
    }

    const Cloud& cloud_;
    const Mesh* mesh_;
    Normalization unit_;
    Positions points_;
    KdTree<3> point_tree_;
    Triangles triangles_{0, 3};
    std::optional<TriangleTree> tree_;
    Positions samples_;
    Normals sample_normals_;
    std::optional<KdTree<3>> sample_tree_;
};

/// The wrapped mesh on the target: its figures and its faults.
class Measured {
public:
    Measured(const WrappedMesh& wrapped, const Surface& target, Progress& progress)
        : mesh_(wrapped.mesh), target_(target), x_(mesh_.positions.rows(), 3) {
        const Positions placed = target.unit().apply(wrapped.positions);
        for (std::size_t v = mesh_.places.size(); v-- > 0;)
            x_.row(mesh_.places[v]) = placed.row(static_cast<Eigen::Index>(v));
        normals_ = area_normals(x_, mesh_.triangles);
        bends_ = find_bends(mesh_.triangles, normals_);
        rest_ = find_bends(mesh_.triangles, mesh_.normals);
        find_folded(progress);
        find_creased();
        find_uncovered(wrapped.leaves_missing && target.has_mesh() &&
                           goes_on(border_length(mesh_), target.border_length()),
                       progress);
        find_off(progress);
    }

    MeshFigures figures;
    std::array<std::vector<Fault>, kFigures> faults;

private:
    std::vector<Fault>& faults_of(MeshFlaw flaw) { return faults[to_size(flaw)]; }

    Vector3 middle(Index f) const {
        const auto t = mesh_.triangles.row(f);
        return (x_.row(t[0]) + x_.row(t[1]) + x_.row(t[2])).transpose() / 3.0;
    }

    /// What is folded at rest as well, such as two sides of a thin plate, is no fault.
    void find_folded(Progress& progress) {
        std::vector<Index> sharp;
        for (std::size_t e = 0; e < bends_.edges.size(); ++e)
            if (bends_.cosines[e] < kFolds && rest_.cosines[e] >= kFolds)
                for (const MeshEdges::Side& side : bends_.edges[e]) sharp.push_back(side.triangle);
        std::ranges::sort(sharp);
        sharp.erase(std::ranges::unique(sharp).begin(), sharp.end());
        std::vector<char> against(sharp.size(), 0);
        parallel_for(
            to_index(sharp.size()), progress,
            [&](Index begin, Index end) {
                for (Index i = begin; i < end; ++i) {
                    const Index f = sharp[to_size(i)];
                    const Vector3 normal = normals_.row(f).transpose().normalized();
                    against[to_size(i)] = normal.dot(target_.foot(middle(f)).normal) < kAgainst;
                }
            },
            0.0, 0.2, 128);
        const double area = normals_.rowwise().norm().sum();
        for (std::size_t i = 0; i < sharp.size(); ++i) {
            if (!against[i]) continue;
            const double share = normals_.row(sharp[i]).norm() / area;
            figures.folded += share;
            faults_of(MeshFlaw::kFolded)
                .push_back({middle(sharp[i]), mesh_.triangles(sharp[i], 0), share, 0.0,
                            share / kGood[to_size(MeshFlaw::kFolded)]});
        }
    }

    /// Edges that bend at rest as well, or along the target, are no faults.
    void find_creased() {
        const double share =
            1.0 / static_cast<double>(std::max<std::size_t>(1, bends_.edges.size()));
        for (std::size_t e = 0; e < bends_.edges.size(); ++e) {
            if (bends_.cosines[e] >= kCreases || rest_.cosines[e] < kCreases) continue;
            const auto& [one, other] = bends_.edges[e];
            const Index from = start_of(mesh_.triangles, one);
            const Vector3 place =
                0.5 * (x_.row(from) + x_.row(end_of(mesh_.triangles, one))).transpose();
            const auto side = [&](const MeshEdges::Side& of) -> Vector3 {
                return normals_.row(of.triangle).transpose().normalized();
            };
            if (target_.bends_between(place, side(one), side(other))) continue;
            figures.creased += share;
            faults_of(MeshFlaw::kCreased)
                .push_back({place, from, share, 0.0, share / kGood[to_size(MeshFlaw::kCreased)]});
        }
    }

    void find_uncovered(bool leaves_missing, Progress& progress) {
        const Positions& samples = target_.samples();
        const auto count = to_index(samples.rows());
        const TriangleTree tree(x_, mesh_.triangles, progress);
        std::vector<SurfacePoint> feet(to_size(count));
        parallel_for(
            count, progress,
            [&](Index begin, Index end) {
                for (Index i = begin; i < end; ++i)
                    feet[to_size(i)] = tree.closest(samples.row(i).transpose());
            },
            0.2, 0.6, 128);
        std::vector<double> distances;
        const double limit = kGood[to_size(MeshFlaw::kUncovered)];
        constexpr double kCounted = 0.01;  // of the samples lie beyond the percentile
        std::optional<BorderEdges> borders;
        if (leaves_missing) borders.emplace(mesh_);
        for (Index i = 0; i < count; ++i) {
            const SurfacePoint& foot = feet[to_size(i)];
            const double distance = std::sqrt(foot.squared_distance);
            if (borders && borders->hold(foot)) continue;
            distances.push_back(distance);
            if (distance < limit) continue;
            Eigen::Index corner = 0;
            foot.weights.maxCoeff(&corner);
            faults_of(MeshFlaw::kUncovered)
                .push_back({samples.row(i).transpose(), mesh_.triangles(foot.triangle, corner),
                            1.0 / count, distance, distance / limit / kCounted / count});
        }
        figures.uncovered = quantile(distances, 1.0 - kCounted);
    }

    void find_off(Progress& progress) {
        const auto count = to_index(x_.rows());
        std::vector<double> distances(to_size(count), -1.0);
        parallel_for(
            count, progress,
            [&](Index begin, Index end) {
                for (Index v = begin; v < end; ++v)
                    if (mesh_.parts[to_size(v)] >= 0)
                        distances[to_size(v)] = target_.foot(x_.row(v).transpose()).distance;
            },
            0.6, 1.0, 128);
        const auto counted =
            std::ranges::count_if(distances, [](double distance) { return distance >= 0.0; });
        const double share = 1.0 / static_cast<double>(counted);
        constexpr double kFar = 5e-3;
        for (Index v = 0; v < count; ++v) {
            const double distance = distances[to_size(v)];
            if (distance < 0.0) continue;
            figures.off += distance * share;
            if (distance > kFar)
                faults_of(MeshFlaw::kOff)
                    .push_back({x_.row(v).transpose(), v, share, distance,
                                distance * share / kGood[to_size(MeshFlaw::kOff)]});
        }
    }

    const Mesh& mesh_;
    const Surface& target_;
    Positions x_;
    Normals normals_;
    Bends bends_, rest_;
};

constexpr double kRadius = 0.1, kApart = 0.2;  // of places, in √area

/// Faults that lie together, as one at the worst of them.
std::vector<Fault> gathered(std::vector<Fault> faults) {
    std::ranges::stable_sort(faults, std::ranges::greater{}, &Fault::badness);
    Positions places(static_cast<Eigen::Index>(faults.size()), 3);
    for (std::size_t i = 0; i < faults.size(); ++i)
        places.row(static_cast<Eigen::Index>(i)) = faults[i].place.transpose();
    const KdTree<3> tree(places);
    std::vector<char> taken(faults.size(), 0);
    std::vector<std::pair<Index, double>> around;
    std::vector<Fault> result;
    for (std::size_t i = 0; i < faults.size(); ++i) {
        if (taken[i]) continue;
        Fault whole = faults[i];
        whole.share = whole.badness = 0.0;
        tree.within(faults[i].place.data(), kRadius, around);
        for (const auto& [j, squared] : around) {
            if (std::exchange(taken[to_size(j)], 1)) continue;
            whole.share += faults[to_size(j)].share;
            whole.badness += faults[to_size(j)].badness;
            whole.distance = std::max(whole.distance, faults[to_size(j)].distance);
        }
        result.push_back(whole);
    }
    return result;
}

// --- Words

std::string in_words(MeshFlaw flaw, double value, const std::string& source,
                     const std::string& target) {
    const std::string much = percent(value);
    switch (flaw) {
        case MeshFlaw::kFolded:
            return much + " of the area of " + source + " is folded over";
        case MeshFlaw::kCreased:
            return much + " of the edges are creased";
        case MeshFlaw::kUncovered:
            return "details of " + target + " are missed by " + much + " of its size";
        case MeshFlaw::kOff:
            return "the vertices lie off " + target + " by " + much + " of its size";
    }
    return {};
}

/// The share of the target's area that no face comes near to.
double bare_share(std::span<const Fault> uncovered) {
    constexpr double kNear = 0.05;  // √area
    double share = 0.0;
    for (const Fault& fault : uncovered)
        if (fault.distance > kNear) share += fault.share;
    return share;
}

std::string verdict_on(const MeshFigures& figures, double bare, const std::string& source,
                       const std::string& target) {
    constexpr double kMuch = 0.02;
    const MeshGrade grade = grade_of(figures);
    if (grade == MeshGrade::kGood)
        return "Good: the faces of " + source + " lie smoothly on " + target + ".";
    std::string text = name_of(grade) + ": ";
    bool first = true;
    for (std::size_t k = 0; k < kFigures; ++k) {
        const double value = in_order(figures)[k];
        if (value <= kGood[k]) continue;
        text += std::exchange(first, false) ? "" : "; ";
        text += k == to_size(MeshFlaw::kUncovered) && bare > kMuch
                    ? percent(bare) + " of " + target + " stays bare"
                    : in_words(static_cast<MeshFlaw>(k), value, source, target);
    }
    return sentence(text);
}

std::string advice_on(MeshFlaw flaw, const Fault& fault, const PlaceWords& words,
                      const std::string& source, const std::string& target) {
    const std::string share = percent(fault.share);
    const auto what = [&]() -> std::string {
        switch (flaw) {
            case MeshFlaw::kFolded:
                return "faces fold over one another (" + share + " of the area): " + words.remedy;
            case MeshFlaw::kCreased:
                return "faces are creased (" + share + " of the edges): " + words.remedy;
            case MeshFlaw::kUncovered:
                return "the faces don't reach " + target + " (" + share + " of it is up to " +
                       percent(fault.distance) + " of its size away): give " + source +
                       " more vertices there, or " + words.remedy;
            case MeshFlaw::kOff:
                return "vertices lie off " + target + " (by up to " + percent(fault.distance) +
                       " of its size): " + words.remedy;
        }
        return {};
    };
    return sentence(words.where + " " + what());
}

/// The first vertex at each place.
std::vector<Index> first_vertices(const Mesh& mesh) {
    std::vector<Index> result(to_size(mesh.positions.rows()), 0);
    for (std::size_t v = mesh.places.size(); v-- > 0;)
        result[to_size(mesh.places[v])] = to_index(v);
    return result;
}

std::vector<MeshPlace> worst_places(const Measured& measured, const WrappedMesh& wrapped,
                                    const Surface& surface, const std::string& target,
                                    std::span<const Feature> features) {
    constexpr double kShows = 0.25;  // of the limit
    constexpr std::size_t kMost = 5;
    std::vector<std::pair<Fault, MeshFlaw>> all;
    for (std::size_t k = 0; k < kFigures; ++k)
        for (const Fault& fault : gathered(measured.faults[k]))
            if (fault.badness > kShows) all.emplace_back(fault, static_cast<MeshFlaw>(k));
    std::ranges::stable_sort(all, std::ranges::greater{},
                             [](const auto& entry) { return entry.first.badness; });
    const Mesh& mesh = wrapped.mesh;
    const std::vector<Index> vertices = first_vertices(mesh);
    const std::vector<MarkedPoint> marked = marked_points(features);
    const Positions rest = gather(mesh.positions, mesh.places);
    const DescribedShape source{rest, std::sqrt(mesh.area()), wrapped.cloud.name};
    std::vector<MeshPlace> worst;
    std::vector<Vector3> taken;
    for (const auto& [fault, flaw] : all) {
        if (worst.size() == kMost) break;
        if (std::ranges::any_of(
                taken, [&](const Vector3& place) { return (place - fault.place).norm() < kApart; }))
            continue;
        taken.push_back(fault.place);
        const Index vertex = vertices[to_size(fault.vertex)];
        const Positions at = surface.unit().restore(fault.place.transpose());
        const PlaceWords words = words_for(source, vertex, marked);
        worst.push_back({flaw, vertex, surface.nearest_row(fault.place), at.row(0).transpose(),
                         fault.share, fault.distance, words.where,
                         advice_on(flaw, fault, words, wrapped.cloud.name, target)});
    }
    return worst;
}

}  // namespace

std::string name_of(MeshFlaw flaw) {
    constexpr std::array names{"folded", "creased", "uncovered", "off"};
    return names[to_size(flaw)];
}

std::string name_of(MeshGrade grade) {
    constexpr std::array names{"good", "fair", "poor"};
    return names[to_size(grade)];
}

MeshGrade grade_of(const MeshFigures& figures) {
    MeshGrade grade = MeshGrade::kGood;
    for (std::size_t k = 0; k < kFigures; ++k) {
        const double value = in_order(figures)[k];
        if (value > kFair[k]) return MeshGrade::kPoor;
        if (value > kGood[k]) grade = MeshGrade::kFair;
    }
    return grade;
}

MeshQuality measure_mesh_quality(const WrappedMesh& wrapped, const WrappedSurface& target,
                                 std::span<const Feature> features, Progress& progress) {
    const Surface surface = [&] {
        const Progress::Part part(progress, 0.0, 0.2);
        return Surface(target, progress);
    }();
    const Progress::Part part(progress, 0.2, 1.0);
    const Measured measured(wrapped, surface, progress);
    MeshQuality quality;
    quality.figures = measured.figures;
    quality.grade = grade_of(quality.figures);
    quality.verdict =
        verdict_on(quality.figures, bare_share(measured.faults[to_size(MeshFlaw::kUncovered)]),
                   wrapped.cloud.name, target.cloud.name);
    quality.worst = worst_places(measured, wrapped, surface, target.cloud.name, features);
    return quality;
}

}  // namespace pointmorph

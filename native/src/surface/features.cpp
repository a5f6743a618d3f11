#include "pointmorph/surface/features.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/surface/projection.hpp"

namespace pointmorph {

namespace {

// --- Checks

std::string subject_of(const Feature& feature) {
    return "feature \"" + feature.name + "\"";
}

void check_side(const Feature& feature, const Marked& marked, const Cloud& cloud) {
    const std::string subject = subject_of(feature);
    const auto count = std::to_string(marked.rows.size());
    if (feature.kind == FeatureKind::kPoint && marked.rows.size() != 1)
        throw FeatureError(subject, "one point of " + cloud.name, count,
                           "Mark a single point, or make it a curve or a region on both.");
    const std::size_t fewest = feature.closed ? 3 : 2;
    if (feature.kind == FeatureKind::kCurve && marked.rows.size() < fewest)
        throw FeatureError(subject,
                           std::to_string(fewest) + " or more points along the " +
                               (feature.closed ? "closed curve on " : "curve on ") + cloud.name,
                           count, "Mark more of the curve, or make it a point on both.");
    if (feature.kind == FeatureKind::kRegion && marked.rows.empty())
        throw FeatureError(subject, "one or more points of " + cloud.name, "none",
                           "Mark the region on " + cloud.name + ", or remove the feature.");

    std::vector<Index> sorted = marked.rows;
    std::ranges::sort(sorted);
    for (const Index row : {sorted.front(), sorted.back()})
        if (row < 0 || row >= cloud.size())
            throw FeatureError(
                subject, "a point of " + cloud.name + ", 0 to " + std::to_string(cloud.size() - 1),
                "point " + std::to_string(row), "Mark it again on " + cloud.name + ".");
    const auto twice = std::ranges::adjacent_find(sorted);
    if (twice != sorted.end())
        throw FeatureError(subject, "each point of " + cloud.name + " once",
                           "point " + std::to_string(*twice) + " twice",
                           feature.kind == FeatureKind::kCurve
                               ? "To close a curve, mark it as closed instead of repeating its "
                                 "first point. Split one that crosses itself."
                               : "List each point once.");

    if (!marked.weights.empty() && feature.kind != FeatureKind::kRegion)
        throw FeatureError(subject, "weights of points in a region",
                           "weights in a " + name_of(feature.kind),
                           "Leave them out, or make it a region.");
    if (!marked.weights.empty() && marked.weights.size() != marked.rows.size())
        throw FeatureError(subject, "a weight for each of " + count + " points",
                           std::to_string(marked.weights.size()), "Give one per point, or none.");
    for (const double weight : marked.weights)
        if (!(weight >= 0.0 && weight <= 1.0))
            throw FeatureError(subject, "weights of points from 0 to 1", in_short(weight),
                               "Correct it on " + cloud.name + ".");
    if (!marked.weights.empty() && !(std::ranges::max(marked.weights) > 0.0))
        throw FeatureError(subject, "a point of " + cloud.name + " with a weight above 0", "none",
                           "Mark the region on " + cloud.name + ", or remove the feature.");
    if (feature.kind == FeatureKind::kCurve) {
        const Eigen::RowVector3d first = cloud.positions.row(marked.rows.front());
        if (std::ranges::all_of(marked.rows,
                                [&](Index row) { return cloud.positions.row(row) == first; }))
            throw FeatureError(subject, "a curve of some length on " + cloud.name,
                               "points at one place", "Mark points that lie apart.");
    }
}

void check_points_apart(std::span<const Feature> features, Marked Feature::*side,
                        const Cloud& cloud) {
    std::unordered_map<Index, std::string> taken;
    for (const Feature& feature : features) {
        if (feature.kind != FeatureKind::kPoint) continue;
        const Index row = (feature.*side).rows.front();
        const auto [other, is_new] = taken.emplace(row, feature.name);
        if (!is_new)
            throw FeatureError(
                subject_of(feature), "a point of its own on " + cloud.name,
                "point " + std::to_string(row) + ", which is already \"" + other->second + "\"",
                "Move or remove one of the two.");
    }
}

/// The pairs that one feature pins.
std::vector<IndexPair> pinned_by(const Feature& feature) {
    if (!feature.hard || feature.kind == FeatureKind::kRegion) return {};
    std::vector<IndexPair> pairs{{feature.source.rows.front(), feature.target.rows.front()}};
    if (feature.kind == FeatureKind::kCurve && !feature.closed)
        pairs.push_back({feature.source.rows.back(), feature.target.rows.back()});
    return pairs;
}

void check_pins(std::span<const Feature> features, const Cloud& source, const Cloud& target) {
    std::map<Index, std::pair<Index, std::string>> forward, backward;
    const auto check = [](auto& known, const Feature& feature, Index from, Index to,
                          const Cloud& here, const Cloud& there) {
        const auto [entry, is_new] = known.emplace(from, std::pair{to, feature.name});
        const auto& [partner, other] = entry->second;
        if (is_new || partner == to) return;
        throw FeatureError(
            subject_of(feature),
            "point " + std::to_string(from) + " of " + here.name + " on one point of " + there.name,
            "point " + std::to_string(to) + ", and point " + std::to_string(partner) + " by \"" +
                other + "\"",
            "Move the end of one of the two, or make one of them soft.");
    };
    for (const Feature& feature : features)
        for (const IndexPair& pair : pinned_by(feature)) {
            check(forward, feature, pair.source, pair.target, source, target);
            check(backward, feature, pair.target, pair.source, target, source);
        }
}

// --- Order

Marked ranked(const Marked& marked, FeatureKind kind, std::span<const Index> rank) {
    Marked result;
    for (const Index row : marked.rows) result.rows.push_back(rank[to_size(row)]);
    if (kind != FeatureKind::kRegion) return result;
    std::vector<std::pair<Index, double>> members;
    for (std::size_t i = 0; i < marked.rows.size(); ++i)
        if (marked.weight(i) > 0.0) members.emplace_back(result.rows[i], marked.weight(i));
    std::ranges::sort(members);
    result.rows.clear();
    for (const auto& [row, weight] : members) {
        result.rows.push_back(row);
        result.weights.push_back(weight);
    }
    return result;
}

/// Reverses a curve; a closed one keeps its first point.
void reverse(Marked& marked, bool closed) {
    std::reverse(marked.rows.begin() + (closed ? 1 : 0), marked.rows.end());
}

// --- Curves

constexpr double kStraight = 3.0;   // spacings up to which marked points are joined directly
constexpr std::size_t kSteps = 12;  // neighbors that a path can continue to

void ask(Progress& progress) {
    if (!progress.poll()) progress.throw_if_cancelled();
}

/// Shortest paths from sample to sample of a surface. Looks neighbors up as it goes, since a curve
/// needs few of them. Keeps its scratch memory: one object per thread.
class PathSearch {
public:
    PathSearch(const KdTree<3>& surface, const Normals& normals)
        : surface_(surface),
          normals_(normals),
          distance_(to_size(surface.size()), kFar),
          before_(to_size(surface.size()), -1) {}

    /// Rows from `start` to `end`, both included (A*, Hart et al. 1968); only these two where there
    /// is no path.
    std::vector<Index> between(Index start, Index end, Progress& progress) {
        const auto& p = surface_.points();
        const auto ahead = [&](Index i) { return (p.row(i) - p.row(end)).norm(); };
        std::vector<std::tuple<double, double, Index>> open{{ahead(start), 0.0, start}};
        std::vector<Index> touched{start};
        distance_[to_size(start)] = 0.0;
        std::array<Index, kSteps + 1> near;
        std::array<double, kSteps + 1> squared;
        bool found = false;
        std::size_t visited = 0;
        constexpr auto later = std::greater<std::tuple<double, double, Index>>();
        while (!open.empty() && !found) {
            std::ranges::pop_heap(open, later);
            const auto [estimate, distance, i] = open.back();
            open.pop_back();
            if (distance > distance_[to_size(i)]) continue;
            found = i == end;
            if (++visited % 1024 == 0) ask(progress);
            const auto count = surface_.nearest(p.row(i).data(), near, squared);
            for (std::size_t k = 0; k < to_size(count); ++k) {
                const Index j = near[k];
                if (normals_.row(i).dot(normals_.row(j)) <= kSameSheet && j != end) continue;
                const double through = distance + std::sqrt(squared[k]);
                if (through >= distance_[to_size(j)]) continue;
                if (distance_[to_size(j)] == kFar) touched.push_back(j);
                distance_[to_size(j)] = through;
                before_[to_size(j)] = i;
                open.emplace_back(through + ahead(j), through, j);
                std::ranges::push_heap(open, later);
            }
        }
        std::vector<Index> path{end};
        if (found)
            while (path.back() != start) path.push_back(before_[to_size(path.back())]);
        else
            path.push_back(start);
        std::ranges::reverse(path);
        for (const Index i : touched) distance_[to_size(i)] = kFar;
        return path;
    }

private:
    static constexpr double kFar = std::numeric_limits<double>::infinity();
    static constexpr double kSameSheet = -0.1;
    const KdTree<3>& surface_;
    const Normals& normals_;
    std::vector<double> distance_;
    std::vector<Index> before_;
};

/// Pulls a path straight along the surface; its ends stay.
Positions pulled_straight(const std::vector<Index>& path, const KdTree<3>& surface,
                          const Normals& normals, Progress& progress) {
    constexpr int kRounds = 12;
    const auto count = static_cast<Eigen::Index>(path.size());
    Positions places(count, 3);
    for (Eigen::Index k = 0; k < count; ++k) places.row(k) = surface.points().row(path[to_size(k)]);
    std::vector<Index> anchors = path;
    // Averaging smooths over a length that grows with the root of its repetitions: enough of them
    // for detours of any length.
    const auto repetitions = std::clamp<Eigen::Index>(count * count / 24, 4, 60);
    for (int round = 0; round < kRounds; ++round) {
        for (Eigen::Index repetition = 0; repetition < repetitions; ++repetition) {
            Eigen::RowVector3d previous = places.row(0);
            for (Eigen::Index k = 1; k + 1 < count; ++k) {
                const Eigen::RowVector3d here = places.row(k);
                places.row(k) = 0.5 * here + 0.25 * (previous + places.row(k + 1));
                previous = here;
            }
        }
        for (Eigen::Index k = 1; k + 1 < count; ++k) {
            Index& anchor = anchors[to_size(k)];
            anchor = nearest_on_sheet(surface, normals, places.row(k), normals.row(anchor));
        }
        ask(progress);
        Progress silent;
        Positions on_surface = project_onto_surface(places, anchors, surface, normals, silent);
        on_surface.row(0) = places.row(0);
        on_surface.row(count - 1) = places.row(count - 1);
        places = std::move(on_surface);
    }
    return places;
}

/// Spacing of the samples around a row.
double spacing_at(const KdTree<3>& surface, Index row) {
    constexpr std::size_t kNeighbors = 6;
    std::array<Index, kNeighbors + 1> near;
    std::array<double, kNeighbors + 1> squared;
    const auto found = surface.nearest(surface.points().row(row).data(), near, squared);
    return std::sqrt(std::numbers::pi * squared[to_size(found - 1)] /
                     std::max<double>(1, found - 1));
}

// --- Residuals

Index nearest_row(const KdTree<3>& tree, const Eigen::RowVector3d& place) {
    Index row;
    double squared;
    tree.nearest(place.data(), {&row, 1}, {&squared, 1});
    return row;
}

/// How well one shape's points of a feature meet the other's.
struct Kept {
    double residual = 0.0, inside = 1.0;
};

Kept point_kept(const Marked& from, const Marked& to, const MappedSurface& here,
                const MappedSurface& there) {
    const Index partner = to.rows.front();
    const double distance =
        (here.images.row(from.rows.front()) - there.tree.points().row(partner)).norm();
    const double spacing = spacing_at(there.tree, partner);
    return {distance > 0.0 ? distance / std::max(spacing, 1e-300) : 0.0};
}

Kept curve_kept(const Marked& from, const Marked& to, bool closed, const MappedSurface& here,
                const MappedSurface& there, Progress& progress) {
    const TracedCurve own = trace_curve(here.tree, here.normals, from.rows, closed, progress);
    const TracedCurve other = trace_curve(there.tree, there.normals, to.rows, closed, progress);
    double sum = 0.0;
    for (std::size_t i = 0; i < from.rows.size(); ++i) {
        const Vector3 place = other.at(own.share(i));
        const double distance = (here.images.row(from.rows[i]).transpose() - place).norm();
        const double spacing = spacing_at(there.tree, nearest_row(there.tree, place.transpose()));
        sum += std::pow(distance / std::max(spacing, 1e-300), 2);
    }
    return {std::sqrt(sum / static_cast<double>(from.rows.size()))};
}

Kept region_kept(const Marked& from, const Marked& to, const MappedSurface& here,
                 const MappedSurface& there) {
    constexpr double kMember = 0.5;
    std::unordered_map<Index, double> weight_of;
    std::vector<Index> members;
    const double largest = to.weights.empty() ? 1.0 : *std::ranges::max_element(to.weights);
    for (std::size_t i = 0; i < to.rows.size(); ++i) {
        weight_of.emplace(to.rows[i], to.weight(i));
        if (to.weight(i) >= kMember * largest) members.push_back(to.rows[i]);
    }
    const Positions of_members = gather(there.tree.points(), members);
    const KdTree<3> tree(of_members);
    double all = 0.0, inside = 0.0, outside = 0.0;
    for (std::size_t i = 0; i < from.rows.size(); ++i) {
        const Eigen::RowVector3d image = here.images.row(from.rows[i]);
        const Index nearest = nearest_row(there.tree, image);
        const auto known = weight_of.find(nearest);
        const double carried = known == weight_of.end() ? 0.0 : known->second;
        all += from.weight(i);
        inside += std::min(from.weight(i), carried);
        if (carried >= kMember * largest) continue;
        Index member;
        double squared;
        tree.nearest(image.data(), {&member, 1}, {&squared, 1});
        outside +=
            from.weight(i) * std::sqrt(squared) / std::max(spacing_at(there.tree, nearest), 1e-300);
    }
    return {outside / all, inside / all};
}

}  // namespace

Feature point_feature(std::string name, Index source, Index target) {
    return {std::move(name), FeatureKind::kPoint, {{source}, {}}, {{target}, {}}};
}

std::string name_of(FeatureKind kind) {
    constexpr std::array names{"point", "curve", "region"};
    return names[to_size(kind)];
}

void validate(std::span<const Feature> features, const Cloud& source, const Cloud& target) {
    std::vector<std::string> names;
    Index regions = 0;
    for (const Feature& feature : features) {
        if (std::ranges::find(names, feature.name) != names.end())
            throw FeatureError(subject_of(feature), "a name of its own", "two of that name",
                               "Rename one of the two.");
        names.push_back(feature.name);
        if (!(feature.weight > 0.0 && std::isfinite(feature.weight)))
            throw FeatureError(subject_of(feature), "a weight above 0", in_short(feature.weight),
                               "Give it a weight, 1 for instance, or remove the feature.");
        if (feature.closed && feature.kind != FeatureKind::kCurve)
            throw FeatureError(subject_of(feature), "a curve, to be closed",
                               "a " + name_of(feature.kind), "Only curves can be closed.");
        check_side(feature, feature.source, source);
        check_side(feature, feature.target, target);
        if (feature.kind == FeatureKind::kRegion && ++regions > kMostRegions)
            throw FeatureError(subject_of(feature),
                               "at most " + std::to_string(kMostRegions) + " regions", "one more",
                               "Merge regions, or mark some places by points.");
    }
    check_points_apart(features, &Feature::source, source);
    check_points_apart(features, &Feature::target, target);
    check_pins(features, source, target);
}

std::vector<Feature> canonical(std::span<const Feature> features,
                               std::span<const Index> source_rank,
                               std::span<const Index> target_rank) {
    std::vector<Feature> result;
    for (const Feature& feature : features) {
        Feature& f = result.emplace_back(feature);
        f.source = ranked(feature.source, f.kind, source_rank);
        f.target = ranked(feature.target, f.kind, target_rank);
        if (f.kind != FeatureKind::kCurve) continue;
        Feature reversed = f;
        reverse(reversed.source, f.closed);
        reverse(reversed.target, f.closed);
        if (std::tie(reversed.source.rows, reversed.target.rows) <
            std::tie(f.source.rows, f.target.rows))
            f = std::move(reversed);
    }
    std::ranges::stable_sort(result, [](const Feature& a, const Feature& b) {
        const auto key = [](const Feature& f) {
            return std::tie(f.kind, f.source.rows, f.target.rows, f.source.weights,
                            f.target.weights, f.closed, f.hard, f.weight);
        };
        return key(a) < key(b);
    });
    return result;
}

std::vector<IndexPair> pinned_pairs(std::span<const Feature> features) {
    std::vector<IndexPair> pairs;
    for (const Feature& feature : features)
        for (const IndexPair& pair : pinned_by(feature))
            if (std::ranges::find(pairs, pair) == pairs.end()) pairs.push_back(pair);
    return pairs;
}

Index TracedCurve::before(double share) const {
    const auto next = std::ranges::upper_bound(lengths, share * length());
    const auto last = to_index(places.rows()) - 1;
    return std::clamp<Index>(to_index(next - lengths.begin()) - 1, 0, last);
}

Vector3 TracedCurve::at(double share) const {
    const Index k = before(share);
    const auto next = to_size(k) + 1;
    if (next >= lengths.size()) return places.row(k).transpose();
    const double start = lengths[next - 1], step = lengths[next] - start;
    const double part = std::clamp((share * length() - start) / step, 0.0, 1.0);
    return ((1.0 - part) * places.row(k) +
            part * places.row(static_cast<Eigen::Index>(next) % places.rows()))
        .transpose();
}

TracedCurve trace_curve(const KdTree<3>& surface, const Normals& normals,
                        std::span<const Index> rows, bool closed, Progress& progress) {
    const Positions& p = surface.points();
    PathSearch search(surface, normals);
    TracedCurve curve;
    curve.closed = closed;
    std::vector<Eigen::RowVector3d> places, turned;
    const auto add = [&](const Eigen::RowVector3d& place, const Eigen::RowVector3d& normal) {
        if (!places.empty() && places.back() == place) return;
        if (!places.empty())
            curve.lengths.push_back(curve.lengths.back() + (place - places.back()).norm());
        else
            curve.lengths.push_back(0.0);
        places.push_back(place);
        turned.push_back(normal);
    };
    const auto join = [&](Index from, Index to) {
        const double apart = (p.row(from) - p.row(to)).norm();
        const double spacing = std::max(spacing_at(surface, from), spacing_at(surface, to));
        if (apart <= kStraight * spacing) return;
        ask(progress);
        const auto path = search.between(from, to, progress);
        if (path.size() < 3) return;
        const Positions straight = pulled_straight(path, surface, normals, progress);
        for (Eigen::Index k = 1; k + 1 < straight.rows(); ++k)
            add(straight.row(k), normals.row(path[to_size(k)]));
    };
    for (std::size_t i = 0; i < rows.size(); ++i) {
        if (i > 0) join(rows[i - 1], rows[i]);
        add(p.row(rows[i]), normals.row(rows[i]));
        curve.marks.push_back(to_index(places.size()) - 1);
    }
    if (closed) {
        join(rows.back(), rows.front());
        if (places.size() > 1 && places.back() == places.front()) {
            places.pop_back();
            turned.pop_back();
            curve.lengths.pop_back();
            for (Index& mark : curve.marks)
                if (mark == to_index(places.size())) mark = 0;
        }
        curve.lengths.push_back(curve.lengths.back() + (places.front() - places.back()).norm());
    }
    curve.places.resize(static_cast<Eigen::Index>(places.size()), 3);
    curve.normals.resize(curve.places.rows(), 3);
    for (std::size_t k = 0; k < places.size(); ++k) {
        curve.places.row(static_cast<Eigen::Index>(k)) = places[k];
        curve.normals.row(static_cast<Eigen::Index>(k)) = turned[k];
    }
    return curve;
}

std::vector<FeatureResidual> feature_residuals(std::span<const Feature> features,
                                               const MappedSurface& source,
                                               const MappedSurface& target, Progress& progress) {
    std::vector<FeatureResidual> residuals;
    for (const Feature& f : features) {
        const auto kept = [&](const Marked& from, const Marked& to, const MappedSurface& here,
                              const MappedSurface& there) {
            if (f.kind == FeatureKind::kPoint) return point_kept(from, to, here, there);
            if (f.kind == FeatureKind::kRegion) return region_kept(from, to, here, there);
            return curve_kept(from, to, f.closed, here, there, progress);
        };
        const Kept forth = kept(f.source, f.target, source, target);
        const Kept back = kept(f.target, f.source, target, source);
        residuals.push_back({f.name, f.kind, f.hard, f.weight,
                             std::max(forth.residual, back.residual),
                             std::min(forth.inside, back.inside)});
    }
    return residuals;
}

}  // namespace pointmorph

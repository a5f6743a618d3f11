#include "registration/part_search.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "registration/rim.hpp"

namespace pointmorph {

namespace {

// Lengths are in √area of the part, but for those of the whole.
constexpr double kNormalWeight = 0.2;
constexpr double kMostApart = 0.3;  // how far off a point counts at most
constexpr int kScales = 9;          // the part is tried so large …
constexpr double kFirstScale = 0.85, kStep = 1.25;
constexpr int kRadii = 12;  // of the balls by which places are compared
constexpr double kFirstRadius = 0.1;
constexpr std::size_t kFew = 36;  // points that tell whether a pose is worth a closer look

double scale_of(int k) {
    return kFirstScale * std::pow(kStep, -k);
}

using Keys = KdTree<6>::Points;

Keys keys(const Positions& positions, const Normals& normals) {
    Keys result(positions.rows(), 6);
    result << positions, kNormalWeight * normals;
    return result;
}

/// A point of a shape.
struct PlacedPoint {
    Vector3 at, normal;
};

PlacedPoint point(const CoarseShape& shape, Index row) {
    return {shape.positions.row(row).transpose(), shape.normals.row(row).transpose()};
}

/// What a surface looks like around a point: of balls that grow by kStep, three numbers each that
/// neither turning nor scaling changes with them.
struct Profile {
    std::array<Vector3, kRadii + kScales> forms;
    int first = 0, last = 0;  ///< of which forms are known: [first, last)
};

/// The balls of profiles: so many, the first so large; smaller ones than `least` say nothing.
struct Balls {
    double radius;
    int count;
    double least;
};

/// The profiles of a shape's points.
class Profiles {
public:
    Profiles(const CoarseShape& shape, const Balls& balls)
        : shape_(shape), balls_(balls), tree_(shape.positions) {
        for (int k = 0; k < balls.count; ++k) radii_.push_back(balls.radius * std::pow(kStep, k));
    }

    /// Of some rows, with the balls that don't reach `most`, of each.
    std::vector<Profile> of(std::span<const Index> rows, const std::vector<double>& most,
                            Progress& progress) const {
        std::vector<Profile> result(rows.size());
        parallel_for(
            to_index(rows.size()), progress,
            [&](Index begin, Index end) {
                Near near;
                for (Index i = begin; i < end; ++i)
                    result[to_size(i)] = at(rows[to_size(i)], most[to_size(i)], near);
            },
            0.0, 1.0, 16);
        return result;
    }

private:
    using Near = std::vector<std::pair<Index, double>>;

    Profile at(Index row, double most, Near& near) const;

    const CoarseShape& shape_;
    const Balls balls_;
    std::vector<double> radii_;
    KdTree<3> tree_;
};

Profile Profiles::at(Index row, double most, Near& near) const {
    Profile profile;
    const int count = balls_.count;
    while (profile.first < count && radii_[to_size(profile.first)] < balls_.least) ++profile.first;
    profile.last = profile.first;
    while (profile.last < count && radii_[to_size(profile.last)] <= most) ++profile.last;
    if (profile.last == profile.first) return profile;
    const auto [at, normal] = point(shape_, row);
    std::array<double, kRadii + kScales> area{}, behind{}, cosine{};
    tree_.within_unsorted(at.data(), radii_[to_size(profile.last - 1)], near);
    for (const auto& [other, squared] : near) {
        const auto from = std::ranges::lower_bound(radii_, std::sqrt(squared)) - radii_.begin();
        const auto k = static_cast<std::size_t>(from);
        const auto [there, its_normal] = point(shape_, other);
        area[k] += shape_.areas[other];
        behind[k] += shape_.areas[other] * (at - there).dot(normal);
        cosine[k] += shape_.areas[other] * normal.dot(its_normal);
    }
    for (int k = 1; k < profile.last; ++k) {
        area[to_size(k)] += area[to_size(k - 1)];
        behind[to_size(k)] += behind[to_size(k - 1)];
        cosine[to_size(k)] += cosine[to_size(k - 1)];
    }
    for (int k = profile.first; k < profile.last; ++k) {
        const double a = std::max(area[to_size(k)], 1e-12), r = radii_[to_size(k)];
        profile.forms[to_size(k)] = {std::log(a / (r * r)), 3.0 * behind[to_size(k)] / (a * r),
                                     1.5 * cosine[to_size(k)] / a};
    }
    return profile;
}

/// How unlike a place of the part and one of the whole are if the part is as large as the scale
/// says; infinite where too little is known.
double unlike(const Profile& part, const Profile& whole, int scale) {
    constexpr int kFewest = 2;  // a head on a whole body has no more between spacing and rim
    // Ball k of the part is ball k + kScales − 1 − scale of the whole.
    const int shift = kScales - 1 - scale;
    const int first = std::max(part.first, whole.first - shift),
              last = std::min(part.last, whole.last - shift);
    if (last - first < kFewest) return std::numeric_limits<double>::infinity();
    double sum = 0.0;
    for (int k = first; k < last; ++k)
        sum += (part.forms[to_size(k)] - whole.forms[to_size(k + shift)]).cwiseAbs().sum();
    return sum / (last - first);
}

/// Something of the part on the whole, the first pose to be tried from.
struct Seed {
    Similarity pose;
    int scale = 0;
    double misfit = 0.0;
};

/// A rotation that takes one direction to another one, and turns about that.
Matrix3 onto_normal(const Vector3& from, const Vector3& to, double angle) {
    const auto frame = [](const Vector3& normal) {
        const Vector3 along = normal.unitOrthogonal();
        Matrix3 axes;
        axes << normal, along, normal.cross(along);
        return axes;
    };
    return Eigen::AngleAxisd(angle, to).toRotationMatrix() * frame(to) * frame(from).transpose();
}

/// The part so laid that a point of it lies on one of the whole, and turned about that.
Seed turned(const PlacedPoint& of_part, const PlacedPoint& there, int scale, double angle) {
    Seed seed{{}, scale, 0.0};
    seed.pose.scale = scale_of(scale);
    seed.pose.rotation = onto_normal(of_part.normal, there.normal, angle);
    seed.pose.translation = there.at - seed.pose.scale * (seed.pose.rotation * of_part.at);
    return seed;
}

class PartSearch {
public:
    PartSearch(const CoarseShape& part, const CoarseShape& whole) : part_(part), whole_(whole) {
        const std::vector<Index>& nodes = part.levels.front().node_rows;
        const Positions rim = gather(part.positions, end_rows(part));
        const std::vector<Index> next = nearest_rows(KdTree<3>(rim), part.positions);
        from_rim_ = (part.positions - gather(rim, next)).rowwise().norm();
        constexpr double kNextTo = 0.06;
        for (const Index row : nodes)
            if (from_rim_[row] > kNextTo) rows_.push_back(row);
        for (int k = 0; k < kScales; ++k) {
            const double scale = scale_of(k);
            keys_.push_back(keys(whole.positions / scale, whole.normals));
        }
        for (const Keys& its : keys_) trees_.emplace_back(its);
    }

    bool is_possible() const { return rows_.size() > 20; }

    /// How far the points in `rows` lie from the whole.
    double misfit(const Seed& seed, std::span<const Index> rows) const {
        double sum = 0.0;
        for_nearest(seed, rows, [&](std::size_t, Index, double squared) {
            sum += std::min(std::sqrt(squared), kMostApart);
        });
        return sum / static_cast<double>(rows.size());
    }

    /// The pose brought home: in rounds by the nearest points but those far off.
    Seed settled(Seed seed, std::span<const Index> rows, int rounds) const {
        const double least = seed.pose.scale / kStep, most = seed.pose.scale * kStep;
        for (int round = 0; round < rounds; ++round) {
            std::vector<Index> to(rows.size());
            std::vector<double> apart(rows.size());
            for_nearest(seed, rows, [&](std::size_t i, Index nearest, double squared) {
                to[i] = nearest;
                apart[i] = squared;
            });
            std::vector<double> sorted = apart;
            const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
            std::ranges::nth_element(sorted, middle);
            std::vector<Index> from, onto;
            for (std::size_t i = 0; i < rows.size(); ++i)
                if (apart[i] <= 4.0 * *middle) {
                    from.push_back(rows[i]);
                    onto.push_back(to[i]);
                }
            const Positions a = gather(part_.positions, from), b = gather(whole_.positions, onto);
            const auto spread = [](const Positions& p) {
                return (p.rowwise() - p.colwise().mean()).norm();
            };
            // What is matched one way makes the fit of least squares too small.
            const double size = spread(a);
            Similarity& pose = seed.pose;
            if (size > 0.0) pose.scale = std::clamp(spread(b) / size, least, most);
            pose.rotation = fit_similarity(a, b).rotation;
            pose.translation = b.colwise().mean().transpose() -
                               pose.scale * (pose.rotation * a.colwise().mean().transpose());
        }
        seed.misfit = misfit(seed, rows);
        return seed;
    }

    /// Where places of the part look like places of the whole.
    std::vector<Seed> seeds(bool smaller_only, Progress& progress) const;
    /// With the first of the marks on its partner.
    std::vector<Seed> seeds_at(const PartMarks& marks, Progress& progress) const;
    const std::vector<Index>& rows() const { return rows_; }
    /// Every so many of the rows that there are about `count`.
    std::vector<Index> some(std::size_t count) const {
        std::vector<Index> result;
        const std::size_t step = std::max<std::size_t>(1, rows_.size() / count);
        for (std::size_t i = 0; i < rows_.size(); i += step) result.push_back(rows_[i]);
        return result;
    }

private:
    template <class Use>
    void for_nearest(const Seed& seed, std::span<const Index> rows, Use&& use) const {
        const double inverse = 1.0 / scale_of(seed.scale);
        const KdTree<6>& tree = trees_[to_size(seed.scale)];
        for (std::size_t i = 0; i < rows.size(); ++i) {
            Eigen::Matrix<double, 6, 1> key;
            key << inverse * (seed.pose.scale *
                                  (seed.pose.rotation * part_.positions.row(rows[i]).transpose()) +
                              seed.pose.translation),
                kNormalWeight * (seed.pose.rotation * part_.normals.row(rows[i]).transpose());
            Index nearest;
            double squared;
            tree.nearest(key.data(), {&nearest, 1}, {&squared, 1});
            use(i, nearest, squared);
        }
    }
    /// Rows of the part far from its rim, apart from each other.
    std::vector<Index> anchors() const;
    /// Of the places those least unlike one of the part, apart from each other.
    std::vector<Index> alike(std::span<const double> unlike, std::span<const Index> places,
                             int scale) const;
    /// The turn by which the part fits best.
    Seed best_turned(const PlacedPoint& of_part, const PlacedPoint& there, int scale, int turns,
                     std::span<const Index> rows) const;

    const CoarseShape& part_;
    const CoarseShape& whole_;
    Values from_rim_;          ///< of each point of the part
    std::vector<Index> rows_;  ///< of the part, off its rim
    std::vector<Keys> keys_;
    std::vector<KdTree<6>> trees_;
};

std::vector<Index> PartSearch::anchors() const {
    constexpr std::size_t kMost = 6;
    std::vector<Index> sorted = rows_;
    std::ranges::stable_sort(sorted, std::greater{}, [&](Index i) { return from_rim_[i]; });
    sorted.resize(std::max<std::size_t>(sorted.size() / 2, 1));
    std::vector<Index> chosen{sorted.front()};
    std::vector<double> apart(sorted.size(), std::numeric_limits<double>::infinity());
    while (chosen.size() < kMost) {
        for (std::size_t k = 0; k < sorted.size(); ++k)
            apart[k] = std::min(
                apart[k],
                (part_.positions.row(sorted[k]) - part_.positions.row(chosen.back())).norm());
        chosen.push_back(
            sorted[to_size(to_index(std::ranges::max_element(apart) - apart.begin()))]);
    }
    return chosen;
}

Seed PartSearch::best_turned(const PlacedPoint& of_part, const PlacedPoint& there, int scale,
                             int turns, std::span<const Index> rows) const {
    Seed best;
    best.misfit = std::numeric_limits<double>::infinity();
    for (int turn = 0; turn < turns; ++turn) {
        Seed seed = turned(of_part, there, scale, 2.0 * std::numbers::pi * turn / turns);
        seed.misfit = misfit(seed, rows);
        if (seed.misfit < best.misfit) best = seed;
    }
    return best;
}

std::vector<Index> PartSearch::alike(std::span<const double> unlike, std::span<const Index> places,
                                     int scale) const {
    constexpr std::size_t kMost = 12;
    constexpr double kApart = 0.15;
    std::vector<std::pair<double, Index>> sorted;
    for (std::size_t p = 0; p < places.size(); ++p) sorted.emplace_back(unlike[p], places[p]);
    std::ranges::sort(sorted);
    std::vector<Index> taken;
    for (const auto& [distance, at] : sorted) {
        if (taken.size() == kMost || !std::isfinite(distance)) break;
        const auto is_near = [&](Index other) {
            return (whole_.positions.row(at) - whole_.positions.row(other)).norm() <
                   kApart * scale_of(scale);
        };
        if (std::ranges::none_of(taken, is_near)) taken.push_back(at);
    }
    return taken;
}

/// How unlike some places of the part and of the whole are at each scale.
class ProfileDistances {
public:
    ProfileDistances(const std::vector<Profile>& parts, const std::vector<Profile>& wholes,
                     Progress& progress)
        : parts_(parts.size()), wholes_(wholes.size()), all_(parts_ * kScales * wholes_) {
        parallel_for(
            to_index(parts_ * kScales), progress,
            [&](Index begin, Index end) {
                for (Index job = begin; job < end; ++job)
                    for (std::size_t p = 0; p < wholes_; ++p)
                        all_[to_size(job) * wholes_ + p] =
                            unlike(parts[to_size(job) / kScales], wholes[p],
                                   static_cast<int>(to_size(job) % kScales));
            },
            0.0, 1.0, 1);
    }

    /// Of a place of the part, from all of the whole.
    std::span<const double> of(std::size_t part, int scale) const {
        return std::span(all_).subspan((part * kScales + to_size(scale)) * wholes_, wholes_);
    }

    /// Of all places of the part from those that they are most like; infinite where most of
    /// them know too little.
    double least_mean(int scale) const {
        double sum = 0.0;
        std::size_t known = 0;
        for (std::size_t part = 0; part < parts_; ++part) {
            const double least = std::ranges::min(of(part, scale));
            if (!std::isfinite(least)) continue;
            sum += least;
            ++known;
        }
        return 2 * known < parts_ || known == 0 ? std::numeric_limits<double>::infinity()
                                                : sum / static_cast<double>(known);
    }

private:
    std::size_t parts_, wholes_;
    std::vector<double> all_;
};

/// Whether the part looks less and less like the whole as it shrinks: then it is as large as the
/// whole, or nearly. What is a part of it looks like it again where it is as small as there; if
/// `smaller_only`, more than at the largest scale.
bool lacks_little(const ProfileDistances& distances, bool smaller_only) {
    std::array<double, kScales> means;
    for (int scale = 0; scale < kScales; ++scale)
        means[to_size(scale)] = distances.least_mean(scale);
    return smaller_only ? std::ranges::min_element(means) == means.begin()
                        : std::ranges::is_sorted(means);
}

std::vector<Seed> PartSearch::seeds(bool smaller_only, Progress& progress) const {
    constexpr Index kPlaces = 1200;
    constexpr int kTurns = 10;
    constexpr double kFewestSpacings = 3.0, kRounding = 1.0 + 1e-9;
    const auto least = [](const CoarseShape& shape) {
        return kFewestSpacings / std::sqrt(static_cast<double>(shape.size()));
    };
    const std::vector<Index> of_part = anchors();
    std::vector<double> reach;
    for (const Index i : of_part) reach.push_back(from_rim_[i]);
    std::vector<Index> places;
    const Index step = std::max<Index>(1, whole_.size() / kPlaces);
    for (Index i = 0; i < whole_.size(); i += step) places.push_back(i);
    const double farthest = kRounding * scale_of(0) * std::ranges::max(reach);
    const ProfileDistances distances(
        Profiles(part_, {kFirstRadius, kRadii, least(part_)}).of(of_part, reach, progress),
        Profiles(whole_,
                 {kFirstRadius * scale_of(kScales - 1), kRadii + kScales - 1, least(whole_)})
            .of(places, std::vector<double>(places.size(), farthest), progress),
        progress);
    if (lacks_little(distances, smaller_only)) return {};
    const std::vector<Index> few = some(kFew);
    std::vector<std::vector<Seed>> found(of_part.size() * kScales);
    parallel_for(
        to_index(found.size()), progress,
        [&](Index begin, Index end) {
            for (Index job = begin; job < end; ++job) {
                const std::size_t a = to_size(job) / kScales;
                const int scale = static_cast<int>(to_size(job) % kScales);
                for (const Index at : alike(distances.of(a, scale), places, scale))
                    found[to_size(job)].push_back(best_turned(
                        point(part_, of_part[a]), point(whole_, at), scale, kTurns, few));
            }
        },
        0.0, 1.0, 1);
    std::vector<Seed> result;
    for (const auto& some : found) result.insert(result.end(), some.begin(), some.end());
    return result;
}

std::vector<Seed> PartSearch::seeds_at(const PartMarks& marks, Progress& progress) const {
    constexpr int kTurns = 24;
    const KdTree<3> part_tree(part_.positions), whole_tree(whole_.positions);
    const Index i = nearest_rows(part_tree, marks.part.topRows(1)).front(),
                j = nearest_rows(whole_tree, marks.whole.topRows(1)).front();
    const std::vector<Index> few = some(kFew);
    std::vector<Seed> result;
    for (int scale = 0; scale < kScales; ++scale)
        for (int turn = 0; turn < kTurns; ++turn) {
            Seed seed = turned(point(part_, i), point(whole_, j), scale,
                               2.0 * std::numbers::pi * turn / kTurns);
            seed.misfit = misfit(seed, few);
            result.push_back(seed);
        }
    progress.throw_if_cancelled();
    return result;
}

/// Best first; no two that lie alike; at most `most`.
void keep_apart(std::vector<Seed>& seeds, double apart, std::size_t most) {
    std::ranges::stable_sort(seeds, {}, &Seed::misfit);
    std::vector<Seed> kept;
    for (const Seed& seed : seeds) {
        if (kept.size() == most) break;
        const auto is_alike = [&](const Seed& other) {
            const double size = std::min(seed.pose.scale, other.pose.scale);
            return (seed.pose.translation - other.pose.translation).norm() < apart * size &&
                   (seed.pose.rotation - other.pose.rotation).norm() < 2.0 * apart &&
                   std::abs(std::log(seed.pose.scale / other.pose.scale)) < apart;
        };
        if (std::ranges::none_of(kept, is_alike)) kept.push_back(seed);
    }
    seeds = std::move(kept);
}

std::vector<Seed> all_settled(const PartSearch& search, const std::vector<Seed>& seeds,
                              std::size_t points, int rounds, Progress& progress) {
    const std::vector<Index> rows = search.some(points);
    std::vector<Seed> result(seeds.size());
    parallel_for(
        to_index(seeds.size()), progress,
        [&](Index begin, Index end) {
            for (Index k = begin; k < end; ++k)
                result[to_size(k)] = search.settled(seeds[to_size(k)], rows, rounds);
        },
        0.0, 1.0, 4);
    return result;
}

/// The connected pieces of some points of a shape.
std::vector<std::vector<Index>> connected(const SurfaceGraph& graph,
                                          const std::vector<char>& is_among) {
    std::vector<std::vector<Index>> pieces;
    std::vector<char> seen(is_among.size(), 0);
    for (Index start = 0; start < graph.size(); ++start) {
        if (is_among[to_size(start)] == 0 || seen[to_size(start)] != 0) continue;
        std::vector<Index>& piece = pieces.emplace_back(1, start);
        seen[to_size(start)] = 1;
        for (std::size_t k = 0; k < piece.size(); ++k)
            for (const Index j : graph[piece[k]]) {
                if (is_among[to_size(j)] == 0 || seen[to_size(j)] != 0) continue;
                seen[to_size(j)] = 1;
                piece.push_back(j);
            }
    }
    return pieces;
}

}  // namespace

bool PartMarks::say_all() const {
    constexpr double kOffTheLine = 0.1;
    if (part.rows() < 3) return false;
    Vector3 along = Vector3::Zero();  // from the first to the farthest
    for (Eigen::Index k = 1; k < part.rows(); ++k) {
        const Vector3 arm = (part.row(k) - part.row(0)).transpose();
        if (arm.squaredNorm() > along.squaredNorm()) along = arm;
    }
    for (Eigen::Index k = 1; k < part.rows(); ++k) {
        const Vector3 arm = (part.row(k) - part.row(0)).transpose();
        if (arm.cross(along).norm() > kOffTheLine * along.norm()) return true;
    }
    return false;
}

std::vector<PartPlace> find_part(const CoarseShape& part, const CoarseShape& whole,
                                 const PartMarks& marks, const PartChoice& choice,
                                 Progress& progress) {
    if (marks.say_all()) return {{marks.pose(), 0.0}};
    const PartSearch search(part, whole);
    if (!search.is_possible()) return {};
    std::vector<Seed> seeds = marks.part.rows() > 0 ? search.seeds_at(marks, progress)
                                                    : search.seeds(choice.smaller_only, progress);
    const auto settle = [&](std::size_t points, int rounds) {
        seeds = all_settled(search, seeds, points, rounds, progress);
        constexpr double kMarkApart = 0.3;
        std::erase_if(seeds, [&](const Seed& seed) {
            return marks.part.rows() > 0 &&
                   (seed.pose.apply(marks.part) - marks.whole).rowwise().norm().maxCoeff() >
                       kMarkApart * seed.pose.scale;
        });
    };
    keep_apart(seeds, 0.1, 200);
    settle(60, 6);
    keep_apart(seeds, 0.1, 40);
    settle(250, 10);
    keep_apart(seeds, 0.25, choice.most);
    std::vector<PartPlace> places;
    for (const Seed& seed : seeds) places.push_back({seed.pose, seed.misfit});
    return places;
}

std::vector<char> covered_by_part(const CoarseShape& part, const CoarseShape& whole,
                                  const Similarity& pose, double margin) {
    constexpr double kClose = 0.25;
    const Similarity back = pose.inverse();
    const Keys of_part = keys(part.positions, part.normals);
    const KdTree<6> tree(of_part);
    const Keys there = keys(back.apply(whole.positions), back.rotated(whole.normals));
    std::vector<char> is_close(to_size(whole.size()), 0);
    for (Index i = 0; i < whole.size(); ++i) {
        Index nearest;
        double squared;
        tree.nearest(there.row(i).data(), {&nearest, 1}, {&squared, 1});
        is_close[to_size(i)] = squared < kClose * kClose && part.ends[to_size(nearest)] == 0;
    }
    std::vector<char> covered(to_size(whole.size()), 0);
    const std::vector<std::vector<Index>> pieces = connected(whole.graph, is_close);
    if (pieces.empty()) return covered;
    GeodesicSearch along(whole.graph);
    for (const auto& [row, distance] : along.reached(
             *std::ranges::max_element(pieces, {}, &std::vector<Index>::size), margin * pose.scale))
        covered[to_size(row)] = 1;
    return covered;
}

void cover_what_hangs_on(const CoarseShape& part, const CoarseShape& whole, const Similarity& pose,
                         std::vector<char>& covered) {
    constexpr double kSmall = 1.0 / 3.0, kAtEnd = 0.5;  // of what it hangs on
    std::vector<char> is_free(covered.size());
    std::ranges::transform(covered, is_free.begin(), [](char its) { return its == 0; });
    const std::vector<std::vector<Index>> pieces = connected(whole.graph, is_free);
    if (pieces.empty()) return;
    std::vector<double> areas;
    for (const std::vector<Index>& piece : pieces) areas.push_back(whole.areas(piece).sum());
    const double most = kSmall * std::ranges::max(areas);
    const KdTree<3> tree(part.positions);
    const auto part_ends_at = [&](const std::vector<Index>& piece) {
        std::vector<Index> beside;
        for (const Index row : piece)
            for (const Index j : whole.graph[row])
                if (is_free[to_size(j)] == 0) beside.push_back(j);
        const std::vector<Index> nearest =
            nearest_rows(tree, pose.inverse().apply(gather(whole.positions, beside)));
        const auto at_end = std::ranges::count_if(
            nearest, [&](Index i) { return !part.ends.empty() && part.ends[to_size(i)] != 0; });
        return static_cast<double>(at_end) > kAtEnd * static_cast<double>(beside.size());
    };
    for (std::size_t k = 0; k < pieces.size(); ++k)
        if (areas[k] <= most && !part_ends_at(pieces[k]))
            for (const Index row : pieces[k]) covered[to_size(row)] = 1;
}

}  // namespace pointmorph

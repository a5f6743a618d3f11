#include "pointmorph/surface/boundary.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <queue>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "cloud/closed_length.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/surface/sampled_surface.hpp"
#include "surface/outside.hpp"

namespace pointmorph {

namespace {

/// Mean product of a loop's normals and the normal of the disc that would close it, from which on
/// that disc continues the surface; less among scattered points, where gaps reach round tips.
constexpr double kFlat = 0.65, kFlatAmongScattered = 0.35;

/// How many times as long as `min_loop` a flat hole is among scattered points: of 380 closed
/// surfaces that were sampled at random, nine have flat gaps that are as long as `min_loop` itself.
constexpr double kLongAmongScattered = 1.75;

/// Area over length of a loop, in spacings, below which it runs along a crease and back: normals
/// on both sides differ too much for the stars to reach across. A round hole of radius r has r / 2.
constexpr double kThin = 0.6;

/// The share of a loop's points at a fold from which on the surface goes on behind it.
constexpr double kFold = 0.25;

/// The share of a loop's length that may have been bridged where stars disagree; more where it
/// surrounds what is clearly empty.
constexpr double kBridged = 0.12, kMostBridged = 0.45;

/// A hole is clearly empty where so many more points than lie along its loop would lie in it if it
/// were surface: the longer the loop, the more ways it has round gaps. Of 319 closed surfaces that
/// were sampled at random, none has a gap that would hold more than 14.
constexpr double kMissed = 17.0;

/// How far a bridge may lead, in lengths of the spokes where the chain ends.
constexpr double kBridgeReach = 5.0;

/// Which passage follows which, and what lies between where the stars of their points disagree.
struct Links {
    std::vector<Index> next;              ///< #passages, −1 at an end
    std::vector<std::vector<Index>> via;  ///< points between a passage and the next
};

/// A short way over the cloud from one end of a chain of passages to the start of another.
struct Bridge {
    double cost;
    Index from, to;  ///< passages
    std::vector<Index> via;
};

/// The cheapest way from the end of passage `from` to the start of a chain close by, if there is
/// one. The cost of a way is its sum of squared lengths, so that it takes small steps.
std::optional<Bridge> find_bridge(const SampledSurface& surface, const Outside& outside,
                                  std::span<const Passage> passages, std::span<const char> is_start,
                                  Index from) {
    const Positions& positions = surface.positions;
    const Normals& normals = surface.normals;
    const Neighborhoods& nearest = surface.nearest;
    using Entry = std::pair<double, Index>;
    struct Reached {
        double cost;
        Index before;
    };
    const auto squared_distance = [&](Index i, Index j) {
        return (positions.row(i) - positions.row(j)).squaredNorm();
    };
    const Passage& end = passages[to_size(from)];
    const double limit =
        kBridgeReach * kBridgeReach *
        std::max(squared_distance(end.point, end.before), squared_distance(end.point, end.after));
    std::unordered_map<Index, Reached> reached{{end.point, {0.0, -1}}};
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
    queue.emplace(0.0, end.point);
    while (!queue.empty()) {
        const auto [cost, i] = queue.top();
        queue.pop();
        if (cost > reached[i].cost) continue;
        const auto range = std::ranges::equal_range(passages, i, {}, &Passage::point);
        for (auto p = range.begin(); p != range.end(); ++p) {
            const auto to = to_index(p - passages.begin());
            if (!is_start[to_size(to)]) continue;
            Bridge bridge{cost, from, to, {}};
            for (Index k = reached[i].before; k >= 0 && k != end.point; k = reached[k].before)
                bridge.via.push_back(k);
            std::ranges::reverse(bridge.via);
            return bridge;
        }
        const auto step = [&](Index j) {
            if (normals.row(j).dot(normals.row(i)) < kOpposed ||
                squared_distance(end.point, j) > limit)
                return;
            const double there = cost + squared_distance(i, j);
            const auto [known, is_new] = reached.try_emplace(j, Reached{there, i});
            if (!is_new && known->second.cost <= there) return;
            known->second = {there, i};
            queue.emplace(there, j);
        };
        for (const Index j : nearest[i]) step(j);
        for (const Spoke& spoke : outside.star(i)) step(spoke.neighbor);
    }
    return {};
}

Links link(const SampledSurface& surface, const Outside& outside, std::span<const Passage> passages,
           Progress& progress) {
    Links links{std::vector<Index>(passages.size(), -1),
                std::vector<std::vector<Index>>(passages.size())};
    std::vector<char> is_start(passages.size(), 1);
    for (std::size_t m = 0; m < passages.size(); ++m) {
        const auto range =
            std::ranges::equal_range(passages, passages[m].after, {}, &Passage::point);
        const auto next = std::ranges::find(range, passages[m].point, &Passage::before);
        if (next == range.end()) continue;
        links.next[m] = to_index(next - passages.begin());
        is_start[to_size(links.next[m])] = 0;
    }

    // Two ends may want the same start: the shorter bridge is built, and the other end tries again.
    for (bool built = true; built;) {
        std::vector<Bridge> bridges;
        for (std::size_t m = 0; m < passages.size(); ++m) {
            if (links.next[m] >= 0) continue;
            progress.report(0.9 +
                            0.1 * static_cast<double>(m) / static_cast<double>(passages.size()));
            if (auto bridge = find_bridge(surface, outside, passages, is_start, to_index(m)))
                bridges.push_back(std::move(*bridge));
        }
        built = !bridges.empty();
        std::ranges::stable_sort(bridges, {}, &Bridge::cost);
        for (Bridge& bridge : bridges) {
            if (!is_start[to_size(bridge.to)]) continue;
            links.next[to_size(bridge.from)] = bridge.to;
            links.via[to_size(bridge.from)] = std::move(bridge.via);
            is_start[to_size(bridge.to)] = 0;
        }
    }
    return links;
}

/// Cuts a closed walk into closed walks that pass each point once.
std::vector<BoundaryLoop> simple_loops(std::span<const Index> walk) {
    std::vector<BoundaryLoop> loops;
    std::unordered_map<Index, std::size_t> place;
    BoundaryLoop path;
    for (const Index i : walk) {
        if (const auto known = place.find(i); known != place.end()) {
            const auto first = path.begin() + static_cast<std::ptrdiff_t>(known->second);
            loops.emplace_back(first, path.end());
            for (auto k = first; k != path.end(); ++k) place.erase(*k);
            path.erase(first, path.end());
        }
        place.emplace(i, path.size());
        path.push_back(i);
    }
    loops.push_back(std::move(path));
    return loops;
}

/// A loop that may bound the surface.
struct Candidate {
    BoundaryLoop loop;
    bool is_bridged;  ///< by more than kBridged
};

/// The closed walks along chains that close, each with no more bridges than may be.
std::vector<Candidate> close_chains(const Positions& positions, std::span<const Passage> passages,
                                    const Links& links) {
    const auto distance = [&](Index i, Index j) {
        return (positions.row(i) - positions.row(j)).norm();
    };
    std::vector<Candidate> loops;
    std::vector<char> seen(passages.size(), 0);
    for (std::size_t first = 0; first < passages.size(); ++first) {
        BoundaryLoop walk;
        double length = 0.0, bridged = 0.0;
        std::size_t m = first;
        while (!seen[m]) {
            seen[m] = 1;
            if (links.next[m] < 0) break;
            walk.push_back(passages[m].point);
            walk.insert(walk.end(), links.via[m].begin(), links.via[m].end());
            const std::size_t next = to_size(links.next[m]);
            const double step = distance(passages[m].point, passages[next].point);
            length += step;
            if (passages[m].after != passages[next].point ||
                passages[next].before != passages[m].point)
                bridged += step;
            m = next;
        }
        // Every passage has one before it at most: only what comes back to its first is closed.
        if (walk.empty() || m != first || bridged > kMostBridged * length) continue;
        for (BoundaryLoop& loop : simple_loops(walk))
            loops.push_back({std::move(loop), bridged > kBridged * length});
    }
    return loops;
}

/// The vector area that a loop spans.
Vector3 vector_area(const Positions& positions, std::span<const Index> loop) {
    const Vector3 origin = positions.row(loop.front());
    Vector3 twice = Vector3::Zero();
    for (std::size_t k = 1; k + 1 < loop.size(); ++k) {
        const Vector3 a = positions.row(loop[k]).transpose() - origin;
        const Vector3 b = positions.row(loop[k + 1]).transpose() - origin;
        twice += a.cross(b);
    }
    return 0.5 * twice;
}

/// Whether the surface goes on behind a loop, with opposed normals: round a sharp rim, where the
/// neighbors on the other side take the loop for outside as well, or flat, where normals were
/// estimated with the wrong sign.
bool is_fold(const SampledSurface& surface, std::span<const Passage> passages,
             const BoundaryLoop& loop) {
    const Positions& positions = surface.positions;
    const Normals& normals = surface.normals;
    const Neighborhoods& nearest = surface.nearest;
    std::size_t count = 0;
    for (std::size_t k = 0; k < loop.size(); ++k) {
        const Index i = loop[k];
        const Vector3 along = positions.row(loop[k + 1 < loop.size() ? k + 1 : 0]) -
                              positions.row(loop[k > 0 ? k - 1 : loop.size() - 1]);
        const Vector3 normal = normals.row(i), right = along.cross(normal).normalized();
        const auto near = nearest[i].first(std::min<std::size_t>(nearest[i].size(), 8));
        const auto is_opposed = [&](Index j) { return normals.row(j).dot(normal) < kOpposed; };
        const auto is_beyond = [&](Index j) {
            const Vector3 d = positions.row(j) - positions.row(i);
            return d.dot(right) > 0.5 * d.norm() && std::abs(d.dot(normal)) < 0.3 * d.norm();
        };
        const auto is_passed = [&](Index j) {
            return std::ranges::binary_search(passages, j, {}, &Passage::point);
        };
        count +=
            std::ranges::any_of(near, [&](Index j) { return is_opposed(j) && is_beyond(j); }) ||
            std::ranges::any_of(nearest[i], [&](Index j) { return is_opposed(j) && is_passed(j); });
    }
    return static_cast<double>(count) > kFold * static_cast<double>(loop.size());
}

/// How many points would lie inside of a loop if it were as dense there as around it. `area`: the
/// vector area that it spans.
double missed_points(const SampledSurface& surface, const BoundaryLoop& loop, const Vector3& area) {
    const Positions& positions = surface.positions;
    Eigen::RowVector3d middle = Eigen::RowVector3d::Zero();
    for (const Index i : loop) middle += positions.row(i) / static_cast<double>(loop.size());
    // Of a disc twice as wide as one of that area, three quarters lie around that one. Walked round
    // clockwise: the area points inward.
    const double limit = 4.0 * area.norm() / std::numbers::pi;
    std::vector<Index> open(loop.begin(), loop.end());
    std::unordered_set<Index> known(loop.begin(), loop.end());
    Index around = 0;
    while (!open.empty()) {
        const Index i = open.back();
        open.pop_back();
        if ((positions.row(i) - middle).squaredNorm() > limit) continue;
        ++around;
        for (const Index j : surface.nearest[i])
            if (surface.normals.row(j).dot(area) < 0.0 && known.insert(j).second) open.push_back(j);
    }
    return static_cast<double>(around) / 3.0;
}

/// Whether a loop bounds the surface, and not just a gap in its sampling.
bool is_boundary(const SampledSurface& surface, const Outside& outside,
                 std::span<const Passage> passages, const Candidate& candidate, double min_loop) {
    const BoundaryLoop& loop = candidate.loop;
    const Positions& positions = surface.positions;
    if (loop.size() < 3) return false;
    double length = 0.0, relative_length = 0.0;  // the latter in local spacings
    for (std::size_t k = 0; k < loop.size(); ++k) {
        const Index i = loop[k], j = loop[k + 1 < loop.size() ? k + 1 : 0];
        const double step = (positions.row(i) - positions.row(j)).norm();
        const double spacing = std::max(outside.spacing(i), outside.spacing(j));
        length += step;
        if (spacing > 0.0) relative_length += step / spacing;
    }
    if (relative_length < min_loop) return false;

    const Vector3 area = vector_area(positions, loop);
    const double spacing = length / relative_length;
    if (area.norm() < kThin * spacing * length) return false;
    if (is_fold(surface, passages, loop)) return false;
    const bool is_scattered = outside.is_scattered();
    if (!outside.is_uneven() && !is_scattered && !candidate.is_bridged) return true;
    // A hole is walked round clockwise: its area points inward.
    double along = 0.0;
    for (const Index i : loop) along -= surface.normals.row(i).dot(area);
    along /= area.norm() * static_cast<double>(loop.size());
    if (outside.is_uneven()) return !candidate.is_bridged && along <= kFlat;
    if (along > kFlatAmongScattered &&
        missed_points(surface, loop, area) >= kMissed + static_cast<double>(loop.size()))
        return true;
    if (candidate.is_bridged) return false;
    return along <= kFlatAmongScattered || relative_length >= kLongAmongScattered * min_loop;
}

}  // namespace

std::vector<BoundaryLoop> find_boundary_loops(const Positions& positions, const Normals& normals,
                                              const Neighborhoods& nearest,
                                              const BoundaryOptions& options, Progress& progress) {
    if (positions.rows() < 3) return {};
    const SampledSurface surface{positions, normals, nearest};
    const Outside outside(surface, options.opening, progress);
    const std::vector<Passage> passages = outside.passages();
    const Links links = link(surface, outside, passages, progress);
    std::vector<BoundaryLoop> loops;
    for (Candidate& candidate : close_chains(positions, passages, links))
        if (is_boundary(surface, outside, passages, candidate, options.min_loop))
            loops.push_back(std::move(candidate.loop));
    for (BoundaryLoop& loop : loops) std::ranges::rotate(loop, std::ranges::min_element(loop));
    std::ranges::sort(loops, [&](const BoundaryLoop& a, const BoundaryLoop& b) {
        const double la = loop_length(positions, a), lb = loop_length(positions, b);
        return la != lb ? la > lb : a.front() < b.front();
    });
    return loops;
}

BoundaryLoop oriented_loop(const Positions& positions, const Normals& normals,
                           const Neighborhoods& nearest, BoundaryLoop loop,
                           const std::string& name) {
    const std::string subject = "boundary of " + name;
    if (loop.size() < 3)
        throw FeatureError(subject, "at least three points", std::to_string(loop.size()),
                           "Give the whole loop, point by point.");
    std::vector<char> taken(to_size(positions.rows()), 0);
    for (const Index i : loop) {
        if (i < 0 || i >= positions.rows())
            throw FeatureError(subject, "rows from 0 to " + std::to_string(positions.rows() - 1),
                               std::to_string(i), "Count the points from 0.");
        if (std::exchange(taken[to_size(i)], 1))
            throw FeatureError(subject, "every point once", "point " + std::to_string(i) + " twice",
                               "Leave out the repetition; the loop closes by itself.");
    }
    // The surface is where the neighbors are.
    double left = 0.0;
    for (std::size_t k = 0; k < loop.size(); ++k) {
        const Index i = loop[k];
        const Vector3 along = (positions.row(loop[k + 1 < loop.size() ? k + 1 : 0]) -
                               positions.row(loop[k > 0 ? k - 1 : loop.size() - 1]))
                                  .transpose();
        const Vector3 normal = normals.row(i);
        Vector3 around = Vector3::Zero();
        for (const Index j : nearest[i])
            if (normals.row(j).dot(normals.row(i)) >= kOpposed)
                around += (positions.row(j) - positions.row(i)).transpose();
        left += normal.cross(along).normalized().dot(around.normalized());
    }
    if (left < 0.0) std::reverse(loop.begin() + 1, loop.end());
    return loop;
}

double loop_length(const Positions& positions, std::span<const Index> loop) {
    return closed_length(positions, loop);
}

}  // namespace pointmorph

#include "pointmorph/disk/decomposition.hpp"

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "disk/cut_ground.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

/// Lengths in √area over which the guide changes from one side of a limb to the other, and over
/// which the parts of the curve repel each other.
constexpr double kTransition = 0.02, kRepulsion = 0.04;

double sigmoid(double x) {
    return 1.0 / (1.0 + std::exp(-x));
}

/// Distance of every point within `limit` to the nearest of some.
Values distances_to_path(GeodesicSearch& search, Index count, std::span<const Index> path,
                         double limit) {
    Values result = Values::Constant(count, kFar);
    for (const auto& [i, distance] : search.reached(path, limit)) result[i] = distance;
    return result;
}

SurfaceCurve curve_of(const CoarseCloud& coarse, const std::vector<Index>& path) {
    return {gather(coarse.positions, path), gather(coarse.normals, path)};
}

/// One path from each feature to the next, guided and kept apart. Features are rows 0, 1, …;
/// `from` has every point's distance from each, in √area.
std::vector<SurfaceCurve> guided_paths(const CoarseCloud& coarse, const Eigen::MatrixXd& from,
                                       Index features, const DecompositionOptions& options,
                                       Progress& progress) {
    const Index count = coarse.graph.size();
    GeodesicSearch search(coarse.graph);
    const auto next = [&](Index k) { return (k + 1) % features; };
    const auto previous = [&](Index k) { return (k + features - 1) % features; };
    // Above 0 where a point near feature k lies on the side of the next feature.
    const auto side = [&](Index k, Index x) {
        const Index back = previous(k), ahead = next(k);
        return (from(x, back) - from(k, back)) - (from(x, ahead) - from(k, ahead));
    };
    std::vector<Index> cell(to_size(count), 0);
    for (Index x = 0; x < count; ++x)
        for (Index k = 1; k < features; ++k)
            if (from(x, k) < from(x, cell[to_size(x)])) cell[to_size(x)] = k;

    std::vector<SurfaceCurve> curves;
    Values repulsion = Values::Zero(count);
    for (Index a = 0; a < features; ++a) {
        const Index b = next(a);
        Values costs(count);
        for (Index x = 0; x < count; ++x) {
            double extra = options.elsewhere;
            if (cell[to_size(x)] == a) extra = options.guide * sigmoid(-side(a, x) / kTransition);
            if (cell[to_size(x)] == b) extra = options.guide * sigmoid(side(b, x) / kTransition);
            costs[x] = 1.0 + extra + options.repulsion * repulsion[x];
        }
        const std::vector<Index> path = cheapest_path(coarse.graph, a, b, costs);
        const Values near = distances_to_path(search, count, path, 3.0 * kRepulsion * coarse.unit);
        for (Index x = 0; x < count; ++x) {
            const double d = near[x] / (kRepulsion * coarse.unit);
            if (!(d < 3.0)) continue;
            // The curves meet at their ends, which must not push the next one away.
            const double end = std::min(from(x, a), from(x, b)) / (2.0 * kRepulsion);
            repulsion[x] += std::exp(-d * d) * std::min(1.0, end);
        }
        curves.push_back(curve_of(coarse, path));
        progress.report(0.2 + 0.3 * (a + 1) / features);
    }
    return curves;
}

/// Tells how far from a closed curve a point lies, and on which side.
class CurveSides {
public:
    explicit CurveSides(const SurfaceCurve& curve) : curve_(curve), tree_(curve.points) {}

    /// Distance to the curve, above 0 on its left; nothing where no part of it within `reach`
    /// lies on the same sheet.
    std::optional<double> signed_distance(const Eigen::RowVector3d& point,
                                          const Eigen::RowVector3d& normal, double reach) const {
        std::array<Index, 6> near;
        std::array<double, 6> squared;
        const auto found = to_size(tree_.nearest_within(point.data(), reach, near, squared));
        const Index count = curve_.size();
        double best = kFar;
        Eigen::RowVector3d left = Eigen::RowVector3d::Zero(), offset = left;
        for (std::size_t k = 0; k < found; ++k) {
            const Index c = near[k];
            if (curve_.normals.row(c).dot(normal) <= 0.0) continue;
            for (const Index a : {(c + count - 1) % count, c}) {
                const Index b = (a + 1) % count;
                const Eigen::RowVector3d edge = curve_.points.row(b) - curve_.points.row(a);
                const double length = edge.squaredNorm();
                const double along =
                    length > 0.0
                        ? std::clamp((point - curve_.points.row(a)).dot(edge) / length, 0.0, 1.0)
                        : 0.0;
                const Eigen::RowVector3d foot = curve_.points.row(a) + along * edge;
                const double distance = (point - foot).squaredNorm();
                if (distance >= best) continue;
                best = distance;
                offset = point - foot;
                left = along <= 0.0 ? left_at(a) : along >= 1.0 ? left_at(b) : left_of(a, c);
            }
        }
        if (best == kFar) return std::nullopt;
        return std::copysign(std::sqrt(best), left.dot(offset));
    }

private:
    /// Across the edge from a to the next point.
    Eigen::RowVector3d left_of(Index a, Index at_normal) const {
        const Eigen::RowVector3d edge =
            curve_.points.row((a + 1) % curve_.size()) - curve_.points.row(a);
        const Eigen::RowVector3d across = curve_.normals.row(at_normal).cross(edge);
        return across.norm() > 0.0 ? across.normalized() : across;
    }
    /// At a corner, halfway between both edges.
    Eigen::RowVector3d left_at(Index a) const {
        return left_of((a + curve_.size() - 1) % curve_.size(), a) + left_of(a, a);
    }

    const SurfaceCurve& curve_;
    KdTree<3> tree_;
};

/// Two edges of a closed curve that cross, seen along the normal: places of their first points.
std::optional<std::pair<Index, Index>> first_crossing(const SurfaceCurve& curve) {
    const Index count = curve.size();
    double longest = 0.0;
    for (Index i = 0; i < count; ++i)
        longest =
            std::max(longest, (curve.points.row((i + 1) % count) - curve.points.row(i)).norm());
    const KdTree<3> tree(curve.points);
    std::vector<std::pair<Index, double>> ball;
    for (Index i = 0; i < count; ++i) {
        const Index i2 = (i + 1) % count;
        tree.within_unsorted(curve.points.row(i).data(), 2.0 * longest, ball);
        std::erase_if(ball, [&](const auto& found) { return found.first <= i; });
        std::ranges::sort(ball);
        for (const auto& [j, squared] : ball) {
            const Index j2 = (j + 1) % count;
            if (j == i2 || j2 == i) continue;
            if (curve.normals.row(i).dot(curve.normals.row(j)) <= 0.0) continue;
            const Vector3 normal =
                (curve.normals.row(i) + curve.normals.row(j)).transpose().normalized();
            if (edges_cross(curve.points.row(i), curve.points.row(i2), curve.points.row(j),
                            curve.points.row(j2), normal))
                return std::pair{i, j};
        }
    }
    return std::nullopt;
}

/// Removes crossings. The curve crosses itself in a loop: a loop without features is left out, and
/// one with a single feature is reversed, which keeps the features' order. Throws FeatureError for
/// loops with more.
void uncross(ClosedCurve& closed, std::span<const std::string> names, const std::string& name) {
    constexpr int kMost = 200;
    for (int repair = 0; repair < kMost; ++repair) {
        const auto crossing = first_crossing(closed.curve);
        if (!crossing) return;
        const Index count = closed.curve.size();
        std::vector<Index> order;
        // Between i + 1 and j is one loop, the rest is the other.
        const auto [i, j] = *crossing;
        const auto in_loop = [&](Index corner) { return corner > i && corner <= j; };
        const auto inside = std::ranges::count_if(closed.corners, in_loop);
        const auto outside = static_cast<std::ptrdiff_t>(closed.corners.size()) - inside;
        if (inside > 1 && outside > 1) {
            const auto segment = [&](Index place) {
                const auto after = std::ranges::upper_bound(closed.corners, place);
                const auto k = to_size(after - closed.corners.begin()) - 1;
                return "from \"" + names[k] + "\" to \"" + names[(k + 1) % names.size()] + "\"";
            };
            throw FeatureError("loop", "a closed curve on " + name + " that doesn't cross itself",
                               "crossing curves " + segment(i) + " and " + segment(j),
                               "Change the order of the features in the loop, or add a feature "
                               "that leads one of the two curves around.");
        }
        // Rows `first` to `last`, inclusive and cyclic, are reversed or left out.
        const Index first = inside <= 1 ? i + 1 : j + 1;
        const Index last = inside <= 1 ? j : i + count;
        const auto held = inside <= 1 ? inside : outside;
        std::vector<char> corner(to_size(count), 0);
        for (const Index c : closed.corners) corner[to_size(c)] = 1;
        for (Index k = last + 1; k < first + count; ++k) order.push_back(k % count);
        if (held == 1)
            for (Index k = last; k >= first; --k) order.push_back(k % count);
        // Feature 0 stays in front.
        const auto front = std::ranges::find(order, 0);
        std::ranges::rotate(order, front);
        ClosedCurve next;
        next.curve = {gather(closed.curve.points, order), gather(closed.curve.normals, order)};
        for (std::size_t k = 0; k < order.size(); ++k)
            if (corner[to_size(order[k])]) next.corners.push_back(to_index(k));
        closed = std::move(next);
    }
    throw FeatureError("loop", "a closed curve on " + name + " that doesn't cross itself",
                       "one that crosses itself many times",
                       "Change the order of the features in the loop, or add features between "
                       "those that lie far apart.");
}

/// How much every coarse point belongs to the left (1) or the right (−1) of the curve. Next to the
/// curve the value is fixed; elsewhere it comes from a random walker's chance of meeting the left
/// side first, over edges that don't cross the curve (Grady 2006).
Values walk(const CoarseCloud& coarse, const CurveSides& sides, Index features) {
    const Index count = coarse.graph.size();
    const double reach = 3.0 * coarse.spacing, seed_reach = 1.2 * coarse.spacing;
    Values local = Values::Zero(count), value = Values::Zero(count);
    std::vector<char> fixed(to_size(count), 0);
    for (Index i = 0; i < count; ++i) {
        if (i < features) continue;
        const auto d = sides.signed_distance(coarse.positions.row(i), coarse.normals.row(i), reach);
        if (!d) continue;
        local[i] = *d;
        if (std::abs(*d) > seed_reach) continue;
        fixed[to_size(i)] = 1;
        value[i] = *d > 0.0 ? 1.0 : -1.0;
    }
    std::vector<Index> unknown(to_size(count), -1);
    Index unknowns = 0;
    for (Index i = 0; i < count; ++i)
        if (!fixed[to_size(i)]) unknown[to_size(i)] = unknowns++;
    if (unknowns == 0) return value;

    std::vector<Eigen::Triplet<double>> entries;
    Values right = Values::Zero(unknowns), diagonal = Values::Constant(unknowns, 1e-9);
    for (Index i = 0; i < count; ++i) {
        const Index row = unknown[to_size(i)];
        if (row < 0 || i < features) continue;
        for (auto e = to_size(coarse.graph.offsets[to_size(i)]);
             e < to_size(coarse.graph.offsets[to_size(i) + 1]); ++e) {
            const Index j = coarse.graph.neighbors[e];
            if (j < features || local[i] * local[j] < 0.0) continue;
            const double weight = coarse.spacing / coarse.graph.lengths[e];
            diagonal[row] += weight;
            if (const Index column = unknown[to_size(j)]; column >= 0)
                entries.emplace_back(row, column, -weight);
            else
                right[row] += weight * value[j];
        }
    }
    for (Index i = 0; i < unknowns; ++i) entries.emplace_back(i, i, diagonal[i]);
    Eigen::SparseMatrix<double> matrix(unknowns, unknowns);
    matrix.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(matrix);
    const Values solved = solver.solve(right);
    for (Index i = 0; i < count; ++i)
        if (const Index row = unknown[to_size(i)]; row >= 0) value[i] = solved[row];
    return value;
}

/// Next to the curve the point's own side decides, elsewhere that of the coarse points around.
std::vector<Patch> patches_of(const SampledSurface& surface, const CoarseCloud& coarse,
                              const CurveSides& sides, const Values& left, Progress& progress) {
    std::vector<Patch> patches(to_size(surface.size()));
    // Coarse points well away from the curve speak for all points around them.
    const double reach = 1.2 * coarse.spacing;
    std::vector<char> remote(to_size(coarse.graph.size()), 0);
    for (Index i = 0; i < coarse.graph.size(); ++i)
        remote[to_size(i)] = !sides.signed_distance(coarse.positions.row(i), coarse.normals.row(i),
                                                    3.0 * coarse.spacing);
    parallel_for(surface.size(), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const Index cell = coarse.cells[to_size(i)];
            double value = left[cell];
            if (!remote[to_size(cell)])
                if (const auto d = sides.signed_distance(surface.positions.row(i),
                                                         surface.normals.row(i), reach))
                    value = *d;
            patches[to_size(i)] = value > 0.0 ? Patch::kLeft : Patch::kRight;
        }
    });
    return patches;
}

/// Gives small islands to the patch around them. Returns the sizes of left and right.
std::array<Index, 2> clean_up(std::vector<Patch>& patches, const Neighborhoods& nearest) {
    GrowingComponents joined(nearest.size());
    std::vector<IndexPair> across;
    for (Index i = 0; i < nearest.size(); ++i)
        for (const Index j : nearest[i]) {
            if (patches[to_size(i)] != patches[to_size(j)])
                across.push_back({i, j});
            else if (!joined.are_joined(i, j))
                joined.join(i, j);
        }
    const ConnectedComponents parts = joined.components();
    for (const auto& [i, j] : across)
        if (!joined.are_joined(i, j)) joined.join(i, j);
    const ConnectedComponents whole = joined.components();
    // The largest part of each patch in each component of the shape stays.
    std::vector<std::array<Index, 2>> largest(to_size(whole.count()), {-1, -1});
    for (std::size_t i = 0; i < patches.size(); ++i) {
        if (patches[i] == Patch::kCurve) continue;
        Index& best = largest[to_size(whole.label[i])][to_size(patches[i])];
        const Index mine = parts.label[i];
        if (best < 0 || parts.sizes[to_size(mine)] > parts.sizes[to_size(best)]) best = mine;
    }
    std::array<Index, 2> sizes{};
    for (std::size_t i = 0; i < patches.size(); ++i) {
        if (patches[i] == Patch::kCurve) continue;
        const auto& kept = largest[to_size(whole.label[i])];
        const Index mine = parts.label[i];
        if (mine != kept[0] && mine != kept[1] &&
            parts.sizes[to_size(mine)] * 50 < whole.sizes[to_size(whole.label[i])])
            patches[i] = patches[i] == Patch::kLeft ? Patch::kRight : Patch::kLeft;
        ++sizes[to_size(patches[i])];
    }
    return sizes;
}

/// The paths from feature to feature, `rounds` times straightened, as one smooth curve on the cloud
/// and as dense as it.
ClosedCurve traced(const SampledSurface& surface, const KdTree<3>& tree, const CoarseCloud& coarse,
                   std::span<const SurfaceCurve> paths, std::span<const Index> rounds,
                   std::span<const std::string> names, Progress& progress) {
    const auto corners = to_index(paths.size());
    std::vector<SurfaceCurve> parts;
    for (std::size_t k = 0; k < paths.size(); ++k)
        parts.push_back(straightened(resampled(paths[k], coarse.spacing), coarse.tree,
                                     coarse.normals, rounds[k], 1.0, progress));
    ClosedCurve closed = closed_curve(parts);
    uncross(closed, names, surface.name);

    const double spacing = coarse.unit / std::sqrt(static_cast<double>(tree.size()));
    parts.clear();
    for (Index k = 0; k < corners; ++k) {
        const Index begin = closed.corners[to_size(k)];
        const Index end = k + 1 < corners ? closed.corners[to_size(k) + 1] : closed.curve.size();
        SurfaceCurve part{Positions(end - begin + 1, 3), Normals(end - begin + 1, 3)};
        for (Index i = begin; i <= end; ++i) {
            part.points.row(i - begin) = closed.curve.points.row(i % closed.curve.size());
            part.normals.row(i - begin) = closed.curve.normals.row(i % closed.curve.size());
        }
        constexpr Index kRounds = 4;
        parts.push_back(
            straightened(resampled(part, spacing), tree, surface.normals, kRounds, 1.0, progress));
        progress.report(0.6 + 0.1 * (k + 1) / corners);
    }
    closed = closed_curve(parts);
    uncross(closed, names, surface.name);
    return closed;
}

/// Traces the path nearest to a feature again, this time on the feature's other side: it may not
/// cross a path from the feature to the middle of the patch where the feature should be. Returns
/// which path that is. `left` is the result of walk().
Index lead_round(std::vector<SurfaceCurve>& paths, const CoarseCloud& coarse,
                 const Eigen::MatrixXd& from, const ClosedCurve& closed, const Values& left,
                 Index feature, Index corners) {
    constexpr double kBarred = 1000.0, kOther = 50.0;
    const KdTree<3> curve(closed.curve.points);
    const auto path_at = [&](Index place) {
        return to_index(std::ranges::upper_bound(closed.corners, place) - closed.corners.begin()) -
               1;
    };
    const Index nearest = path_at(nearest_on_sheet(
        curve, closed.curve.normals, coarse.positions.row(feature), coarse.normals.row(feature)));
    const Index begin = nearest, end = (nearest + 1) % corners;

    // Other paths are dear, except where this one has to meet them.
    const Index count = coarse.graph.size();
    Values costs = Values::Ones(count);
    for (Index i = 0; i < count; ++i) {
        std::array<Index, 1> place;
        std::array<double, 1> squared;
        if (curve.nearest_within(coarse.positions.row(i).data(), 2.0 * coarse.spacing, place,
                                 squared) == 0 ||
            path_at(place[0]) == nearest)
            continue;
        const double to_end = std::min(from(i, begin), from(i, end)) * coarse.unit;
        costs[i] += kOther * std::min(1.0, to_end / (4.0 * coarse.spacing));
    }
    // The middle of a patch is the point farthest from all of the loop's features.
    const bool to_left = left[feature] <= 0.0;
    Index middle = feature;
    double farthest = -1.0;
    for (Index i = corners; i < count; ++i) {
        if (to_left ? left[i] < 0.5 : left[i] > -0.5) continue;
        double least = kFar;
        for (Index k = 0; k < corners; ++k) least = std::min(least, from(i, k));
        if (least <= farthest) continue;
        farthest = least;
        middle = i;
    }
    const std::vector<Index> bar = cheapest_path(coarse.graph, feature, middle, costs);
    std::vector<char> barred(to_size(count), 0);
    for (const Index i : bar) {
        barred[to_size(i)] = 1;
        for (auto e = coarse.graph.offsets[to_size(i)]; e < coarse.graph.offsets[to_size(i) + 1];
             ++e)
            barred[to_size(coarse.graph.neighbors[to_size(e)])] = 1;
    }
    for (Index i = 0; i < count; ++i)
        if (barred[to_size(i)]) costs[i] += kBarred;
    paths[to_size(nearest)] = curve_of(coarse, cheapest_path(coarse.graph, begin, end, costs));
    return nearest;
}

/// Throws unless almost every point beyond the `corners` belongs clearly to one side of the curve.
void require_two_sides(const Values& left, Index corners, const std::string& name) {
    constexpr double kClear = 0.5, kFew = 0.03;
    const auto undecided = (left.tail(left.size() - corners).array().abs() < kClear).count();
    if (static_cast<double>(undecided) > kFew * static_cast<double>(left.size()))
        throw TopologyError(name, "a loop that divides the surface into two patches",
                            "a path from one side to the other that doesn't cross it",
                            "Run the loop around the whole shape, not through a handle or around a "
                            "limb that touches another. A shape with a handle needs method auto.");
}

/// The first feature beyond the loop that lies on the wrong patch; −1 for none.
Index first_astray(std::span<const Patch> patches, const CutRequest& request) {
    for (std::size_t k = 0; k < request.wanted.size(); ++k) {
        const std::size_t feature = request.loop.size() + k;
        if (request.wanted[k] != Patch::kCurve &&
            patches[to_size(request.features[feature])] != request.wanted[k])
            return to_index(feature);
    }
    return -1;
}

/// Extremities away from all features, of the `most` most prominent ones; rows of the cloud.
UnmarkedExtremities unmarked(const CutGround& ground, Index most) {
    UnmarkedExtremities result;
    const auto& all = ground.extremities;
    for (const Extremity& e : std::span(all).first(std::min(all.size(), to_size(most))))
        if ((ground.from.row(e.point).array() >= kMarked).all()) result.rows.push_back(e.point);
    result.distances = ground.from(result.rows, Eigen::all);
    for (Index& row : result.rows) row = ground.coarse.rows[to_size(row)];
    return result;
}

}  // namespace

Decomposition decompose(const CutGround& given, const CutRequest& request,
                        const DecompositionOptions& options, Progress& progress) {
    std::optional<CutGround> in_order;
    if (!std::ranges::equal(given.features(), request.features))
        in_order.emplace(given, request.features);
    const CutGround& ground = in_order ? *in_order : given;
    const SampledSurface& surface = ground.surface;
    const CoarseCloud& coarse = ground.coarse;
    const Eigen::MatrixXd& from = ground.from;
    const auto corners = to_index(request.loop.size());
    std::vector<SurfaceCurve> paths = guided_paths(coarse, from, corners, options, progress);
    std::vector<Index> rounds(paths.size(), options.straightening);
    Decomposition result;
    std::array<Index, 2> sizes;
    for (Index repairs = 0;; ++repairs) {
        ClosedCurve closed =
            traced(surface, ground.tree, coarse, paths, rounds, request.loop, progress);
        const CurveSides sides(closed.curve);
        const Values left = walk(coarse, sides, corners);
        require_two_sides(left, corners, surface.name);
        {
            const Progress::Part part(progress, 0.75, 0.9);
            result.patches = patches_of(surface, coarse, sides, left, progress);
        }
        for (const Index row : request.features.first(to_size(corners)))
            result.patches[to_size(row)] = Patch::kCurve;
        sizes = clean_up(result.patches, surface.nearest);
        const Index astray = first_astray(result.patches, request);
        constexpr Index kMostRepairs = 4;
        if (astray >= 0 && repairs < kMostRepairs) {
            const Index k = lead_round(paths, coarse, from, closed, left, astray, corners);
            // More straightening would lead the curve back.
            rounds[to_size(k)] = std::min<Index>(options.straightening, 3);
            continue;
        }
        result.curve = std::move(closed.curve);
        result.corners = std::move(closed.corners);
        break;
    }

    const Index smaller = std::min(sizes[0], sizes[1]);
    if (smaller < options.smallest_share * surface.size())
        throw TopologyError(surface.name, "a loop that divides the surface into two patches",
                            "one patch with " + std::to_string(smaller) + " of " +
                                std::to_string(surface.size()) + " points",
                            "Run the loop around the whole shape, such as through the tips of all "
                            "limbs in the order they occur.");

    result.unmarked = unmarked(ground, options.extremities);
    return result;
}

Decomposition decompose(const SampledSurface& surface, const KdTree<3>& tree,
                        const CutRequest& request, const DecompositionOptions& options,
                        Progress& progress) {
    return decompose(CutGround(surface, tree, request.features, options, progress), request,
                     options, progress);
}

FeatureReach feature_reach(const SampledSurface& surface, const KdTree<3>& tree,
                           std::span<const Index> features, const DecompositionOptions& options,
                           Progress& progress) {
    return feature_reach(CutGround(surface, tree, features, options, progress));
}

std::vector<Index> propose_loop(const FeatureReach& source, const FeatureReach& target) {
    const auto count = to_index(source.at_extremity.size());
    std::vector<Index> chosen;
    for (int needed = 2; needed >= 0 && chosen.size() < 3; --needed) {
        chosen.clear();
        for (Index k = 0; k < count; ++k)
            if (source.at_extremity[to_size(k)] + target.at_extremity[to_size(k)] >= needed)
                chosen.push_back(k);
    }
    const Eigen::MatrixXd lengths = source.distances + target.distances;
    // Cheapest insertion, then 2-opt: parts are reversed while that shortens the tour.
    std::vector<Index> tour;
    for (const Index k : chosen) {
        std::size_t best = 0;
        double least = kFar;
        for (std::size_t i = 0; i < tour.size(); ++i) {
            const Index a = tour[i], b = tour[(i + 1) % tour.size()];
            const double longer = lengths(a, k) + lengths(k, b) - lengths(a, b);
            if (longer < least) {
                least = longer;
                best = i + 1;
            }
        }
        tour.insert(tour.begin() + static_cast<std::ptrdiff_t>(best), k);
    }
    const std::size_t size = tour.size();
    for (bool better = true; better;) {
        better = false;
        for (std::size_t i = 0; i + 2 < size; ++i)
            for (std::size_t j = i + 2; j < size; ++j) {
                const Index a = tour[i], b = tour[i + 1], c = tour[j], d = tour[(j + 1) % size];
                if (a == d) continue;
                if (lengths(a, c) + lengths(b, d) < lengths(a, b) + lengths(c, d) - 1e-9) {
                    std::reverse(tour.begin() + static_cast<std::ptrdiff_t>(i + 1),
                                 tour.begin() + static_cast<std::ptrdiff_t>(j + 1));
                    better = true;
                }
            }
    }
    if (!tour.empty()) std::ranges::rotate(tour, std::ranges::min_element(tour));
    return tour;
}

}  // namespace pointmorph

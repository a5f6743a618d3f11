#include "disk/network_surface.hpp"

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <utility>

#include "base/angle.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

namespace {

constexpr double kUnreached = std::numeric_limits<double>::infinity();
/// Length in √area over which curves keep each other away.
constexpr double kCurveRepulsion = 0.03;

double longest_edge(const Positions& points) {
    double longest = 0.0;
    for (Eigen::Index i = 1; i < points.rows(); ++i)
        longest = std::max(longest, (points.row(i) - points.row(i - 1)).norm());
    return longest;
}

double modulo(double angle) {
    return angle - kTurn * std::floor(angle / kTurn);
}

}  // namespace

Wall::Wall(SurfaceCurve curve)
    : curve_(std::move(curve)), tree_(curve_.points), longest_(longest_edge(curve_.points)) {}

bool Wall::is_crossed(const Eigen::RowVector3d& p, const Eigen::RowVector3d& q,
                      const Eigen::RowVector3d& normal) const {
    const Eigen::RowVector3d middle = 0.5 * (p + q);
    const double reach = 0.5 * (q - p).norm() + longest_;
    if (!tree_.any_within(middle.data(), reach)) return false;
    std::vector<std::pair<Index, double>> ball;
    tree_.within(middle.data(), reach, ball);
    const Vector3 up = normal.transpose().normalized();
    for (const auto& [i, squared] : ball) {
        if (curve_.normals.row(i).dot(normal) <= 0.0) continue;
        for (const Index k : {i - 1, i}) {
            if (k < 0 || k + 1 >= curve_.size()) continue;
            const auto first = curve_.points.row(k), second = curve_.points.row(k + 1);
            if (first == p || first == q || second == p || second == q) continue;
            if (edges_cross(p, q, first, second, up)) return true;
        }
    }
    return false;
}

bool Wall::is_crossed(const SurfaceCurve& other) const {
    for (Index i = 0; i + 1 < other.size(); ++i)
        if (is_crossed(other.points.row(i), other.points.row(i + 1),
                       other.normals.row(i) + other.normals.row(i + 1)))
            return true;
    return false;
}

CoarseModel::CoarseModel(const NetworkShape& shape, const DecompositionOptions& options,
                         Progress& progress)
    : cloud(shape.surface, shape.tree, shape.features, options.points, progress) {
    // At the smallest scale gaps in the sampling count as handles, at the largest thin handles are
    // lost.
    constexpr std::array<double, 6> kScales{0.0, 0.6, 0.9, 1.2, 1.6, 2.2};
    for (const double scale : kScales) {
        progress.throw_if_cancelled();
        scales.push_back(loop_classes(cloud.graph, scale * cloud.spacing));
    }
}

NetworkSurface::NetworkSurface(const NetworkShape& shape, const CoarseModel& model,
                               const DecompositionOptions& options)
    : shape_(shape),
      options_(options),
      model_(model),
      coarse_(model.cloud),
      corners_(to_index(shape.features.size())),
      closed_(coarse_.rows.size(), 0),
      costs_(Values::Ones(coarse_.graph.size())),
      spokes_(shape.features.size()) {
    const SurfaceGraph& graph = coarse_.graph;
    links_.resize(to_size(graph.size()));
    for (Index i = 0; i < graph.size(); ++i)
        for (auto e = to_size(graph.offsets[to_size(i)]);
             e < to_size(graph.offsets[to_size(i) + 1]); ++e)
            links_[to_size(i)].push_back({graph.neighbors[e], graph.lengths[e]});
    for (Index k = 0; k < corners_; ++k) {
        const Vector3 normal = coarse_.normals.row(k).transpose();
        const Vector3 x = normal.unitOrthogonal();
        frames_.push_back({x, normal.cross(x)});
    }
}

void NetworkSurface::take_rank(Index rank) {
    const LoopClasses& classes = *std::ranges::find(model_.scales, rank, &LoopClasses::rank);
    rank_ = rank;
    for (Index i = 0; i < coarse_.graph.size(); ++i)
        for (std::size_t k = 0; k < links_[to_size(i)].size(); ++k)
            links_[to_size(i)][k].bits =
                classes.bits[to_size(coarse_.graph.offsets[to_size(i)]) + k];
}

std::vector<Dart> NetworkSurface::darts(Index corner) const {
    std::vector<Dart> result;
    for (const Spoke& spoke : spokes_[to_size(corner)]) result.push_back(spoke.dart);
    return result;
}

std::vector<Sector> NetworkSurface::sectors(Index corner) const {
    if (spokes_[to_size(corner)].empty()) return {{corner, -1}};
    std::vector<Sector> result;
    for (const Dart dart : darts(corner)) result.push_back({corner, dart});
    return result;
}

double NetworkSurface::angle(Index corner, const Eigen::RowVector3d& place) const {
    const Vector3 offset = (place - coarse_.positions.row(corner)).transpose();
    const auto& [x, y] = frames_[to_size(corner)];
    return modulo(angle_of(offset.dot(y), offset.dot(x)));
}

double NetworkSurface::leaving_angle(Index corner, const SurfaceCurve& curve, bool from_end) const {
    // Far enough for a direction, near enough to lie in the corner's plane.
    const double goal = std::min(1.5 * coarse_.spacing, 0.5 * curve_length(curve.points));
    double passed = 0.0;
    Index i = 0;
    const auto place = [&](Index k) { return from_end ? curve.size() - 1 - k : k; };
    while (i + 1 < curve.size() && passed < goal) {
        passed += (curve.points.row(place(i + 1)) - curve.points.row(place(i))).norm();
        ++i;
    }
    return angle(corner, curve.points.row(place(i)));
}

NetworkSurface::Opening NetworkSurface::opening(const Sector& sector) const {
    const auto& spokes = spokes_[to_size(sector.corner)];
    if (sector.dart < 0) return {0.0, kTurn};
    const auto here = std::ranges::find(spokes, sector.dart, &Spoke::dart);
    const auto next = here + 1 == spokes.end() ? spokes.begin() : here + 1;
    const double width = modulo(next->angle - here->angle);
    return {here->angle, spokes.size() == 1 ? kTurn : width};
}

bool NetworkSurface::is_within(const Sector& sector, double angle, double margin) const {
    if (sector.dart < 0) return true;
    const auto [start, width] = opening(sector);
    const double inside = modulo(angle - start);
    return inside > margin && inside < width - margin;
}

std::vector<const NetworkSurface::Link*> NetworkSurface::links_of(const Sector& sector) const {
    constexpr double kMargin = 0.25, kShare = 0.2;  // radians; of the opening
    const double margin = std::min(kMargin, kShare * opening(sector).width);
    std::vector<const Link*> result;
    for (const Link& link : links_[to_size(sector.corner)])
        if (!link.barred && !closed_[to_size(link.to)] && link.to >= corners_ &&
            is_within(sector, angle(sector.corner, coarse_.positions.row(link.to)), margin))
            result.push_back(&link);
    return result;
}

/// Dijkstra's search over the surface's covering with a sheet for each class of paths round the
/// handles: its places are nodes and classes together.
class NetworkSurface::PathSearch {
public:
    PathSearch(const NetworkSurface& surface, std::span<const Sector> goals, bool classes)
        : surface_(surface),
          goals_(goals),
          sheets_(classes ? std::uint32_t{1} << surface.rank_ : 1),
          mask_(sheets_ - 1),
          words_((sheets_ + 63) / 64),
          distance_(surface.links_.size() * sheets_, kUnreached),
          before_(distance_.size(), -1),
          goals_at_(surface.links_.size()),
          reached_(goals.size() * words_, 0),
          classes_reached_(goals.size(), 0) {
        for (std::size_t g = 0; g < goals.size(); ++g) {
            goal_links_.push_back(surface.links_of(goals[g]));
            for (const Link* link : goal_links_[g])
                goals_at_[to_size(link->to)].push_back(to_index(g));
        }
    }

    /// Ends when every goal can be reached by `kMost` classes of paths.
    void run(const Sector& from) {
        std::size_t left =
            to_size(std::ranges::count_if(goal_links_, [](const auto& l) { return !l.empty(); }));
        for (const Link* link : surface_.links_of(from))
            reach(place_of(link->to, link->bits), link->length * surface_.costs_[link->to], -1);
        while (!queue_.empty() && left > 0) {
            std::ranges::pop_heap(queue_, kLater);
            const auto [so_far, place] = queue_.back();
            queue_.pop_back();
            if (so_far > distance_[place]) continue;
            const auto node = to_index(place / sheets_);
            const auto bits = static_cast<std::uint32_t>(place % sheets_);
            left -= arrive(node, bits);
            for (const Link& link : surface_.links_[to_size(node)]) {
                if (link.barred || surface_.closed_[to_size(link.to)] ||
                    link.to < surface_.corners_)
                    continue;
                reach(
                    place_of(link.to, bits ^ link.bits),
                    so_far + link.length * 0.5 * (surface_.costs_[node] + surface_.costs_[link.to]),
                    static_cast<std::int64_t>(place));
            }
        }
    }

    /// The cheapest path of each of the best classes from `from` to a goal, after run(from).
    std::vector<CoarsePath> found(const Sector& from, std::size_t goal) const {
        std::vector<double> least(sheets_, kUnreached);
        std::vector<std::size_t> last(sheets_, 0);
        for (const Link* link : goal_links_[goal])
            for (std::uint32_t bits = 0; bits < sheets_; ++bits) {
                const std::size_t place = place_of(link->to, bits);
                const double through = distance_[place] + link->length * surface_.costs_[link->to];
                const std::uint32_t there = (bits ^ link->bits) & mask_;
                if (through >= least[there]) continue;
                least[there] = through;
                last[there] = place;
            }
        std::vector<std::pair<double, std::uint32_t>> order;
        for (std::uint32_t bits = 0; bits < sheets_; ++bits)
            if (least[bits] < kUnreached) order.emplace_back(least[bits], bits);
        std::ranges::sort(order);
        if (order.size() > kMost) order.resize(kMost);
        std::vector<CoarsePath> paths;
        for (const auto& [cost, bits] : order) {
            CoarsePath path = path_to(from.corner, goals_[goal].corner, last[bits]);
            path.bits = bits;
            // The same node on two sheets: the path crosses itself.
            std::vector<Index> sorted = path.nodes;
            std::ranges::sort(sorted);
            if (std::ranges::adjacent_find(sorted) == sorted.end())
                paths.push_back(std::move(path));
        }
        return paths;
    }

private:
    using Entry = std::pair<double, std::size_t>;
    static constexpr std::size_t kMost = 4;
    static constexpr auto kLater = std::greater<Entry>();

    std::size_t place_of(Index node, std::uint32_t bits) const {
        return to_size(node) * sheets_ + (bits & mask_);
    }

    void reach(std::size_t place, double through, std::int64_t origin) {
        if (through >= distance_[place]) return;
        distance_[place] = through;
        before_[place] = origin;
        queue_.emplace_back(through, place);
        std::ranges::push_heap(queue_, kLater);
    }

    /// Notes which goals a node leads to; how many of these need no more classes of paths.
    std::size_t arrive(Index node, std::uint32_t bits) {
        std::size_t done = 0;
        for (const Index g : goals_at_[to_size(node)]) {
            const Link& link = **std::ranges::find(goal_links_[to_size(g)], node, &Link::to);
            const std::uint32_t there = (bits ^ link.bits) & mask_;
            std::uint64_t& word = reached_[to_size(g) * words_ + there / 64];
            if ((word >> (there % 64)) & 1) continue;
            word |= std::uint64_t{1} << (there % 64);
            if (++classes_reached_[to_size(g)] == std::min<std::size_t>(kMost, sheets_)) ++done;
        }
        return done;
    }

    CoarsePath path_to(Index start, Index end, std::size_t last) const {
        const CoarseCloud& coarse = surface_.coarse_;
        CoarsePath path;
        path.nodes.push_back(end);
        for (auto place = static_cast<std::int64_t>(last); place >= 0;
             place = before_[to_size(place)])
            path.nodes.push_back(to_index(place / sheets_));
        path.nodes.push_back(start);
        std::ranges::reverse(path.nodes);
        for (std::size_t k = 1; k < path.nodes.size(); ++k)
            path.length +=
                (coarse.positions.row(path.nodes[k]) - coarse.positions.row(path.nodes[k - 1]))
                    .norm();
        path.length /= coarse.unit;
        return path;
    }

    const NetworkSurface& surface_;
    std::span<const Sector> goals_;
    std::uint32_t sheets_, mask_;
    std::size_t words_;  ///< of 64 classes, a goal
    std::vector<double> distance_;
    std::vector<std::int64_t> before_;
    std::vector<Entry> queue_;
    std::vector<std::vector<const Link*>> goal_links_;
    std::vector<std::vector<Index>> goals_at_;  ///< by node
    std::vector<std::uint64_t> reached_;        ///< a bit for each goal and class
    std::vector<std::size_t> classes_reached_;  ///< by goal
};

std::vector<std::vector<CoarsePath>> NetworkSurface::paths(const Sector& from,
                                                           std::span<const Sector> to,
                                                           bool classes) const {
    PathSearch search(*this, to, classes);
    search.run(from);
    std::vector<std::vector<CoarsePath>> result;
    for (std::size_t goal = 0; goal < to.size(); ++goal) result.push_back(search.found(from, goal));
    return result;
}

std::optional<SurfaceCurve> NetworkSurface::traced(const CoarsePath& path, const Sector& from,
                                                   const Sector& to, Progress& progress) const {
    const SurfaceCurve coarse{gather(coarse_.positions, path.nodes),
                              gather(coarse_.normals, path.nodes)};
    const double spacing = coarse_.unit / std::sqrt(static_cast<double>(shape_.tree.size()));
    constexpr double kMargin = 0.05;  // radians
    constexpr Index kDense = 4;
    for (const Index rounds : {options_.straightening, options_.straightening / 3, Index{0}}) {
        SurfaceCurve curve = straightened(resampled(coarse, coarse_.spacing), coarse_.tree,
                                          coarse_.normals, rounds, 1.0, progress);
        curve = straightened(resampled(curve, spacing), shape_.tree, shape_.surface.normals,
                             std::min(rounds, kDense), 1.0, progress);
        if (!is_within(from, leaving_angle(from.corner, curve, false), kMargin) ||
            !is_within(to, leaving_angle(to.corner, curve, true), kMargin))
            continue;
        if (std::ranges::any_of(walls_, [&](const Wall& w) { return w.is_crossed(curve); }))
            continue;
        const Wall itself(curve);
        if (!itself.is_crossed(curve)) return curve;
    }
    return std::nullopt;
}

void NetworkSurface::add(SurfaceCurve curve, const Sector& from, const Sector& to) {
    const Dart dart = 2 * static_cast<Dart>(walls_.size());
    const auto insert = [&](const Sector& sector, Dart leaving, double angle) {
        auto& spokes = spokes_[to_size(sector.corner)];
        const auto before = std::ranges::find(spokes, sector.dart, &Spoke::dart);
        spokes.insert(before == spokes.end() ? before : before + 1, {leaving, angle});
    };
    insert(from, dart, leaving_angle(from.corner, curve, false));
    insert(to, dart + 1, leaving_angle(to.corner, curve, true));
    const Wall& wall = walls_.emplace_back(std::move(curve));

    constexpr double kOnIt = 0.2;  // of the coarse points' spacing
    const double scale = kCurveRepulsion * coarse_.unit;
    for (Index i = 0; i < coarse_.graph.size(); ++i) {
        const Eigen::RowVector3d here = coarse_.positions.row(i);
        Index nearest;
        double squared;
        wall.tree().nearest(here.data(), {&nearest, 1}, {&squared, 1});
        const double distance = std::sqrt(squared);
        if (wall.curve().normals.row(nearest).dot(coarse_.normals.row(i)) <= 0.0) continue;
        if (i >= corners_ && distance < kOnIt * coarse_.spacing) closed_[to_size(i)] = 1;
        if (distance < 3.0 * scale) {
            // Curves meet at their ends, which must not push the next one away.
            const double end = std::min((here - coarse_.positions.row(from.corner)).norm(),
                                        (here - coarse_.positions.row(to.corner)).norm());
            costs_[i] += options_.repulsion * std::exp(-squared / (scale * scale)) *
                         std::min(1.0, end / (2.0 * scale));
        }
    }
    for (Index i = 0; i < coarse_.graph.size(); ++i)
        for (Link& link : links_[to_size(i)]) {
            if (link.to < i || link.barred) continue;
            link.barred = wall.is_crossed(coarse_.positions.row(i), coarse_.positions.row(link.to),
                                          coarse_.normals.row(i) + coarse_.normals.row(link.to));
            if (link.barred)
                std::ranges::find(links_[to_size(link.to)], i, &Link::to)->barred = true;
        }
}

std::optional<Index> NetworkSurface::face_next_to(const Eigen::RowVector3d& point,
                                                  const Eigen::RowVector3d& normal, double reach,
                                                  std::span<const Index> face) const {
    double best = reach * reach;
    std::optional<Index> found;
    for (std::size_t w = 0; w < walls_.size(); ++w) {
        const SurfaceCurve& curve = walls_[w].curve();
        std::array<Index, 6> near;
        std::array<double, 6> squared;
        const auto count = to_size(
            walls_[w].tree().nearest_within(point.data(), std::sqrt(best) * 1.5, near, squared));
        for (std::size_t k = 0; k < count; ++k) {
            const Index c = near[k];
            if (curve.normals.row(c).dot(normal) <= 0.0) continue;
            for (const Index a : {c - 1, c}) {
                if (a < 0 || a + 1 >= curve.size()) continue;
                const Eigen::RowVector3d edge = curve.points.row(a + 1) - curve.points.row(a);
                const double length = edge.squaredNorm();
                if (!(length > 0.0)) continue;
                const double along =
                    std::clamp((point - curve.points.row(a)).dot(edge) / length, 0.0, 1.0);
                const Eigen::RowVector3d offset = point - curve.points.row(a) - along * edge;
                if (offset.squaredNorm() >= best) continue;
                best = offset.squaredNorm();
                const bool at_start = a == 0 && along <= 0.0;
                const bool at_end = a + 2 == curve.size() && along >= 1.0;
                if (at_start || at_end) {
                    // Nearest to a corner: the sector that it lies in.
                    const Dart dart = 2 * static_cast<Dart>(w) + (at_end ? 1 : 0);
                    Index corner = 0;
                    while (std::ranges::find(spokes_[to_size(corner)], dart, &Spoke::dart) ==
                           spokes_[to_size(corner)].end())
                        ++corner;
                    const double direction = angle(corner, point);
                    const Spoke* opening = &spokes_[to_size(corner)].front();
                    for (const Spoke& spoke : spokes_[to_size(corner)])
                        if (modulo(direction - spoke.angle) < modulo(direction - opening->angle))
                            opening = &spoke;
                    found = face[to_size(opening->dart)];
                    continue;
                }
                const auto across = [&](Index from) -> Eigen::RowVector3d {
                    const Eigen::RowVector3d step =
                        curve.points.row(from + 1) - curve.points.row(from);
                    const Eigen::RowVector3d left = curve.normals.row(c).cross(step);
                    return left.norm() > 0.0 ? left.normalized() : left;
                };
                Eigen::RowVector3d left = across(a);
                if (along <= 0.0) left += across(a - 1);
                if (along >= 1.0) left += across(a + 1);
                found = face[2 * w + (left.dot(offset) > 0.0 ? 0 : 1)];
            }
        }
    }
    return found;
}

std::vector<Index> NetworkSurface::labels(std::span<const Index> face, Index patches,
                                          Progress& progress) const {
    // A random walker's chance of meeting each patch's side of the curves first (Grady 2006).
    const Index count = coarse_.graph.size();
    const double reach = 1.2 * coarse_.spacing;
    std::vector<Index> seed(to_size(count), -1), unknown(to_size(count), -1);
    Index unknowns = 0;
    for (Index i = corners_; i < count; ++i) {
        const auto mine =
            face_next_to(coarse_.positions.row(i), coarse_.normals.row(i), reach, face);
        if (mine) seed[to_size(i)] = *mine;
        if (!mine) unknown[to_size(i)] = unknowns++;
    }
    std::vector<Index> node_labels = seed;
    if (unknowns > 0) {
        std::vector<Eigen::Triplet<double>> entries;
        Eigen::MatrixXd sides = Eigen::MatrixXd::Zero(unknowns, patches);
        Values diagonal = Values::Constant(unknowns, 1e-9);
        for (Index i = corners_; i < count; ++i) {
            const Index row = unknown[to_size(i)];
            if (row < 0) continue;
            for (const Link& link : links_[to_size(i)]) {
                if (link.barred || link.to < corners_) continue;
                const double weight = coarse_.spacing / link.length;
                diagonal[row] += weight;
                if (const Index column = unknown[to_size(link.to)]; column >= 0)
                    entries.emplace_back(row, column, -weight);
                else
                    sides(row, seed[to_size(link.to)]) += weight;
            }
        }
        for (Index i = 0; i < unknowns; ++i) entries.emplace_back(i, i, diagonal[i]);
        Eigen::SparseMatrix<double> matrix(unknowns, unknowns);
        matrix.setFromTriplets(entries.begin(), entries.end());
        const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(matrix);
        const Eigen::MatrixXd chances = solver.solve(sides);
        Index doubtful = 0;
        constexpr double kSure = 0.7, kMostDoubtful = 0.03;
        for (Index i = corners_; i < count; ++i) {
            const Index row = unknown[to_size(i)];
            if (row < 0) continue;
            Eigen::Index best = 0;
            if (chances.row(row).maxCoeff(&best) < kSure) ++doubtful;
            node_labels[to_size(i)] = to_index(best);
        }
        if (doubtful > kMostDoubtful * count)
            throw TopologyError(
                shape_.surface.name, "curves that divide the surface into patches",
                std::to_string(doubtful) + " of " + std::to_string(count) +
                    " places in several patches",
                "Mark features around the handles and at the tips of limbs, or use method auto.");
    }
    std::vector<Index> result(to_size(shape_.tree.size()), -1);
    parallel_for(shape_.tree.size(), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const Index cell = coarse_.cells[to_size(i)];
            Index label = node_labels[to_size(cell)];
            if (label < 0 || seed[to_size(cell)] >= 0 || cell < corners_)
                if (const auto mine =
                        face_next_to(shape_.tree.points().row(i), shape_.surface.normals.row(i),
                                     2.0 * reach, face))
                    label = *mine;
            result[to_size(i)] = label;
        }
    });
    for (const Index row : shape_.features) result[to_size(row)] = -1;
    return result;
}

}  // namespace pointmorph

#include "registration/annealing.hpp"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "registration/product_keys.hpp"
#include "registration/rim.hpp"

namespace pointmorph {

namespace {

/// One shape on its way to the other.
struct MovingShape {
    const CoarseShape& shape;
    const DeformationGraph& graph;
    DeformationSolver solver;
    Deformation deformation;
    LocalAreas areas;         ///< of all points, where they count
    std::vector<Index> rows;  ///< coarse rows that are matched in this round, the nodes first
    double area = 0.0;        ///< of `rows`
    DeformedCloud images;     ///< of `rows`
    ProductKeys keys;         ///< of `rows`
    Matches matches;          ///< of `rows`, into the other shape's; kept for the next round
    std::vector<Index> near;  ///< of each node: the other's node next to what it was matched with
    std::vector<double> weights;  ///< of `rows`
    std::vector<char> left_over;  ///< of each node: beyond_rim(); none where the other has no ends
    std::vector<Index> ends;      ///< end_rows()
    std::vector<Attraction> attractions;

    MovingShape(const CoarseShape& s, Index level, const Positions& start, double largest_scale)
        : shape(s), graph(s.levels[to_size(level)]), solver(s.positions, graph) {
        deformation.positions = gather(start, graph.node_rows);
        fit_similarities(s.positions, graph, 2, largest_scale, deformation);
        ends = end_rows(s);
    }
    void choose(std::vector<Index> chosen) {
        rows = std::move(chosen);
        // Where the search may begin: at what the node next to each point was matched with.
        matches.to.clear();
        if (!near.empty())
            for (std::size_t i = 0; i < rows.size(); ++i)
                matches.to.push_back(near[i < near.size() ? i : to_size(node_next_to(rows[i]))]);
        area = 0.0;
        for (const Index i : rows) area += shape.areas[i];
    }
    Index node_next_to(Index row) const { return graph.point_nodes[to_size(row)][0]; }
    void remember(const MovingShape& other) {
        near.resize(to_size(graph.size()));
        for (std::size_t k = 0; k < near.size(); ++k) {
            const Index to = matches.to[k];
            near[k] = to < other.graph.size() ? to : other.node_next_to(other.rows[to_size(to)]);
        }
    }
    void place() { images = deformed(shape.positions, shape.normals, graph, deformation, rows); }

    /// Where its ends have come to.
    Positions rim() const {
        return deformed(shape.positions, shape.normals, graph, deformation, ends).positions;
    }

    /// Where the other's point lies that the i-th of the rows was matched with.
    Positions::ConstRowXpr match(const MovingShape& other, std::size_t i) const {
        return other.shape.positions.row(other.rows[to_size(matches.to[i])]);
    }
};

/// Calls `work` on both shapes, next to each other.
template <std::invocable<MovingShape&, MovingShape&> Work>
void on_both(MovingShape& source, MovingShape& target, Work&& work) {
    parallel_invoke(2, [&](int k, bool) { k == 0 ? work(source, target) : work(target, source); });
}

/// `area_weight`: see RegistrationLevel.
void match(MovingShape& source, MovingShape& target, double normal_weight, double area_weight,
           Progress& progress) {
    on_both(source, target, [&](MovingShape& side, MovingShape&) {
        side.place();
        const OrientedPoints rest{gather(side.shape.positions, side.rows),
                                  gather(side.shape.normals, side.rows)};
        const OrientedView here = oriented(rest), there = oriented(side.images);
        side.keys = {&side == &source ? product_points(there, here, normal_weight)
                                      : product_points(here, there, normal_weight),
                     labels_of(side.shape, side.rows),
                     area_weight > 0.0 ? LocalAreas(area_weight * gather(side.areas, side.rows))
                                       : LocalAreas()};
    });
    match_both_ways(source.keys, target.keys, source.matches, target.matches, progress);
    source.remember(target);
    target.remember(source);
}

/// Takes the weight from parts whose images have jumped.
void ignore_torn(MovingShape& side, const MovingShape& other, double smallest) {
    const auto& graph = side.graph;
    Positions matches(graph.size(), 3);  // the nodes are the first of the rows that are matched
    for (Index k = 0; k < graph.size(); ++k) matches.row(k) = side.match(other, to_size(k));
    const auto keep =
        untorn(graph, {side.deformation.positions, matches}, other.graph.spacing, smallest);
    for (std::size_t i = 0; i < side.rows.size(); ++i) {
        const auto row = to_size(side.rows[i]);
        double share = 0.0;
        for (std::size_t k = 0; k < kNodesPerPoint; ++k)
            share += graph.point_weights[row][k] * keep[to_size(graph.point_nodes[row][k])];
        side.weights[i] *= share;
    }
}

/// What lies beyond the end of the other shape matches the end, however far it is, or, where
/// normals speak against that, anything.
void leave_over(MovingShape& side, const MovingShape& other, bool is_stiff) {
    const auto at_end = [&](std::size_t i) {
        return other.shape.ends[to_size(other.rows[to_size(side.matches.to[i])])];
    };
    side.left_over.assign(to_size(side.graph.size()), 0);
    if (!is_stiff)
        side.left_over = beyond_rim(side.graph, gather(side.shape.positions, side.graph.node_rows),
                                    other.images.positions, other.rim());
    for (std::size_t i = 0; i < side.rows.size(); ++i)
        if (at_end(i) != 0 || side.left_over[to_size(side.node_next_to(side.rows[i]))] != 0)
            side.weights[i] = 0.0;
}

void weigh(MovingShape& side, const MovingShape& other, bool is_stiff,
           const RegistrationOptions& options) {
    side.weights = robust_weights(side.matches.distances, options.outlier_distance);
    if (is_stiff)
        for (double& w : side.weights) w *= options.stiff_data;
    else
        ignore_torn(side, other, options.torn_component);
    if (!other.shape.ends.empty()) leave_over(side, other, is_stiff);
}

/// Takes the weight from matches with what is left over of the other shape.
void let_go(MovingShape& side, const MovingShape& other) {
    if (other.left_over.empty()) return;
    for (std::size_t i = 0; i < side.rows.size(); ++i) {
        const Index row = other.rows[to_size(side.matches.to[i])];
        if (other.left_over[to_size(other.node_next_to(row))] != 0) side.weights[i] = 0.0;
    }
}

/// A region may have to go far: its matches count however far off they are.
void pull_regions(MovingShape& side) {
    if (side.shape.pulls.rows() == 0) return;
    for (std::size_t i = 0; i < side.rows.size(); ++i)
        side.weights[i] += side.shape.pulls[side.rows[i]];
}

/// Pulls to the other shape's guides. A point beside its guide keeps beside it, as far as its
/// surroundings have turned and grown.
void follow_guides(MovingShape& side, const MovingShape& other) {
    const Guides& own = side.shape.guides;
    const Guides& there = other.shape.guides;
    const auto images = deformed(side.shape.positions, side.shape.normals, side.graph,
                                 side.deformation, own.coarse_rows);
    for (Index k = 0; k < own.size(); ++k) {
        if (!(own.weights[k] > 0.0)) continue;
        const Index row = own.coarse_rows[to_size(k)];
        const Vector3 arm = (side.shape.positions.row(row) - own.places.row(k)).transpose();
        side.attractions.push_back(
            {row, own.weights[k],
             there.places.row(k).transpose() + images.linear[to_size(k)] * arm});
    }
}

/// Pulls to own matches, to the points that matched one of ours, to features and guides. `reverse`
/// on the target. What pulls at one point pulls at once.
void attract(MovingShape& side, const MovingShape& other, std::span<const IndexPair> features,
             bool reverse, double feature_weight) {
    side.attractions.clear();
    for (std::size_t i = 0; i < side.rows.size(); ++i) {
        const double weight = side.weights[i] * side.shape.areas[side.rows[i]] / side.area;
        side.attractions.push_back(
            {side.rows[i], weight, weight * side.match(other, i).transpose()});
    }
    for (std::size_t j = 0; j < other.rows.size(); ++j) {
        const double weight = other.weights[j] * other.shape.areas[other.rows[j]] / other.area;
        Attraction& pulled = side.attractions[to_size(other.matches.to[j])];
        pulled.weight += weight;
        pulled.target += weight * other.shape.positions.row(other.rows[j]).transpose();
    }
    std::erase_if(side.attractions, [](const Attraction& a) { return !(a.weight > 0.0); });
    for (Attraction& a : side.attractions) a.target /= a.weight;
    for (const IndexPair& f : features)
        side.attractions.push_back(
            {reverse ? f.target : f.source, feature_weight,
             other.shape.positions.row(reverse ? f.source : f.target).transpose()});
    follow_guides(side, other);
}

void update(MovingShape& side, const AnnealingRound& round, int solves, double largest_scale) {
    side.solver.factorize(round.stiffness, side.attractions);
    for (int k = 0; k < solves; ++k) {
        side.solver.solve(side.attractions, side.deformation);
        fit_similarities(side.shape.positions, side.graph, round.smoothing, largest_scale,
                         side.deformation);
    }
}

Registration result_of(const MovingShape& source, const MovingShape& target) {
    const auto points = [](const MovingShape& side) {
        return deformed(side.shape.positions, side.shape.normals, side.graph, side.deformation);
    };
    DeformedCloud source_points = points(source), target_points = points(target);
    return {source.deformation, target.deformation, std::move(source_points),
            std::move(target_points)};
}

}  // namespace

struct AnnealingRun::Impl {
    const Annealing annealing;
    MovingShape source, target;
    std::mt19937_64 random;
    int done = 0;

    Impl(const Annealing& a, const RegistrationStart& start, const std::mt19937_64& r)
        : annealing(a),
          source(a.shapes.source, a.level, start.source, a.options.largest_scale),
          target(a.shapes.target, a.level, start.target, a.options.largest_scale),
          random(r) {
        Progress silent;  // the sides run next to each other
        if (a.schedule.first_area_weight > 0.0)
            on_both(source, target, [&](MovingShape& side, MovingShape&) {
                side.areas = local_areas(side.shape, silent);
            });
    }

    void next() {
        const auto& [shapes, level, schedule, options] = annealing;
        const AnnealingRound round = annealing_round(schedule, done++, source.graph.size());
        if (round.draws)
            for (MovingShape* side : {&source, &target})
                side->choose(draw_points(
                    side->shape, side->graph,
                    round.matches_all ? side->shape.size() : schedule.matched_points, random));
        Progress silent;
        match(source, target, options.normal_weight, round.area_weight, silent);
        on_both(source, target, [&](MovingShape& side, MovingShape& other) {
            weigh(side, other, round.is_stiff, options);
        });
        let_go(source, target);
        let_go(target, source);
        pull_regions(source);
        pull_regions(target);
        on_both(source, target, [&](MovingShape& side, MovingShape& other) {
            attract(side, other, shapes.features, &side == &target, options.feature_weight);
            update(side, round, schedule.solves, options.largest_scale);
        });
    }
};

AnnealingRun::AnnealingRun(const Annealing& annealing, const RegistrationStart& start,
                           const std::mt19937_64& random)
    : impl_(std::make_unique<Impl>(annealing, start, random)) {}

AnnealingRun::~AnnealingRun() = default;

int AnnealingRun::rounds() const {
    return impl_->annealing.schedule.stiff_rounds + impl_->annealing.schedule.rounds;
}

void AnnealingRun::advance(int count, Progress& progress) {
    for (int k = 0; k < count && impl_->done < rounds(); ++k) {
        impl_->next();
        progress.report(static_cast<double>(impl_->done) / rounds());
    }
}

Registration AnnealingRun::result() const {
    return result_of(impl_->source, impl_->target);
}

const std::mt19937_64& AnnealingRun::random() const {
    return impl_->random;
}

Registration annealed(const Annealing& annealing, const RegistrationStart& start,
                      std::mt19937_64& random, Progress& progress) {
    AnnealingRun run(annealing, start, random);
    run.advance(run.rounds(), progress);
    random = run.random();
    return run.result();
}

AnnealingRound annealing_round(const RegistrationLevel& schedule, int round, Index nodes) {
    const int rounds = schedule.stiff_rounds + schedule.rounds;
    const int first_full = rounds - schedule.full_rounds;
    const bool is_stiff = round < schedule.stiff_rounds;
    const double share =
        is_stiff || schedule.rounds < 2
            ? 0.0
            : static_cast<double>(round - schedule.stiff_rounds) / (schedule.rounds - 1);
    const auto falling = [&](double first, double last) {
        return first * std::pow(last / first, share);
    };
    return {
        .is_stiff = is_stiff,
        .draws = round < first_full || round == 0 || round == first_full,
        .matches_all = round >= first_full,
        .stiffness = falling(schedule.first_stiffness, schedule.last_stiffness) / nodes,
        .smoothing = static_cast<int>(
            std::lround(schedule.first_smoothing +
                        (schedule.last_smoothing - schedule.first_smoothing) * share)),
        .area_weight = schedule.first_area_weight > 0.0
                           ? falling(schedule.first_area_weight, schedule.last_area_weight)
                           : 0.0,
    };
}

std::vector<Index> draw_points(const CoarseShape& shape, const DeformationGraph& graph, Index count,
                               std::mt19937_64& random) {
    std::vector<Index> rows = graph.node_rows;
    std::vector<char> is_node(to_size(shape.size()), 0);
    for (const Index i : rows) is_node[to_size(i)] = 1;
    std::vector<Index> others;
    for (Index i = 0; i < shape.size(); ++i)
        if (!is_node[to_size(i)]) others.push_back(i);
    const auto more = std::min<std::size_t>(
        others.size(), to_size(std::max<Index>(0, count - to_index(rows.size()))));
    if (more == others.size()) {
        random.discard(more);  // as if they were drawn
        rows.insert(rows.end(), others.begin(), others.end());
        return rows;
    }
    std::vector<char> is_drawn(to_size(shape.size()), 0);
    for (std::size_t i = 0; i < more; ++i) {
        std::swap(others[i], others[i + random() % (others.size() - i)]);
        is_drawn[to_size(others[i])] = 1;
    }
    for (Index i = 0; i < shape.size(); ++i)  // as they lie in memory
        if (is_drawn[to_size(i)]) rows.push_back(i);
    return rows;
}

std::vector<double> robust_weights(const std::vector<double>& distances, double medians) {
    std::vector<double> sorted = distances;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::ranges::nth_element(sorted, middle);
    const double scale = medians * (*middle + 1e-9);
    std::vector<double> weights;
    weights.reserve(distances.size());
    for (const double d : distances) weights.push_back(1.0 / (1.0 + d * d / (scale * scale)));
    return weights;
}

std::vector<double> untorn(const DeformationGraph& graph, const MatchedNodes& nodes, double spacing,
                           double smallest) {
    const Index count = graph.size();
    const auto is_torn = [&](Index i, Index j) {
        return (nodes.matches.row(i) - nodes.matches.row(j)).norm() >=
               2.0 * (nodes.positions.row(i) - nodes.positions.row(j)).norm() + 2.0 * spacing;
    };
    std::vector<Index> component(to_size(count), -1);
    std::vector<Index> sizes;
    for (Index start = 0; start < count; ++start) {
        if (component[to_size(start)] >= 0) continue;
        const auto label = to_index(sizes.size());
        sizes.push_back(0);
        std::vector<Index> open{start};
        component[to_size(start)] = label;
        while (!open.empty()) {
            const Index i = open.back();
            open.pop_back();
            ++sizes.back();
            for (auto e = to_size(graph.edge_offsets[to_size(i)]);
                 e < to_size(graph.edge_offsets[to_size(i) + 1]); ++e) {
                const Index j = graph.edge_ends[e];
                if (component[to_size(j)] >= 0 || is_torn(i, j)) continue;
                component[to_size(j)] = label;
                open.push_back(j);
            }
        }
    }
    std::vector<double> result(to_size(count));
    for (Index i = 0; i < count; ++i)
        result[to_size(i)] = sizes[to_size(component[to_size(i)])] >= smallest * count ? 1.0 : 0.0;
    return result;
}

}  // namespace pointmorph

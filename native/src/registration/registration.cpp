#include "pointmorph/registration/registration.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <numeric>
#include <optional>
#include <random>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/registration/product_space.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

namespace {

/// The thin plate in space, |r|, through from → to, smoothed a little.
class ThinPlate {
public:
    ThinPlate(const Positions& from, const Positions& to) : from_(from) {
        constexpr double kRegularization = 1e-2;
        const auto n = from.rows();
        Eigen::MatrixXd system = Eigen::MatrixXd::Zero(n + 4, n + 4);
        for (Eigen::Index i = 0; i < n; ++i) {
            for (Eigen::Index j = 0; j < n; ++j) system(i, j) = -(from.row(i) - from.row(j)).norm();
            system(i, i) -= kRegularization;
            system(i, n) = system(n, i) = 1.0;
            system.block<1, 3>(i, n + 1) = from.row(i);
            system.block<3, 1>(n + 1, i) = from.row(i).transpose();
        }
        Eigen::MatrixXd right = Eigen::MatrixXd::Zero(n + 4, 3);
        // Displacements: what the places leave open (all in one plane) stays as it is.
        right.topRows(n) = to - from;
        coefficients_ = system.fullPivLu().solve(right);
    }

    Eigen::RowVector3d operator()(const Eigen::RowVector3d& p) const {
        const auto n = from_.rows();
        Eigen::RowVector3d x = p + coefficients_.row(n) + p * coefficients_.bottomRows<3>();
        for (Eigen::Index i = 0; i < n; ++i) x -= (p - from_.row(i)).norm() * coefficients_.row(i);
        return x;
    }

private:
    Positions from_;
    Eigen::MatrixXd coefficients_;
};

/// `count` rows: the nodes, then others drawn at random.
std::vector<Index> draw_points(const CoarseShape& shape, const DeformationGraph& graph, Index count,
                               std::mt19937_64& random) {
    std::vector<Index> rows = graph.nodes;
    std::vector<char> is_node(to_size(shape.size()), 0);
    for (const Index i : rows) is_node[to_size(i)] = 1;
    std::vector<Index> others;
    for (Index i = 0; i < shape.size(); ++i)
        if (!is_node[to_size(i)]) others.push_back(i);
    const auto more = std::min<std::size_t>(
        others.size(), to_size(std::max<Index>(0, count - static_cast<Index>(rows.size()))));
    for (std::size_t i = 0; i < more; ++i)
        std::swap(others[i], others[i + random() % (others.size() - i)]);
    const auto end = others.begin() + static_cast<std::ptrdiff_t>(more);
    std::sort(others.begin(), end);  // as they lie in memory
    rows.insert(rows.end(), others.begin(), end);
    return rows;
}

/// 1/(1 + (d/(k · median))²).
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

/// 1 for nodes in big pieces of the node graph cut where the images jump, else 0.
std::vector<double> untorn(const DeformationGraph& graph, const Positions& deformed,
                           const Positions& images, double image_spacing, double smallest_piece) {
    const Index count = graph.size();
    std::vector<Index> piece(to_size(count), -1);
    std::vector<Index> sizes;
    for (Index start = 0; start < count; ++start) {
        if (piece[to_size(start)] >= 0) continue;
        const auto label = static_cast<Index>(sizes.size());
        sizes.push_back(0);
        std::vector<Index> open{start};
        piece[to_size(start)] = label;
        while (!open.empty()) {
            const Index i = open.back();
            open.pop_back();
            ++sizes.back();
            for (auto e = to_size(graph.edge_offsets[to_size(i)]);
                 e < to_size(graph.edge_offsets[to_size(i) + 1]); ++e) {
                const Index j = graph.edge_ends[e];
                if (piece[to_size(j)] >= 0 ||
                    (images.row(i) - images.row(j)).norm() >=
                        2.0 * (deformed.row(i) - deformed.row(j)).norm() + 2.0 * image_spacing)
                    continue;
                piece[to_size(j)] = label;
                open.push_back(j);
            }
        }
    }
    std::vector<double> result(to_size(count));
    for (Index i = 0; i < count; ++i)
        result[to_size(i)] =
            sizes[to_size(piece[to_size(i)])] >= smallest_piece * count ? 1.0 : 0.0;
    return result;
}

/// Points in the product space, with their labels where there are regions, and with local areas
/// where they count.
struct Keys {
    ProductPoints plain;  ///< empty where there are labels or areas
    LabelledPoints labelled;

    Keys() = default;
    /// `labels` and `areas` have a row a point, or none.
    Keys(ProductPoints points, const Labels& labels, const LocalAreas& areas = LocalAreas()) {
        if (labels.rows() == 0 && areas.rows() == 0) {
            plain = std::move(points);
            return;
        }
        labelled = labelled_points(points, labels, areas);
    }
};

/// Keys to search; they must outlive it.
class KeyTree {
public:
    explicit KeyTree(const Keys& keys) {
        if (keys.labelled.rows() == 0)
            plain_.emplace(keys.plain);
        else
            labelled_.emplace(keys.labelled);
    }

    Matches nearest(const Keys& keys, Progress& progress, const Matches* guess = nullptr) const {
        return labelled_ ? nearest_matches<32>(keys.labelled, *labelled_, progress, guess)
                         : nearest_matches<12>(keys.plain, *plain_, progress, guess);
    }

private:
    std::optional<KdTree<12>> plain_;
    std::optional<KdTree<32>> labelled_;
};

/// Labels of some points; none where there are none.
Labels labels_of(const CoarseShape& shape, std::span<const Index> rows) {
    return shape.labels.rows() == 0 ? Labels() : gather(shape.labels, rows);
}

/// One shape on its way to the other.
struct Side {
    const CoarseShape& shape;
    const DeformationGraph& graph;
    DeformationSolver solver;
    Deformation deformation;
    std::vector<Index> rows;      ///< matched in this round, the nodes first
    double area = 0.0;            ///< of `rows`
    DeformedCloud images;         ///< of `rows`
    Keys keys;                    ///< of `rows`
    Matches matches;              ///< of `rows`, into the other side's
    std::vector<double> weights;  ///< of `rows`
    std::vector<Attraction> attractions;
    LocalAreas areas;  ///< of all points, where they count

    Side(const CoarseShape& s, Index level, const Positions& start,
         const RegistrationOptions& options)
        : shape(s), graph(s.levels[to_size(level)]), solver(s.positions, graph) {
        deformation.positions = gather(start, graph.nodes);
        fit_similarities(s.positions, graph, 2, options.largest_scale, deformation);
    }
    void choose(std::vector<Index> chosen) {
        rows = std::move(chosen);
        matches = {};
        area = 0.0;
        for (const Index i : rows) area += shape.areas[i];
        place();
    }
    void place() { images = deformed(shape.positions, shape.normals, graph, deformation, rows); }
};

/// Calls `work` on both sides, next to each other.
template <std::invocable<Side&, Side&> Work>
void on_both(Side& source, Side& target, Work&& work) {
    parallel_invoke(2, [&](int k, bool) { k == 0 ? work(source, target) : work(target, source); });
}

/// `area_weight`: see RegistrationLevel.
void match(Side& source, Side& target, double normal_weight, double area_weight,
           Progress& progress) {
    std::optional<KeyTree> source_tree, target_tree;
    on_both(source, target, [&](Side& side, Side&) {
        const Positions positions = gather(side.shape.positions, side.rows);
        const Normals normals = gather(side.shape.normals, side.rows);
        side.keys = {&side == &source ? product_points(side.images.positions, positions,
                                                       side.images.normals, normals, normal_weight)
                                      : product_points(positions, side.images.positions, normals,
                                                       side.images.normals, normal_weight),
                     labels_of(side.shape, side.rows),
                     area_weight > 0.0 ? LocalAreas(area_weight * gather(side.areas, side.rows))
                                       : LocalAreas()};
        (&side == &source ? source_tree : target_tree).emplace(side.keys);
    });
    const bool again = !source.matches.to.empty();
    source.matches = target_tree->nearest(source.keys, progress, again ? &source.matches : nullptr);
    target.matches = source_tree->nearest(target.keys, progress, again ? &target.matches : nullptr);
}

/// Takes the weight from pieces whose images have jumped.
void ignore_torn(Side& side, const Side& other, double smallest_piece) {
    const auto& graph = side.graph;
    Positions images(graph.size(), 3);  // the nodes are the first of the rows that are matched
    for (Index k = 0; k < graph.size(); ++k)
        images.row(k) = other.shape.positions.row(other.rows[to_size(side.matches.to[to_size(k)])]);
    const auto keep =
        untorn(graph, side.deformation.positions, images, other.graph.spacing, smallest_piece);
    for (std::size_t i = 0; i < side.rows.size(); ++i) {
        const auto row = to_size(side.rows[i]);
        double share = 0.0;
        for (std::size_t k = 0; k < kNodesPerPoint; ++k)
            share += graph.point_weights[row][k] * keep[to_size(graph.point_nodes[row][k])];
        side.weights[i] *= share;
    }
}

/// Pulls to the other shape's guides. A point beside its guide keeps beside it, as far as its
/// surroundings have turned and grown.
void follow_guides(Side& side, const Side& other) {
    const Guides& own = side.shape.guides;
    const Guides& there = other.shape.guides;
    const auto moved =
        deformed(side.shape.positions, side.shape.normals, side.graph, side.deformation, own.rows);
    for (Index k = 0; k < own.size(); ++k) {
        if (!(own.weights[k] > 0.0)) continue;
        const Vector3 arm =
            (side.shape.positions.row(own.rows[to_size(k)]) - own.places.row(k)).transpose();
        side.attractions.push_back(
            {own.rows[to_size(k)], own.weights[k],
             there.places.row(k).transpose() + moved.linear[to_size(k)] * arm});
    }
}

/// Pulls to own matches, to the points that matched one of ours, to features and guides.
void attract(Side& side, const Side& other, std::span<const IndexPair> features, bool reverse,
             double feature_weight) {
    side.attractions.clear();
    for (std::size_t i = 0; i < side.rows.size(); ++i)
        side.attractions.push_back(
            {side.rows[i], side.weights[i] * side.shape.areas[side.rows[i]] / side.area,
             other.shape.positions.row(other.rows[to_size(side.matches.to[i])]).transpose()});
    for (std::size_t j = 0; j < other.rows.size(); ++j)
        side.attractions.push_back(
            {side.rows[to_size(other.matches.to[j])],
             other.weights[j] * other.shape.areas[other.rows[j]] / other.area,
             other.shape.positions.row(other.rows[j]).transpose()});
    for (const IndexPair& f : features)
        side.attractions.push_back(
            {reverse ? f.target : f.source, feature_weight,
             other.shape.positions.row(reverse ? f.source : f.target).transpose()});
    follow_guides(side, other);
}

void update(Side& side, double stiffness, int smoothing, int solves, double largest_scale) {
    side.solver.factorize(stiffness, side.attractions);
    for (int k = 0; k < solves; ++k) {
        side.solver.solve(side.attractions, side.deformation);
        fit_similarities(side.shape.positions, side.graph, smoothing, largest_scale,
                         side.deformation);
    }
    side.place();
}

/// All rounds of one level. Progress runs from `first` to `last`.
void anneal(Side& source, Side& target, std::span<const IndexPair> features,
            const RegistrationLevel& level, const RegistrationOptions& options,
            std::mt19937_64& random, Progress& progress, double first, double last) {
    const int all_rounds = level.stiff_rounds + level.rounds;
    Progress silent;  // the sides run next to each other
    if (level.first_area_weight > 0.0)
        on_both(source, target,
                [&](Side& side, Side&) { side.areas = local_areas(side.shape, silent); });

    for (int round = 0; round < all_rounds; ++round) {
        const bool stiff = round < level.stiff_rounds;
        const double f = stiff || level.rounds < 2
                             ? 0.0
                             : static_cast<double>(round - level.stiff_rounds) / (level.rounds - 1);
        const double stiffness = level.first_stiffness *
                                 std::pow(level.last_stiffness / level.first_stiffness, f) /
                                 source.graph.size();
        const int smoothing = static_cast<int>(std::lround(
            level.first_smoothing + (level.last_smoothing - level.first_smoothing) * f));

        const bool full = round >= all_rounds - level.full_rounds;
        if (!full || round == 0 || round == all_rounds - level.full_rounds)
            for (Side* side : {&source, &target})
                side->choose(draw_points(side->shape, side->graph,
                                         full ? side->shape.size() : level.matched_points, random));
        if (level.first_area_weight > 0.0)
            match(source, target, options.normal_weight,
                  level.first_area_weight *
                      std::pow(level.last_area_weight / level.first_area_weight, f),
                  silent);
        else
            match(source, target, options.normal_weight, 0.0, silent);
        on_both(source, target, [&](Side& side, Side& other) {
            side.weights = robust_weights(side.matches.distances, options.outlier_distance);
            if (stiff)
                for (double& w : side.weights) w *= options.stiff_data;
            else
                ignore_torn(side, other, options.torn_piece);
            // A region may have to go far: its matches count however far off they are.
            if (side.shape.pulls.rows() > 0)
                for (std::size_t i = 0; i < side.rows.size(); ++i)
                    side.weights[i] += side.shape.pulls[side.rows[i]];
        });
        on_both(source, target, [&](Side& side, Side& other) {
            attract(side, other, features, &side == &target, options.feature_weight);
            update(side, stiffness, smoothing, level.solves, options.largest_scale);
        });
        progress.report(first + (last - first) * (round + 1) / all_rounds);
    }
}

Registration result_of(Side& source, Side& target) {
    const auto points = [](const Side& side) {
        return deformed(side.shape.positions, side.shape.normals, side.graph, side.deformation);
    };
    DeformedCloud source_points = points(source), target_points = points(target);
    return {std::move(source.deformation), std::move(target.deformation), std::move(source_points),
            std::move(target_points)};
}

/// Mean difference between distances along one surface and along the other, between the nodes of
/// the coarsest level and their images.
double geodesic_distortion(const CoarseShape& here, const DeformedCloud& here_points,
                           const CoarseShape& there, const DeformedCloud& there_points,
                           const Eigen::MatrixXd& here_distances,
                           const Eigen::MatrixXd& there_distances,
                           const RegistrationOptions& options, Progress& progress) {
    const auto& graph = here.levels.front();
    const auto& other = there.levels.front();
    const Keys to(gather(product_points(there.positions, there_points.positions, there.normals,
                                        there_points.normals, options.normal_weight),
                         other.nodes),
                  labels_of(there, other.nodes));
    const Matches matches = KeyTree(to).nearest(
        {gather(product_points(here_points.positions, here.positions, here_points.normals,
                               here.normals, options.normal_weight),
                graph.nodes),
         labels_of(here, graph.nodes)},
        progress);
    double sum = 0.0;
    for (Index j = 0; j < graph.size(); ++j)
        for (Index i = 0; i < graph.size(); ++i)
            sum += std::abs(here_distances(i, j) -
                            there_distances(matches.to[to_size(i)], matches.to[to_size(j)]));
    return sum / std::max<double>(1.0, std::pow(static_cast<double>(graph.size()), 2));
}

}  // namespace

MarkedPlaces marked_places(const CoarseShape& source, const CoarseShape& target,
                           std::span<const IndexPair> features) {
    constexpr Index kMostGuides = 60;
    const Index step = (source.guides.size() + kMostGuides - 1) / kMostGuides;
    const Index guides = step > 0 ? (source.guides.size() + step - 1) / step : 0;
    const auto count = static_cast<Eigen::Index>(features.size());
    MarkedPlaces places{Positions(count + guides, 3), Positions(count + guides, 3)};
    for (Eigen::Index k = 0; k < count; ++k) {
        const IndexPair& f = features[to_size(k)];
        places.source.row(k) = source.positions.row(f.source);
        places.target.row(k) = target.positions.row(f.target);
    }
    for (Index k = 0; k < guides; ++k) {
        places.source.row(count + k) = source.guides.places.row(k * step);
        places.target.row(count + k) = target.guides.places.row(k * step);
    }
    return places;
}

RegistrationStart thin_plate_start(const CoarseShape& source, const CoarseShape& target,
                                   std::span<const IndexPair> features) {
    RegistrationStart start{source.positions, target.positions};
    constexpr Eigen::Index kFewest = 5;
    const auto [s, t] = marked_places(source, target, features);
    if (s.rows() < kFewest) return start;
    const ThinPlate forward(s, t), backward(t, s);
    for (Eigen::Index k = 0; k < start.source.rows(); ++k)
        start.source.row(k) = forward(start.source.row(k));
    for (Eigen::Index k = 0; k < start.target.rows(); ++k)
        start.target.row(k) = backward(start.target.row(k));
    return start;
}

Registration register_level(const CoarseShape& source_shape, const CoarseShape& target_shape,
                            Index level, std::span<const IndexPair> features,
                            const RegistrationStart& start, const RegistrationLevel& schedule,
                            const RegistrationOptions& options, Progress& progress) {
    Side source(source_shape, level, start.source, options);
    Side target(target_shape, level, start.target, options);
    std::mt19937_64 random(1);
    anneal(source, target, features, schedule, options, random, progress, 0.0, 1.0);
    return result_of(source, target);
}

Eigen::MatrixXd node_distances(const CoarseShape& shape) {
    const DeformationGraph& nodes = shape.levels.front();
    const SurfaceGraph graph = node_graph(shape.positions, nodes);
    Eigen::MatrixXd distances = Eigen::MatrixXd::Zero(nodes.size(), nodes.size());
    GeodesicSearch search(graph);
    for (Index i = 0; i < nodes.size(); ++i)
        for (const auto& [j, distance] : search.from(i)) distances(i, j) = distance;
    return distances;
}

NodeDistances node_distances(const CoarseShape& source, const CoarseShape& target) {
    NodeDistances distances;
    parallel_invoke(
        2, [&](int k, bool) { distances[to_size(k)] = node_distances(k == 0 ? source : target); });
    return distances;
}

double torn_share(const CoarseShape& source, const CoarseShape& target,
                  const Registration& registration, const RegistrationOptions& options,
                  Progress& progress) {
    const Keys s(
        product_points(registration.source_points.positions, source.positions,
                       registration.source_points.normals, source.normals, options.normal_weight),
        source.labels);
    const Keys t(
        product_points(target.positions, registration.target_points.positions, target.normals,
                       registration.target_points.normals, options.normal_weight),
        target.labels);
    double share = 0.0;
    for (const bool is_source : {true, false}) {
        const CoarseShape& here = is_source ? source : target;
        const CoarseShape& there = is_source ? target : source;
        const Matches matches = KeyTree(is_source ? t : s).nearest(is_source ? s : t, progress);
        std::size_t torn = 0;
        for (Index i = 0; i < here.size(); ++i)
            for (auto e = to_size(here.graph.offsets[to_size(i)]);
                 e < to_size(here.graph.offsets[to_size(i) + 1]); ++e) {
                const Index a = matches.to[to_size(i)],
                            b = matches.to[to_size(here.graph.neighbors[e])];
                torn += (there.positions.row(a) - there.positions.row(b)).norm() >
                        options.tear_stretch * here.graph.lengths[e] + options.tear_gap;
            }
        share += 0.5 * static_cast<double>(torn) /
                 static_cast<double>(std::max<std::size_t>(here.graph.lengths.size(), 1));
    }
    return share;
}

double Misfit::energy() const {
    struct Term {
        double value;
        double exponent;  ///< those that ranked maps of four-legged animals best
        double floor;     ///< what a perfect map of samples has anyway, so that none can win alone
    };
    const Term terms[] = {{gap, 0.8, 1e-3},     {round_trip, 0.5, 1e-3}, {normals, 1.6, 1e-3},
                          {opposed, 0.1, 1e-2}, {residual, 0.4, 1e-4},   {turn, 0.4, 1e-3},
                          {scale, 0.5, 1e-3},   {geodesics, 0.3, 1e-2}};
    double logarithm = 0.0, exponents = 0.0;
    for (const Term& term : terms) {
        logarithm += term.exponent * std::log(term.value + term.floor);
        exponents += term.exponent;
    }
    return std::exp(logarithm / exponents);
}

Misfit registration_misfit(const CoarseShape& source, const CoarseShape& target, Index level,
                           const Registration& registration, const NodeDistances& distances,
                           const RegistrationOptions& options, Progress& progress) {
    Misfit sums;
    struct View {
        const CoarseShape& shape;
        const Deformation& deformation;
        const DeformedCloud& points;
    };
    const View views[2] = {{source, registration.source, registration.source_points},
                           {target, registration.target, registration.target_points}};
    for (int side = 0; side < 2; ++side) {
        const View& here = views[side];
        const View& there = views[1 - side];
        const auto& graph = here.shape.levels[to_size(level)];
        const Keys all(
            product_points(there.shape.positions, there.points.positions, there.shape.normals,
                           there.points.normals, options.normal_weight),
            there.shape.labels);
        const Matches matches = KeyTree(all).nearest(
            {gather(product_points(here.points.positions, here.shape.positions, here.points.normals,
                                   here.shape.normals, options.normal_weight),
                    graph.nodes),
             labels_of(here.shape, graph.nodes)},
            progress);
        const double share = 0.5 / graph.size();
        for (Index k = 0; k < graph.size(); ++k) {
            const Index i = graph.nodes[to_size(k)], j = matches.to[to_size(k)];
            const double agreement = here.points.normals.row(i).dot(there.shape.normals.row(j));
            const double back = here.shape.normals.row(i).dot(there.points.normals.row(j));
            sums.gap +=
                share * (here.points.positions.row(i) - there.shape.positions.row(j)).norm();
            sums.round_trip +=
                share * (there.points.positions.row(j) - here.shape.positions.row(i)).norm();
            sums.normals += share * (1.0 - 0.5 * (agreement + back));
            sums.opposed += share * (agreement < 0.0 ? 1.0 : 0.0);
        }
        sums.geodesics +=
            0.5 * geodesic_distortion(here.shape, here.points, there.shape, there.points,
                                      distances[to_size(side)], distances[to_size(1 - side)],
                                      options, progress);
        const double edge_share =
            0.5 / std::max<double>(1.0, static_cast<double>(graph.edge_ends.size()));
        const Deformation& d = here.deformation;
        for (Index k = 0; k < graph.size(); ++k)
            for (auto e = to_size(graph.edge_offsets[to_size(k)]);
                 e < to_size(graph.edge_offsets[to_size(k) + 1]); ++e) {
                const Index l = graph.edge_ends[e];
                const Vector3 rest = (here.shape.positions.row(graph.nodes[to_size(l)]) -
                                      here.shape.positions.row(graph.nodes[to_size(k)]))
                                         .transpose();
                const Vector3 now = (d.positions.row(l) - d.positions.row(k)).transpose();
                const Matrix3 linear = 0.5 * (d.scales[k] * d.rotations[to_size(k)] +
                                              d.scales[l] * d.rotations[to_size(l)]);
                const double ratio = now.norm() / std::max(rest.norm(), 1e-300);
                sums.torn += ratio > 2.0 || ratio < 0.5 ? edge_share : 0.0;
                sums.residual += edge_share * (now - linear * rest).squaredNorm() /
                                 std::max(rest.squaredNorm(), 1e-300);
                sums.turn +=
                    edge_share * (d.rotations[to_size(k)] - d.rotations[to_size(l)]).norm();
                sums.scale += edge_share * std::abs(std::log(d.scales[k] / d.scales[l]));
            }
    }
    return sums;
}

double registration_energy(const CoarseShape& source, const CoarseShape& target, Index level,
                           const Registration& registration, const NodeDistances& distances,
                           const RegistrationOptions& options, Progress& progress) {
    return registration_misfit(source, target, level, registration, distances, options, progress)
        .energy();
}

Registration register_shapes(const CoarseShape& source_shape, const CoarseShape& target_shape,
                             std::span<const IndexPair> features, const RegistrationStart& start,
                             const RegistrationOptions& options, Progress& progress,
                             Index first_level) {
    std::mt19937_64 random(1);
    Registration result;
    result.source_points.positions = start.source;
    result.target_points.positions = start.target;
    const auto levels = static_cast<Index>(source_shape.levels.size());
    for (Index level = first_level; level < levels; ++level) {
        Side source(source_shape, level, result.source_points.positions, options);
        Side target(target_shape, level, result.target_points.positions, options);
        anneal(source, target, features, options.levels[to_size(level)], options, random, progress,
               static_cast<double>(level) / levels, static_cast<double>(level + 1) / levels);
        result = result_of(source, target);
    }
    return result;
}

}  // namespace pointmorph

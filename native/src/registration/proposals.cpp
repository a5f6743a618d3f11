#include "pointmorph/registration/proposals.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/product_space.hpp"

namespace pointmorph {

namespace {

Index nearest(const KdTree<3>& tree, const Eigen::RowVector3d& point) {
    Index row;
    double squared;
    tree.nearest(point.data(), {&row, 1}, {&squared, 1});
    return row;
}

/// Areas of nodes that hang together, the largest first.
std::vector<std::vector<Index>> areas_of(const DeformationGraph& graph,
                                         const std::vector<char>& member) {
    std::vector<std::vector<Index>> areas;
    std::vector<char> seen(to_size(graph.size()), 0);
    for (Index start = 0; start < graph.size(); ++start) {
        if (!member[to_size(start)] || seen[to_size(start)]) continue;
        std::vector<Index> area{start};
        seen[to_size(start)] = 1;
        for (std::size_t next = 0; next < area.size(); ++next) {
            const auto i = to_size(area[next]);
            for (auto e = graph.edge_offsets[i]; e < graph.edge_offsets[i + 1]; ++e) {
                const Index j = graph.edge_ends[to_size(e)];
                if (!member[to_size(j)] || seen[to_size(j)]) continue;
                seen[to_size(j)] = 1;
                area.push_back(j);
            }
        }
        areas.push_back(std::move(area));
    }
    std::ranges::stable_sort(areas, std::greater<>(), &std::vector<Index>::size);
    return areas;
}

/// What the chosen map there and the rival's map back do to the source, along its principal axes.
Swap swap_of(const CoarseShape& source, const Positions& there_and_back, double share) {
    const auto& nodes = source.levels.back().node_rows;
    const auto count = static_cast<Eigen::Index>(nodes.size());
    Positions p(count, 3);
    for (Eigen::Index k = 0; k < count; ++k) p.row(k) = source.positions.row(nodes[to_size(k)]);
    const Eigen::RowVector3d center = p.colwise().mean();
    p.rowwise() -= center;
    const Positions q = there_and_back.rowwise() - center;
    const Matrix3 covariance = p.transpose() * p;
    const Eigen::SelfAdjointEigenSolver<Matrix3> solver(covariance);
    std::array<double, 3> kept;  // 1 where an axis stays, −1 where it is reversed
    for (int axis = 0; axis < 3; ++axis) {
        const Vector3 a = solver.eigenvectors().col(axis);
        kept[to_size(axis)] = (p * a).dot(q * a) / std::max((p * a).squaredNorm(), 1e-300);
    }
    constexpr double kReversed = -0.3, kMost = 0.5;
    if (kept[2] < kReversed) return Swap::kEnds;
    if (std::min(kept[0], kept[1]) < kReversed) return Swap::kSides;
    return share > kMost ? Swap::kTurned : Swap::kPlaces;
}

bool is_marked(const ProposalInput& input, const IndexPair& pair) {
    return std::ranges::any_of(input.shapes.features, [&](const IndexPair& feature) {
        return feature.source == pair.source || feature.target == pair.target;
    });
}

Proposal rated(const ProposalInput& input, const IndexPair& pair, bool is_extremity) {
    const auto& [shapes, registration, s, t, confidence] = input;
    const Positions &images = registration.source_points.positions,
                    &back = registration.target_points.positions;
    const double apart =
        0.5 * ((images.row(pair.source) - shapes.target.positions.row(pair.target)).norm() +
               (back.row(pair.target) - shapes.source.positions.row(pair.source)).norm());
    return {pair.source, pair.target, proposal_confidence(confidence, apart), is_extremity};
}

/// Those that the map brings together and that aren't marked.
std::vector<Proposal> proposed_extremities(const ProposalInput& input) {
    const auto& [shapes, registration, s, t, confidence] = input;
    std::vector<Proposal> proposals;
    for (const ExtremityPair& found :
         paired_extremities({shapes.source, registration.source_points.positions, s},
                            {shapes.target, registration.target_points.positions, t}, {})) {
        const IndexPair pair{s[to_size(found.source)].point, t[to_size(found.target)].point};
        if (!is_marked(input, pair)) proposals.push_back(rated(input, pair, true));
    }
    return proposals;
}

/// `count` places, each the farthest from extremities, features and the places before, with what
/// the map has nearest.
std::vector<IndexPair> places_between(const ProposalInput& input, Index count, Progress& progress) {
    const CoarseShape &source = input.shapes.source, &target = input.shapes.target;
    const std::vector<Index>& nodes = source.levels.front().node_rows;
    std::vector<double> free(nodes.size(), std::numeric_limits<double>::infinity());
    const auto mark = [&](Index row) {
        for (std::size_t k = 0; k < nodes.size(); ++k)
            free[k] = std::min(free[k],
                               (source.positions.row(nodes[k]) - source.positions.row(row)).norm());
    };
    for (const Extremity& extremity : input.source_extremities) mark(extremity.point);
    for (const IndexPair& feature : input.shapes.features) mark(feature.source);
    constexpr double kNormalWeight = 0.1;
    const Registration& map = input.registration;
    const ProductPoints there =
        product_points(oriented(target), oriented(map.target_points), kNormalWeight);
    const KdTree<12> tree(there);
    const ProductPoints here =
        product_points(oriented(map.source_points), oriented(source), kNormalWeight);
    std::vector<IndexPair> places;
    for (Index k = 0; k < count && k < to_index(nodes.size()); ++k) {
        progress.throw_if_cancelled();
        const Index s = nodes[to_size(std::ranges::max_element(free) - free.begin())];
        mark(s);
        Index t;
        double squared;
        tree.nearest(here.row(s).data(), {&t, 1}, {&squared, 1});
        places.push_back({s, t});
    }
    return places;
}

}  // namespace

std::string name_of(Swap swap) {
    constexpr std::array<const char*, 5> kNames{"ends", "sides", "turned", "places", "rolled"};
    return kNames[to_size(swap)];
}

std::vector<Rival> describe_rivals(const CoarseShape& source, const CoarseShape& target,
                                   const Pose& pose) {
    constexpr std::size_t kPlaces = 4;
    constexpr double kApart = 0.08;  // of √area
    const KdTree<3> target_tree(target.positions);
    const DeformationGraph& graph = source.levels.back();
    const Positions images = images_at_rest(pose.best);
    std::vector<Rival> rivals;
    for (const Candidate& other : pose.rivals) {
        const Positions its_images = images_at_rest(other);
        const Eigen::VectorXd distances = (images - its_images).rowwise().norm();
        const auto farther = [&](Index i, Index j) { return distances[i] < distances[j]; };
        const Index worst = *std::ranges::max_element(graph.node_rows, farther);

        std::vector<char> member(to_size(graph.size()), 0);
        Positions there_and_back(graph.size(), 3);
        Index moved_nodes = 0;
        for (Index k = 0; k < graph.size(); ++k) {
            const Index i = graph.node_rows[to_size(k)];
            member[to_size(k)] = distances[i] >= std::max(kApart, 0.5 * distances[worst]);
            moved_nodes += distances[i] >= kApart;
            there_and_back.row(k) = pose.best.registration.target_points.positions.row(
                nearest(target_tree, its_images.row(i)));
        }
        Rival rival{other.cost / pose.best.cost,
                    other.is_rolled ? Swap::kRolled
                                    : swap_of(source, there_and_back,
                                              static_cast<double>(moved_nodes) /
                                                  std::max(graph.size(), Index{1})),
                    distances[worst],
                    {},
                    worst,
                    0,
                    0};
        for (const auto& area : areas_of(graph, member)) {
            if (rival.places.size() == kPlaces) break;
            const Index middle = *std::ranges::max_element(area, [&](Index k, Index l) {
                return farther(graph.node_rows[to_size(k)], graph.node_rows[to_size(l)]);
            });
            rival.places.push_back(graph.node_rows[to_size(middle)]);
        }
        // An extremity is easier to mark than a flank.
        constexpr double kNearlyAsFar = 0.7;
        const auto far = std::ranges::find_if(pose.source_extremities, [&](const Extremity& e) {
            return distances[e.point] >= kNearlyAsFar * distances[worst];
        });
        if (far != pose.source_extremities.end()) rival.source = far->point;
        const auto partner = [&](const Positions& its) {
            constexpr double kAtExtremity = 0.1;
            const Eigen::RowVector3d image = its.row(rival.source);
            Index row = nearest(target_tree, image);
            double least = kAtExtremity;
            for (const Extremity& extremity : pose.target_extremities) {
                const double distance = (target.positions.row(extremity.point) - image).norm();
                if (distance >= least) continue;
                least = distance;
                row = extremity.point;
            }
            return row;
        };
        rival.target = partner(images);
        rival.rival_target = partner(its_images);
        rivals.push_back(std::move(rival));
    }
    return rivals;
}

double proposal_confidence(double confidence, double distance) {
    // Fitted to proposals between animals; see docs/stages/registration/proposals.md.
    return confidence / (1.0 + std::exp(40.0 * distance - 4.9));
}

std::vector<Proposal> propose_features(const ProposalInput& input, Index others,
                                       Progress& progress) {
    std::vector<Proposal> proposals = proposed_extremities(input);
    std::ranges::stable_sort(proposals, std::greater<>(), &Proposal::confidence);
    for (const IndexPair& place : places_between(input, others, progress))
        if (!is_marked(input, place) &&
            std::ranges::find(proposals, place.target, &Proposal::target) == proposals.end())
            proposals.push_back(rated(input, place, false));
    return proposals;
}

}  // namespace pointmorph

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

/// Where source points land on the target at rest.
Positions images_at_rest(const Candidate& map) {
    return map.alignment.inverse().apply(map.registration.source_points.positions);
}

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

/// What the chosen map there and the rival's way back do to the source, along its principal axes.
Swap swap_of(const CoarseShape& source, const Positions& there_and_back, double share) {
    const auto& nodes = source.levels.back().nodes;
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

}  // namespace

std::string name_of(Swap swap) {
    constexpr std::array<const char*, 4> kNames{"ends", "sides", "turned", "places"};
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
        const Index worst = *std::ranges::max_element(graph.nodes, farther);

        std::vector<char> member(to_size(graph.size()), 0);
        Positions there_and_back(graph.size(), 3);
        Index moved_nodes = 0;
        for (Index k = 0; k < graph.size(); ++k) {
            const Index i = graph.nodes[to_size(k)];
            member[to_size(k)] = distances[i] >= std::max(kApart, 0.5 * distances[worst]);
            moved_nodes += distances[i] >= kApart;
            there_and_back.row(k) = pose.best.registration.target_points.positions.row(
                nearest(target_tree, its_images.row(i)));
        }
        Rival rival{other.cost / pose.best.cost,
                    swap_of(source, there_and_back,
                            static_cast<double>(moved_nodes) / std::max(graph.size(), Index{1})),
                    distances[worst],
                    {},
                    worst,
                    0,
                    0};
        for (const auto& area : areas_of(graph, member)) {
            if (rival.places.size() == kPlaces) break;
            const Index middle = *std::ranges::max_element(area, [&](Index k, Index l) {
                return farther(graph.nodes[to_size(k)], graph.nodes[to_size(l)]);
            });
            rival.places.push_back(graph.nodes[to_size(middle)]);
        }
        // A tip is easier to mark than a flank.
        constexpr double kNearlyAsFar = 0.7;
        for (const Extremity& tip : pose.source_tips)
            if (distances[tip.point] >= kNearlyAsFar * distances[worst]) {
                rival.source = tip.point;
                break;
            }
        const auto partner = [&](const Positions& its) {
            constexpr double kAtTip = 0.1;
            const Eigen::RowVector3d image = its.row(rival.source);
            Index row = nearest(target_tree, image);
            double least = kAtTip;
            for (const Extremity& tip : pose.target_tips) {
                const double distance = (target.positions.row(tip.point) - image).norm();
                if (distance >= least) continue;
                least = distance;
                row = tip.point;
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
    // Fitted to proposals between animals; see docs/stages/proposals.md.
    return confidence / (1.0 + std::exp(40.0 * distance - 4.9));
}

std::vector<Proposal> propose_features(const CoarseShape& source, const CoarseShape& target,
                                       const Registration& registration,
                                       const std::vector<Extremity>& source_tips,
                                       const std::vector<Extremity>& target_tips,
                                       std::span<const IndexPair> features, double confidence,
                                       Index others, Progress& progress) {
    const Positions& images = registration.source_points.positions;
    const Positions& back = registration.target_points.positions;
    const auto agreement = [&](Index s, Index t) {
        return 0.5 * ((images.row(s) - target.positions.row(t)).norm() +
                      (back.row(t) - source.positions.row(s)).norm());
    };
    const auto taken = [&](Index IndexPair::*side, Index row) {
        return std::ranges::find(features, row, side) != features.end();
    };
    const auto rated = [&](Index s, Index t, bool is_tip) {
        return Proposal{s, t, proposal_confidence(confidence, agreement(s, t)), is_tip};
    };
    std::vector<Proposal> proposals;
    for (const ExtremityPair& pair :
         paired_extremities(source, target, images, back, source_tips, target_tips, {})) {
        const Index s = source_tips[to_size(pair.source)].point,
                    t = target_tips[to_size(pair.target)].point;
        if (!taken(&IndexPair::source, s) && !taken(&IndexPair::target, t))
            proposals.push_back(rated(s, t, true));
    }
    std::ranges::stable_sort(proposals, std::greater<>(), &Proposal::confidence);

    // The farthest from all that is marked, one by one.
    const std::vector<Index>& nodes = source.levels.front().nodes;
    std::vector<double> free(nodes.size(), std::numeric_limits<double>::infinity());
    const auto mark = [&](Index row) {
        for (std::size_t k = 0; k < nodes.size(); ++k)
            free[k] = std::min(free[k],
                               (source.positions.row(nodes[k]) - source.positions.row(row)).norm());
    };
    for (const Extremity& tip : source_tips) mark(tip.point);
    for (const IndexPair& feature : features) mark(feature.source);
    constexpr double kNormalWeight = 0.1;
    const ProductPoints there = product_points(target.positions, back, target.normals,
                                               registration.target_points.normals, kNormalWeight);
    const KdTree<12> tree(there);
    const ProductPoints product =
        product_points(images, source.positions, registration.source_points.normals, source.normals,
                       kNormalWeight);
    for (Index k = 0; k < others && k < static_cast<Index>(nodes.size()); ++k) {
        progress.throw_if_cancelled();
        const Index s = nodes[to_size(std::ranges::max_element(free) - free.begin())];
        mark(s);
        Index t;
        double squared;
        tree.nearest(product.row(s).data(), {&t, 1}, {&squared, 1});
        if (!taken(&IndexPair::source, s) && !taken(&IndexPair::target, t) &&
            std::ranges::find(proposals, t, &Proposal::target) == proposals.end())
            proposals.push_back(rated(s, t, false));
    }
    return proposals;
}

}  // namespace pointmorph

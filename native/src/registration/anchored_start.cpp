#include "pointmorph/registration/anchored_start.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <iterator>
#include <utility>
#include <vector>

#include "registration/from_nodes.hpp"

namespace pointmorph {

namespace {

/// Of every node, a row, its distances from the anchors, each over the mean of those from that
/// anchor to the others.
Eigen::MatrixXd anchor_distances(const Eigen::MatrixXd& distances,
                                 std::span<const IndexPair> anchors, Index IndexPair::*side) {
    Eigen::MatrixXd result(distances.rows(), static_cast<Eigen::Index>(anchors.size()));
    for (std::size_t k = 0; k < anchors.size(); ++k) {
        const Index anchor = anchors[k].*side;
        double mean = 0.0;
        for (const IndexPair& other : anchors) mean += distances(other.*side, anchor);
        mean /= static_cast<double>(anchors.size() - 1);
        result.col(static_cast<Eigen::Index>(k)) = distances.col(anchor) / std::max(mean, 1e-9);
    }
    return result;
}

/// Where the other shape's nodes lie whose distances are most like a node's, blended.
Eigen::RowVector3d place_of(const Eigen::RowVectorXd& wanted, const Eigen::MatrixXd& there,
                            const CoarseShape& shape) {
    constexpr std::size_t kBlended = 4;
    const std::vector<Index>& nodes = shape.levels.front().node_rows;
    std::vector<std::pair<double, Index>> order;
    for (Eigen::Index j = 0; j < there.rows(); ++j)
        order.emplace_back((there.row(j) - wanted).squaredNorm(), to_index(j));
    const auto last = order.begin() + static_cast<std::ptrdiff_t>(std::min(kBlended, order.size()));
    std::ranges::partial_sort(order, last);
    const double farthest = std::prev(last)->first + 1e-9;
    Eigen::RowVector3d place = Eigen::RowVector3d::Zero();
    double weights = 0.0;
    for (auto near = order.begin(); near != last; ++near) {
        const double weight = std::exp(-near->first / farthest);
        place += weight * shape.positions.row(nodes[to_size(near->second)]);
        weights += weight;
    }
    return place / weights;
}

Positions images(const CoarseShape& from, const Eigen::MatrixXd& here, const CoarseShape& to,
                 const Eigen::MatrixXd& there) {
    Positions of_nodes(here.rows(), 3);
    for (Eigen::Index i = 0; i < here.rows(); ++i)
        of_nodes.row(i) = place_of(here.row(i), there, to);
    return from_nodes(from.levels.front(), of_nodes);
}

}  // namespace

RegistrationStart anchored_start(const CoarseShape& source, const CoarseShape& target,
                                 const NodeDistances& distances,
                                 std::span<const IndexPair> anchors) {
    assert(anchors.size() >= kFewestAnchors);
    const Eigen::MatrixXd s = anchor_distances(distances[0], anchors, &IndexPair::source),
                          t = anchor_distances(distances[1], anchors, &IndexPair::target);
    return {images(source, s, target, t), images(target, t, source, s)};
}

}  // namespace pointmorph

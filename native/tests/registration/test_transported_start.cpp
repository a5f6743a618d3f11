#include "registration/transported_start.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "pointmorph/cloud/kd_tree.hpp"
#include "registration/coarse_urchin.hpp"

namespace pointmorph {
namespace {

CoarseShape with_spikes(const std::vector<Vector3>& spikes, unsigned seed) {
    return coarse_urchin(20000, spikes, seed);
}

/// Every point blended from its nodes.
Positions from_nodes(const CoarseShape& shape) {
    const DeformationGraph& graph = shape.levels.front();
    Positions result = Positions::Zero(shape.size(), 3);
    for (Index i = 0; i < shape.size(); ++i)
        for (std::size_t k = 0; k < kNodesPerPoint; ++k) {
            const Index node = graph.node_rows[to_size(graph.point_nodes[to_size(i)][k])];
            result.row(i) += graph.point_weights[to_size(i)][k] * shape.positions.row(node);
        }
    return result;
}

TEST(TransportedStart, TakesAShapeOntoItselfWhereverItLiesAndHoweverLarge) {
    const CoarseShape shape = with_spikes({Vector3::UnitX(), Vector3::UnitZ()}, 3);
    const Positions expected = from_nodes(shape);
    CoarseShape there = moved(shape, {1.0, Matrix3::Identity(), Vector3(4.0, -2.0, 7.0)});
    there.positions *= 3.0;
    const RegistrationStart start = transported_start(shape, there);
    const Positions on_it = 3.0 * (expected.rowwise() + Eigen::RowVector3d(4.0, -2.0, 7.0));
    EXPECT_LT((start.source - on_it).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((start.target - expected).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(TransportedStart, CoversWhatNothingLiesNextTo) {
    // Spikes on either side: the nearest of a ball's points to one are those at its root.
    const CoarseShape ball = with_spikes({}, 3),
                      spiky = with_spikes({1.5 * Vector3::UnitX(), -1.5 * Vector3::UnitY()}, 4);
    const RegistrationStart start = transported_start(ball, spiky);
    const KdTree<3> starts(start.source), at_rest(ball.positions);
    double farthest = 0.0, before = 0.0;
    for (const Index node : spiky.levels.front().node_rows) {
        Index row;
        double squared;
        starts.nearest(spiky.positions.row(node).data(), {&row, 1}, {&squared, 1});
        farthest = std::max(farthest, std::sqrt(squared));
        at_rest.nearest(spiky.positions.row(node).data(), {&row, 1}, {&squared, 1});
        before = std::max(before, std::sqrt(squared));
    }
    EXPECT_GT(before, 0.8);
    EXPECT_LT(farthest, 0.35);
}

TEST(TransportedStart, KeepsShapesAsTheyStand) {
    // A spike that points up goes to what is up, not to the other one's spike.
    const CoarseShape up = with_spikes({Vector3::UnitZ()}, 3),
                      aside = with_spikes({Vector3::UnitX()}, 4);
    const RegistrationStart start = transported_start(up, aside);
    const Positions before = up.positions.rowwise() - up.positions.colwise().mean(),
                    after = start.source.rowwise() - start.source.colwise().mean();
    const Eigen::RowVectorXd alike =
        (before.array() * after.array()).colwise().sum() /
        (before.colwise().norm().array() * after.colwise().norm().array());
    EXPECT_GT(alike.minCoeff(), 0.85);  // correlation of each coordinate
}

TEST(TransportedStart, IsTheWayBackOfTheOtherDirection) {
    const CoarseShape one = with_spikes({Vector3::UnitX()}, 3),
                      other = with_spikes({1.5 * Vector3::UnitY()}, 4);
    const RegistrationStart there = transported_start(one, other),
                            back = transported_start(other, one);
    EXPECT_LT((there.source - back.target).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((there.target - back.source).cwiseAbs().maxCoeff(), 1e-9);
}

}  // namespace
}  // namespace pointmorph

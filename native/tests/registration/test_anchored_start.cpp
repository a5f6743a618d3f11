#include "pointmorph/registration/anchored_start.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "pointmorph/registration/pose.hpp"
#include "registration/coarse_urchin.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

CoarseShape urchin(const std::vector<Vector3>& spikes, unsigned seed) {
    return coarse_urchin(40000, spikes, seed);
}

/// The node nearest to the end of each spike.
std::vector<Index> ends(const CoarseShape& shape, const std::vector<Vector3>& spikes) {
    const std::vector<Index>& nodes = shape.levels.front().node_rows;
    std::vector<Index> result;
    for (const Vector3& spike : spikes) {
        const Eigen::RowVector3d end = (1.0 + 0.5 / spike.norm()) * spike.transpose();
        const auto distance = [&](Index node) {
            return (shape.positions.row(node) - end).squaredNorm();
        };
        result.push_back(to_index(std::ranges::min_element(nodes, {}, distance) - nodes.begin()));
    }
    return result;
}

std::vector<IndexPair> paired(const std::vector<Index>& source, const std::vector<Index>& target) {
    std::vector<IndexPair> pairs;
    for (std::size_t k = 0; k < source.size(); ++k) pairs.push_back({source[k], target[k]});
    return pairs;
}

const std::vector<Vector3>& source_spikes() {
    static const std::vector<Vector3> spikes{Vector3::UnitX(), -Vector3::UnitX(), Vector3::UnitY(),
                                             Vector3::UnitZ(), Vector3(0.2, -0.7, -0.6)};
    return spikes;
}

TEST(AnchoredStart, ALimbStartsOnItsPartnerWhereverThatPoints) {
    const CoarseShape source = urchin(source_spikes(), 3);
    std::vector<Vector3> target_spikes = source_spikes();
    target_spikes[0] = 2.0 * Vector3(0.9, 0.3, 0.3).normalized();  // twice as long
    target_spikes[2] = Vector3(-0.3, 0.9, -0.2).normalized();
    const CoarseShape target = urchin(target_spikes, 4);
    const auto pairs = paired(ends(source, source_spikes()), ends(target, target_spikes));
    const RegistrationStart start =
        anchored_start(source, target, node_distances(source, target), pairs);
    for (const std::size_t spike : {0u, 2u}) {
        const Vector3 from = source_spikes()[spike].normalized(),
                      to = target_spikes[spike].normalized();
        int on_spike = 0;
        double aside = 0.0, along = 0.0;
        for (Index i = 0; i < source.size(); ++i) {
            const Vector3 p = source.positions.row(i).transpose();
            const double share = (p.dot(from) - 0.5) / source_spikes()[spike].norm();
            if (share < 0.4 || (p - p.dot(from) * from).norm() > 0.15) continue;
            ++on_spike;
            const Vector3 q = start.source.row(i).transpose();
            aside += (q - q.dot(to) * to).norm();
            along += std::abs((q.dot(to) - 0.5) / target_spikes[spike].norm() - share);
        }
        ASSERT_GT(on_spike, 20);
        EXPECT_LT(aside / on_spike, 0.15) << spike;  // at rest they lie .2 to .5 aside
        EXPECT_LT(along / on_spike, spike == 0 ? 0.35 : 0.15) << spike;
    }
}

TEST(AnchoredStart, TurnsWithTheTargetAndLeavesTheWayBackAlone) {
    const CoarseShape source = urchin(source_spikes(), 3), target = urchin(source_spikes(), 4);
    const auto pairs = paired(ends(source, source_spikes()), ends(target, source_spikes()));
    const NodeDistances distances = node_distances(source, target);
    const Similarity turn{1.0, shapes::rotation(7), Vector3(0.3, -0.2, 0.5)};
    const RegistrationStart plain = anchored_start(source, target, distances, pairs),
                            turned = anchored_start(source, moved(target, turn), distances, pairs);
    EXPECT_LT((turned.source - turn.apply(plain.source)).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_EQ(turned.target, plain.target);
}

TEST(AnchoredStart, TakesAShapeOntoItself) {
    const CoarseShape shape = urchin(source_spikes(), 3);
    const auto at_ends = ends(shape, source_spikes());
    const RegistrationStart start =
        anchored_start(shape, shape, node_distances(shape, shape), paired(at_ends, at_ends));
    const double spacing = shape.levels.front().spacing;
    EXPECT_LT((start.source - shape.positions).rowwise().norm().mean(), 1.5 * spacing);
    EXPECT_EQ(start.source, start.target);
}

TEST(AnchoredStart, AnchorsAtOnePlaceGiveNumbersToo) {
    const CoarseShape shape = urchin(source_spikes(), 3);
    const std::vector<IndexPair> same(kFewestAnchors, IndexPair{5, 5});
    const RegistrationStart start =
        anchored_start(shape, shape, node_distances(shape, shape), same);
    EXPECT_TRUE(start.source.allFinite());
    EXPECT_TRUE(start.target.allFinite());
}

TEST(Example, AnchoredStart) {
    SKIP_WHERE_WATCHED();
    std::vector<Vector3> target_spikes = source_spikes();
    target_spikes[2] = Vector3(-0.3, 0.9, -0.2).normalized();
    const CoarseShape source = urchin(source_spikes(), 3), target = urchin(target_spikes, 4);
    const std::vector<Index> from = ends(source, source_spikes()), to = ends(target, target_spikes);
    const std::vector<IndexPair> anchors = paired(from, to);
    const RegistrationOptions options;
    Progress progress;
    // --- example
    const NodeDistances distances = node_distances(source, target);
    const RegistrationStart start = anchored_start(source, target, distances, anchors);
    const Registration map =
        register_level({source, target}, 0, start, options.levels.front(), options, progress);
    // --- end of the example
    for (const auto& [s, t] : anchors) {
        const Index node = source.levels.front().node_rows[to_size(s)];
        const Index other = target.levels.front().node_rows[to_size(t)];
        EXPECT_LT((map.source_points.positions.row(node) - target.positions.row(other)).norm(),
                  0.25);
    }
}

}  // namespace
}  // namespace pointmorph

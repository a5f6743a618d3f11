#include "pointmorph/registration/extremities.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <random>

#include "registration/coarse_urchin.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

CoarseShape fine_urchin(const std::vector<Vector3>& spikes, unsigned seed) {
    return coarse_urchin(60000, spikes, seed);
}

const std::vector<Vector3>& four_spikes() {
    static const std::vector<Vector3> spikes{Vector3::UnitX(), -Vector3::UnitX(), Vector3::UnitY(),
                                             Vector3::UnitZ()};
    return spikes;
}

TEST(Extremities, AreTheEndsOfTheSpikesFirstOfAll) {
    const CoarseShape shape = fine_urchin(four_spikes(), 3);
    const auto tips = extremities(shape, node_distances(shape), {});
    ASSERT_GE(tips.size(), 4u);
    for (const Vector3& spike : four_spikes())
        EXPECT_TRUE(std::any_of(tips.begin(), tips.begin() + 4, [&](const Extremity& tip) {
            return (shape.positions.row(tip.point).transpose() - 1.5 * spike).norm() < 0.1;
        }));
    // The ball's back, where no spike is, bulges too; nothing else does.
    ASSERT_LE(tips.size(), 5u);
    if (tips.size() == 5) {
        EXPECT_LT(tips[4].prominence, 0.6 * tips[3].prominence);
    }
    EXPECT_TRUE(std::ranges::is_sorted(tips, std::greater<>(), &Extremity::prominence));
}

TEST(Extremities, NoMoreThanAskedFor) {
    const CoarseShape shape = fine_urchin(four_spikes(), 3);
    ExtremityOptions options;
    options.most = 2;
    EXPECT_EQ(extremities(shape, node_distances(shape), options).size(), 2u);
    options.most = 0;
    EXPECT_TRUE(extremities(shape, node_distances(shape), options).empty());
}

TEST(Extremities, ArePairedWhereTheMapTakesThem) {
    const CoarseShape source = fine_urchin(four_spikes(), 3);
    const CoarseShape target =
        fine_urchin({Vector3::UnitX(), Vector3::UnitY(), Vector3::UnitZ()}, 4);
    const auto a = extremities(source, node_distances(source), {});
    const auto b = extremities(target, node_distances(target), {});
    const auto pairs =
        paired_extremities({source, source.positions, a}, {target, target.positions, b}, {});
    std::vector<Vector3> paired;
    for (const ExtremityPair& p : pairs) {
        paired.push_back(source.positions.row(a[to_size(p.source)].point));
        EXPECT_LT(
            (paired.back() - target.positions.row(b[to_size(p.target)].point).transpose()).norm(),
            0.3);
    }
    const auto is_paired = [&](const Vector3& spike) {
        return std::ranges::any_of(
            paired, [&](const Vector3& tip) { return (tip - 1.5 * spike).norm() < 0.1; });
    };
    for (const Vector3& spike : four_spikes()) EXPECT_EQ(is_paired(spike), spike.x() >= 0.0);
}

TEST(Example, Extremities) {
    const CoarseShape source = fine_urchin(four_spikes(), 3),
                      target = fine_urchin(four_spikes(), 4);
    const Positions &source_images = source.positions, &target_images = target.positions;
    // --- example
    const auto on_source = extremities(source, node_distances(source), {.most = 4});
    const auto on_target = extremities(target, node_distances(target), {.most = 4});
    const auto pairs = paired_extremities({source, source_images, on_source},
                                          {target, target_images, on_target}, {});
    // --- end of the example
    ASSERT_EQ(pairs.size(), 4u);
    for (const ExtremityPair& pair : pairs) EXPECT_LT(pair.distance, 0.3);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/surface/pairing.hpp"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>

#include "checks.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

template <int Dim>
using Points = typename KdTree<Dim>::Points;

template <int Dim>
Points<Dim> noise(Index count, unsigned seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    Points<Dim> points(count, Dim);
    for (Eigen::Index i = 0; i < points.size(); ++i) points.data()[i] = uniform(random);
    return points;
}

template <int Dim>
Pairing pair(const Points<Dim>& source, const Points<Dim>& target,
             const std::vector<IndexPair>& features = {}, Index max_cluster_size = 10) {
    Progress progress;
    return pair_points<Dim>(source, target, features, {max_cluster_size}, progress);
}

/// The most partners that a row has.
Index most_partners(const Pairing& pairs) {
    std::map<Index, Index> of_source, of_target;
    Index most = 0;
    for (const auto& [s, t] : pairs) most = std::max({most, ++of_source[s], ++of_target[t]});
    return most;
}

template <int Dim>
double mean_distance(const Pairing& pairs, const Points<Dim>& source, const Points<Dim>& target) {
    double sum = 0.0;
    for (const auto& [s, t] : pairs) sum += (source.row(s) - target.row(t)).norm();
    return sum / static_cast<double>(pairs.size());
}

/// The greedy rule by its definition: the closest of all pairs of points not yet taken, again and
/// again; then each one left with its nearest.
template <int Dim>
Pairing greedy_by_definition(const Points<Dim>& source, const Points<Dim>& target) {
    const bool swap = source.rows() < target.rows();
    const Points<Dim>& larger = swap ? target : source;
    const Points<Dim>& smaller = swap ? source : target;
    const auto distance = [&](Index a, Index b) {
        return (larger.row(a) - smaller.row(b)).squaredNorm();
    };
    std::vector<bool> a_taken(to_size(larger.rows()));
    std::vector<bool> b_taken(to_size(smaller.rows()));
    Pairing pairs;
    for (Index round = 0; round < smaller.rows(); ++round) {
        IndexPair best{-1, -1};
        double nearest = std::numeric_limits<double>::infinity();
        for (Index a = 0; a < larger.rows(); ++a)
            for (Index b = 0; b < smaller.rows(); ++b)
                if (!a_taken[to_size(a)] && !b_taken[to_size(b)] && distance(a, b) < nearest) {
                    best = {a, b};
                    nearest = distance(a, b);
                }
        a_taken[to_size(best.source)] = true;
        b_taken[to_size(best.target)] = true;
        pairs.push_back(best);
    }
    for (Index a = 0; a < larger.rows(); ++a) {
        if (a_taken[to_size(a)]) continue;
        Index nearest = 0;
        for (Index b = 1; b < smaller.rows(); ++b)
            if (distance(a, b) < distance(a, nearest)) nearest = b;
        pairs.push_back({a, nearest});
    }
    if (swap)
        for (IndexPair& p : pairs) p = {p.target, p.source};
    std::ranges::sort(pairs);
    return pairs;
}

TEST(Pairing, EveryRowIsInAPair) {
    for (const auto& [sources, targets] : {std::pair{1, 1},
                                           {1, 7},
                                           {7, 1},
                                           {2, 2},
                                           {2, 500},
                                           {40, 13},
                                           {1000, 1000},
                                           {3000, 200},
                                           {777, 7001},
                                           {12345, 11111}})
        for (const Index size : {2, 10, 50}) {
            const auto pairs = pair<2>(noise<2>(sources, 1), noise<2>(targets, 2), {}, size);
            EXPECT_TRUE(checks::is_total(pairs, sources, targets)) << sources << " " << targets;
        }
    EXPECT_TRUE(checks::is_total(pair<3>(noise<3>(5000, 1), noise<3>(4000, 2)), 5000, 4000));
}

TEST(Pairing, ClustersHoldNoMoreThanAsked) {
    const Index count = 6000;
    const auto source = noise<2>(count, 3), target = noise<2>(count, 4);
    for (const Index size : {2, 5, 10}) {
        const auto pairs = pair<2>(source, target, {}, size);
        // A cluster of k and l points makes max(k, l) pairs, and none of its points has more than
        // |k − l| + 1 ≤ σ partners. Those with a single point of either cloud can't be split, and
        // may be larger; among points of the same density that is rare.
        std::map<Index, Index> of_source, of_target;
        for (const auto& [s, t] : pairs) ++of_source[s], ++of_target[t];
        const auto more = [&](const auto& entry) { return entry.second > size; };
        EXPECT_LT(std::ranges::count_if(of_source, more), count / (size == 2 ? 10 : 100)) << size;
        EXPECT_LT(std::ranges::count_if(of_target, more), count / (size == 2 ? 10 : 100)) << size;
        // Unsplit, the greedy rule would make no more pairs than points.
        EXPECT_GT(std::ssize(pairs), count + count / 20);
        EXPECT_LT(std::ssize(pairs), count + count / 2);
    }
}

TEST(Pairing, OneClusterFollowsTheGreedyRule) {
    for (unsigned seed = 0; seed < 200; ++seed) {
        const Index sources = 1 + to_index(seed) % 10;
        const Index targets = 1 + to_index(seed * 7) % 10;
        const auto source = noise<3>(sources, 2 * seed), target = noise<3>(targets, 2 * seed + 1);
        EXPECT_EQ(pair<3>(source, target), greedy_by_definition<3>(source, target)) << seed;
    }
    // A row of points each shifted by less than half their distance: nothing to choose.
    Points<2> row(10, 2), shifted(10, 2);
    for (Index i = 0; i < 10; ++i) {
        row.row(i) << 0.1 * i, 0.0;
        shifted.row(9 - i) << 0.1 * i + 0.04, 0.0;
    }
    for (const auto& [s, t] : pair<2>(row, shifted)) EXPECT_EQ(s + t, 9);
}

TEST(Pairing, OnePointTakesAllOfTheOther) {
    const auto one = noise<2>(1, 1), many = noise<2>(20000, 2);
    const auto pairs = pair<2>(one, many);
    EXPECT_EQ(pairs.size(), 20000U);
    EXPECT_TRUE(checks::is_total(pairs, 1, 20000));
    EXPECT_TRUE(checks::is_total(pair<2>(many, one), 20000, 1));
}

TEST(Pairing, SameCloudPairsWithItself) {
    const auto points = noise<2>(20000, 5);
    const auto order = shapes::permutation(20000, 6);
    Points<2> shuffled(20000, 2);
    for (Index i = 0; i < 20000; ++i) shuffled.row(i) = points.row(order[to_size(i)]);
    const auto pairs = pair<2>(points, shuffled);
    ASSERT_EQ(pairs.size(), 20000U);
    for (const auto& [s, t] : pairs) EXPECT_EQ(s, order[to_size(t)]);
}

TEST(Pairing, PairsAreNear) {
    // Two independent samples of a square of area 4: nearest neighbors are ½·√(4/n) apart in the
    // mean, and no pairing of all points can be better.
    const Index count = 20000;
    const auto source = noise<2>(count, 7), target = noise<2>(count, 8);
    const double spacing = std::sqrt(4.0 / count);
    EXPECT_LT(mean_distance<2>(pair<2>(source, target), source, target), 1.5 * spacing);
    EXPECT_LT(most_partners(pair<2>(source, target)), 40);
}

TEST(Pairing, UnequalDensities) {
    // The target is crowded into a corner; still every point of both is used, and as many pairs
    // as that takes.
    const auto source = noise<2>(5000, 9);
    Points<2> target = noise<2>(5000, 10);
    target.topRows(4900) = (target.topRows(4900).array() * 1e-6 + 0.9).matrix();
    const auto pairs = pair<2>(source, target);
    EXPECT_TRUE(checks::is_total(pairs, 5000, 5000));
    EXPECT_LT(pairs.size(), 10000U);
}

TEST(Pairing, CoincidentPoints) {
    Points<2> source(3000, 2), target(2000, 2);
    source.setConstant(0.25);
    target.setConstant(0.25);
    auto pairs = pair<2>(source, target);
    EXPECT_TRUE(checks::is_total(pairs, 3000, 2000));
    EXPECT_LE(most_partners(pairs), 10);  // split by rank down to σ

    target.setConstant(-0.5);  // elsewhere
    pairs = pair<2>(source, target);
    EXPECT_TRUE(checks::is_total(pairs, 3000, 2000));
    EXPECT_LE(most_partners(pairs), 10);

    target = noise<2>(2000, 3);  // one point of the source, 3000 times, among many
    EXPECT_TRUE(checks::is_total(pair<2>(source, target), 3000, 2000));
    EXPECT_TRUE(checks::is_total(pair<2>(target, source), 2000, 3000));
}

TEST(Pairing, CloudsThatDoNotOverlap) {
    // On one line, one after the other: no plane has points of both on either side.
    Points<2> source(500, 2), target(400, 2);
    for (Index i = 0; i < 500; ++i) source.row(i) << 0.001 * i, 0.0;
    for (Index i = 0; i < 400; ++i) target.row(i) << 2.0 + 0.001 * i, 0.0;
    const auto pairs = pair<2>(source, target);
    EXPECT_TRUE(checks::is_total(pairs, 500, 400));
    EXPECT_LE(most_partners(pairs), 10);
    // The order along the line is kept but for the few within a cluster.
    for (const auto& [s, t] : pairs) EXPECT_NEAR(s / 500.0, t / 400.0, 0.03);

    Points<2> aside = noise<2>(400, 1);
    aside.col(0).array() += 5.0;
    EXPECT_TRUE(checks::is_total(pair<2>(noise<2>(500, 2), aside), 500, 400));
}

TEST(Pairing, OtherAxesAreTriedWhenTheFirstFails) {
    // Two bands above one another, far apart: across the gap no cut will do, along the bands every
    // one does, and gives pairs straight across.
    const Index count = 400;
    Points<2> source(count, 2), target(count, 2);
    for (Index i = 0; i < count; ++i) {
        source.row(i) << static_cast<double>(i) / count, 10.0;
        target.row(i) << static_cast<double>(i) / count, -10.0;
    }
    for (const auto& [s, t] : pair<2>(source, target)) EXPECT_NEAR(s, t, 10);
}

TEST(Pairing, FeaturesArePairedFirstAndKeptOut) {
    const auto source = noise<2>(1000, 1), target = noise<2>(900, 2);
    const std::vector<IndexPair> features{{3, 800}, {500, 7}, {500, 9}, {3, 800}};
    const auto pairs = pair<2>(source, target, features);
    EXPECT_TRUE(checks::is_total(pairs, 1000, 900));
    std::vector<IndexPair> of_features;
    std::ranges::copy_if(pairs, std::back_inserter(of_features), [](const IndexPair& p) {
        return p.source == 3 || p.source == 500 || p.target == 800 || p.target == 7 ||
               p.target == 9;
    });
    EXPECT_EQ(of_features, (std::vector<IndexPair>{{3, 800}, {500, 7}, {500, 9}}));
}

TEST(Pairing, OnlyFeaturesOnOneSide) {
    const auto source = noise<2>(3, 1), target = noise<2>(50, 2);
    const std::vector<IndexPair> features{{0, 10}, {1, 20}, {2, 30}};
    const auto pairs = pair<2>(source, target, features);
    EXPECT_TRUE(checks::is_total(pairs, 3, 50));
    EXPECT_EQ(pairs.size(), 50U);
    for (const auto& [s, t] : pairs) {
        if (t % 10 == 0 && t > 0 && t < 40) continue;
        for (Index other = 0; other < 3; ++other)
            EXPECT_LE((source.row(s) - target.row(t)).norm(),
                      (source.row(other) - target.row(t)).norm());
    }
    EXPECT_EQ(pair<2>(source, noise<2>(3, 3), {{0, 2}, {1, 1}, {2, 0}}),
              (Pairing{{0, 2}, {1, 1}, {2, 0}}));
    EXPECT_TRUE(checks::is_total(pair<2>(target, source, {{10, 0}, {20, 1}, {30, 2}}), 50, 3));
}

TEST(Pairing, DoesNotDependOnThreadsOrOrder) {
    const Index sources = 9000, targets = 7000;
    const auto source = noise<3>(sources, 11), target = noise<3>(targets, 12);
    const auto expected = pair<3>(source, target);
    for (const int threads : {1, 2, 5}) {
        const ThreadCount count(threads);
        EXPECT_EQ(pair<3>(source, target), expected);
    }
    const auto source_order = shapes::permutation(sources, 13);
    const auto target_order = shapes::permutation(targets, 14);
    Points<3> shuffled_source(sources, 3), shuffled_target(targets, 3);
    for (Index i = 0; i < sources; ++i)
        shuffled_source.row(i) = source.row(source_order[to_size(i)]);
    for (Index i = 0; i < targets; ++i)
        shuffled_target.row(i) = target.row(target_order[to_size(i)]);
    auto shuffled = pair<3>(shuffled_source, shuffled_target);
    for (IndexPair& p : shuffled)
        p = {source_order[to_size(p.source)], target_order[to_size(p.target)]};
    std::ranges::sort(shuffled);
    EXPECT_EQ(shuffled, expected);
}

TEST(Pairing, DoesNotDependOnRigidMotionAndScale) {
    const auto source = noise<3>(5000, 15), target = noise<3>(5000, 16);
    const auto expected = pair<3>(source, target);
    const Matrix3 turn = shapes::rotation(17);
    for (const double scale : {1e-6, 1.0, 1e6}) {
        const Eigen::RowVector3d shift = scale * Eigen::RowVector3d(3.0, -1.0, 2.0);
        const Points<3> s = (scale * source * turn.transpose()).rowwise() + shift;
        const Points<3> t = (scale * target * turn.transpose()).rowwise() + shift;
        EXPECT_EQ(pair<3>(s, t), expected) << scale;
    }
}

TEST(Pairing, RefusesOptionsOutOfRange) {
    for (const Index size : {-1, 0, 1, 1001})
        EXPECT_THROW(pair<2>(noise<2>(5, 1), noise<2>(5, 2), {}, size), OptionError) << size;
}

TEST(Pairing, CanBeCancelled) {
    Progress progress([](std::string_view, double) { return false; });
    const auto points = noise<2>(20000, 1);
    EXPECT_THROW(pair_points<2>(points, points, {}, {}, progress), Cancelled);
}

TEST(Example, Pairing) {
    const DiskPoints source_disk = noise<2>(300, 1), target_disk = noise<2>(200, 2);
    const std::vector<IndexPair> features;
    Progress progress;
    // --- example
    const Pairing pairs = pair_points<2>(source_disk, target_disk, features, {}, progress);
    double apart = 0.0;
    for (const auto& [source, target] : pairs)
        apart += (source_disk.row(source) - target_disk.row(target)).norm();
    // --- end of the example
    EXPECT_TRUE(checks::is_total(pairs, 300, 200));
    EXPECT_NEAR(apart / static_cast<double>(pairs.size()),
                mean_distance<2>(pairs, source_disk, target_disk), 1e-12);
    EXPECT_LT(apart / static_cast<double>(pairs.size()), 0.3);
}

}  // namespace
}  // namespace pointmorph

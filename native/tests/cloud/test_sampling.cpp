#include "pointmorph/cloud/sampling.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <numeric>
#include <set>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

const Normals kNoNormals(0, 3);

std::vector<Index> sampled(const Positions& p, Index count, const std::vector<Index>& keep = {},
                           const Normals& normals = kNoNormals) {
    Progress progress;
    return blue_noise(p, normals, count, keep, progress);
}

/// Plain distance of every chosen point to the nearest other one.
Values nearest_distances(const Positions& p, const std::vector<Index>& rows) {
    const Positions chosen = gather(p, rows);
    const KdTree<3> tree(chosen);
    Values distances(chosen.rows());
    std::vector<Index> found(2);
    std::vector<double> squared(2);
    for (Index i = 0; i < chosen.rows(); ++i) {
        tree.nearest(chosen.row(i).data(), found, squared);
        distances[i] = std::sqrt(squared[1]);
    }
    return distances;
}

/// Distance of neighbors when `count` points lie on `area` in the densest packing.
double packing_distance(double area, Index count) {
    return std::sqrt(2.0 * area / (std::numbers::sqrt3 * count));
}

constexpr double kTube = 0.4;
constexpr double kTorusArea = 4.0 * std::numbers::pi * std::numbers::pi * kTube;

TEST(Sampling, ChoosesExactlyAsManyAndKeepsWhatItMust) {
    const Positions p = shapes::torus(3000, kTube);
    const std::vector<Index> keep{2999, 5, 1234, 6};
    for (const Index count : {4, 5, 500, 2999, 3000}) {
        const auto rows = sampled(p, count, keep);
        ASSERT_EQ(rows.size(), to_size(count));
        EXPECT_TRUE(std::equal(keep.begin(), keep.end(), rows.begin()));
        EXPECT_TRUE(std::is_sorted(rows.begin() + 4, rows.end()));
        const std::set<Index> different(rows.begin(), rows.end());
        EXPECT_EQ(different.size(), rows.size());
        EXPECT_GE(*different.begin(), 0);
        EXPECT_LT(*different.rbegin(), p.rows());
    }
    EXPECT_TRUE(sampled(p, 0).empty());
    EXPECT_TRUE(sampled(Positions(0, 3), 0).empty());
}

TEST(Sampling, KeepsPointsApart) {
    const Index count = 4000;
    const Positions p = shapes::torus(4 * count, kTube);
    const Values distances = nearest_distances(p, sampled(p, count));
    const double packing = packing_distance(kTorusArea, count);
    EXPECT_GT(distances.minCoeff(), 0.6 * packing);
    EXPECT_GT(distances.mean(), 0.74 * packing);

    auto random = shapes::permutation(4 * count, 3);
    random.resize(to_size(count));
    const Values by_chance = nearest_distances(p, random);
    EXPECT_GT(distances.minCoeff(), 20.0 * by_chance.minCoeff());
    EXPECT_GT(distances.mean(), 1.5 * by_chance.mean());
}

TEST(Sampling, LeavesNoHoles) {
    const Index count = 4000;
    const Positions p = shapes::torus(4 * count, kTube);
    const Positions chosen = gather(p, sampled(p, count));
    const KdTree<3> tree(chosen);
    Index row;
    double farthest = 0.0;
    for (Index i = 0; i < p.rows(); ++i) {
        double squared;
        tree.nearest(p.row(i).data(), {&row, 1}, {&squared, 1});
        farthest = std::max(farthest, std::sqrt(squared));
    }
    EXPECT_LT(farthest, 1.1 * packing_distance(kTorusArea, count));
}

TEST(Sampling, EvensOutDenseParts) {
    // Two unit squares' worth of the plane, the right one with nine times the candidates.
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    Positions p(20000, 3);
    for (Index i = 0; i < p.rows(); ++i)
        p.row(i) << uniform(random) + (i % 10 != 0), uniform(random), 0.0;
    const auto rows = sampled(p, 1000);
    const auto left = std::ranges::count_if(rows, [&](Index i) { return p(i, 0) < 1.0; });
    // Chance would leave 100 on the left; a choice of more packs a little more densely.
    EXPECT_NEAR(static_cast<double>(left), 500.0, 100.0);
}

TEST(Sampling, SamplesBothSidesOfAThinSheet) {
    // Sheets that are much closer together than the samples will be.
    const Index count = 1000;
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    Positions p(4 * count, 3);
    Normals normals(p.rows(), 3);
    for (Index i = 0; i < p.rows(); ++i) {
        const double side = i % 2 == 0 ? 1.0 : -1.0;
        p.row(i) << uniform(random), uniform(random), 1e-3 * side;
        normals.row(i) << 0.0, 0.0, side;
    }
    const auto rows = sampled(p, count, {}, normals);
    for (const Index side : {0, 1}) {
        std::vector<Index> here;
        std::ranges::copy_if(rows, std::back_inserter(here),
                             [&](Index i) { return i % 2 == side; });
        EXPECT_NEAR(static_cast<double>(here.size()), 0.5 * count, 0.03 * count);
        EXPECT_GT(nearest_distances(p, here).minCoeff(), 0.6 * packing_distance(1.0, count / 2));
    }
    EXPECT_GT(nearest_distances(p, sampled(p, count)).minCoeff(),
              0.6 * packing_distance(1.0, count));
}

TEST(Sampling, KeptPointsRepelTheOthers) {
    const Index count = 1000;
    const Positions p = shapes::torus(4 * count, kTube);
    const std::vector<Index> keep{0, 1000, 2000, 3000};
    const auto rows = sampled(p, count, keep);
    const Values distances = nearest_distances(p, rows);
    EXPECT_GT(distances.minCoeff(), 0.55 * packing_distance(kTorusArea, count));
}

TEST(Sampling, CrowdsAreThinnedOut) {
    // Two thirds of the candidates in two crowds, in one of which all coincide.
    Positions p = shapes::torus(9000, kTube);
    for (Index i = 0; i < 3000; ++i) p.row(i) = p.row(0);
    for (Index i = 3000; i < 6000; ++i) p.row(i) = p.row(8000) + 1e-3 * p.row(i);
    const auto rows = sampled(p, 800);
    EXPECT_LE(std::ranges::count_if(rows, [](Index i) { return i < 3000; }), 1);
    EXPECT_LE(std::ranges::count_if(rows, [](Index i) { return i >= 3000 && i < 6000; }), 2);
    EXPECT_EQ(sampled(p, 5000).size(), 5000u);
}

TEST(Sampling, DegenerateCandidatesGiveAsManyAsAsked) {
    EXPECT_EQ(sampled(Positions::Constant(5000, 3, 2.0), 100).size(), 100u);
    Positions line = Positions::Zero(5000, 3);
    for (Index i = 0; i < line.rows(); ++i) line(i, 1) = i;
    const auto rows = sampled(line, 100);
    EXPECT_EQ(rows.size(), 100u);
    EXPECT_GT(nearest_distances(line, rows).minCoeff(), 1.0);
    EXPECT_EQ(sampled(line, 1).size(), 1u);
    EXPECT_EQ(sampled(1e-150 * line, 100).size(), 100u);
}

TEST(Sampling, FollowsScaleAndOrderAndIgnoresThreads) {
    const Positions p = shapes::torus(4000, kTube);
    const std::vector<Index> keep{7, 70, 700};
    const auto reference = sampled(p, 1000, keep);
    EXPECT_EQ(sampled(1024.0 * p, 1000, keep), reference);
    for (const int threads : {1, 4}) {
        const ThreadCount scope(threads);
        EXPECT_EQ(sampled(p, 1000, keep), reference);
    }

    const auto order = shapes::permutation(4000, 8);
    const auto rank = inverse_order(order);
    std::vector<Index> other_keep, other;
    for (const Index row : keep) other_keep.push_back(rank[to_size(row)]);
    for (const Index row : sampled(gather(p, order), 1000, other_keep))
        other.push_back(order[to_size(row)]);
    EXPECT_TRUE(std::equal(keep.begin(), keep.end(), other.begin()));
    std::sort(other.begin() + 3, other.end());
    EXPECT_EQ(other, reference);
}

TEST(Sampling, RefusesWhatCannotBe) {
    const Positions p = shapes::cube_noise(10);
    EXPECT_THROW(sampled(p, 11), OptionError);
    EXPECT_THROW(sampled(p, -1), OptionError);
    EXPECT_THROW(sampled(p, 2, {1, 2, 3}), OptionError);
    EXPECT_THROW(sampled(p, 5, {1, 10}), OptionError);
    EXPECT_THROW(sampled(p, 5, {-1}), OptionError);
    EXPECT_THROW(sampled(p, 5, {3, 3}), OptionError);
}

TEST(Sampling, CanBeCancelledAtAnyTime) {
    const Positions p = shapes::torus(100000, kTube);
    for (int calls = 1; calls < 4; ++calls) {
        Progress progress([left = calls](std::string_view, double) mutable { return --left > 0; });
        EXPECT_THROW(blue_noise(p, kNoNormals, 20000, {}, progress), Cancelled);
    }
}

TEST(Example, Sampling) {
    const Positions candidates = shapes::sphere(800);
    const Normals& normals = candidates;
    const std::vector<Index> features{3, 500};
    Progress progress;
    // --- example
    const std::vector<Index> rows = blue_noise(candidates, normals, 200, features, progress);
    const Positions samples = gather(candidates, rows);
    // --- end of the example
    EXPECT_EQ(samples.rows(), 200);
    for (const Index feature : features) EXPECT_EQ(std::ranges::count(rows, feature), 1);
    EXPECT_GT(nearest_distances(candidates, rows).minCoeff(),
              0.5 * packing_distance(4.0 * std::numbers::pi, 200));
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/cloud/lod.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <numeric>
#include <set>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

using Clusters = std::set<std::vector<Index>>;

std::vector<Index> all_rows(const Positions& p) {
    std::vector<Index> rows(to_size(p.rows()));
    std::iota(rows.begin(), rows.end(), 0);
    return rows;
}

Lod simplified(const Positions& p, std::span<const Index> rows, Index max_size) {
    Progress progress;
    return simplify(p, rows, {max_size}, progress);
}

Lod simplified(const Positions& p, Index max_size) {
    return simplified(p, all_rows(p), max_size);
}

Clusters clusters(const Lod& lod) {
    Clusters result;
    for (Index c = 0; c < lod.size(); ++c) result.emplace(lod[c].begin(), lod[c].end());
    return result;
}

/// The paper's step, word by word.
void split(const Positions& p, std::vector<Index> rows, std::size_t max_size, Clusters& result) {
    if (rows.size() <= max_size) {
        std::ranges::sort(rows);
        result.insert(rows);
        return;
    }
    const Positions chosen = gather(p, rows);
    const Eigen::RowVector3d centroid = chosen.colwise().mean();
    const Positions centered = chosen.rowwise() - centroid;
    const Eigen::SelfAdjointEigenSolver<Matrix3> eigen(Matrix3(centered.transpose() * centered));
    const Vector3 v2 = eigen.eigenvectors().col(2);
    std::vector<Index> halves[2];
    for (std::size_t i = 0; i < rows.size(); ++i)
        halves[centered.row(to_index(i)).dot(v2) > 0.0].push_back(rows[i]);
    for (const auto& half : halves) split(p, half, max_size, result);
}

void expect_partition(const Lod& lod, const Positions& p, std::span<const Index> rows,
                      Index max_size) {
    ASSERT_EQ(lod.cluster.size(), rows.size());
    ASSERT_EQ(lod.offsets.size(), to_size(lod.size()) + 1);
    ASSERT_EQ(lod.offsets.front(), 0);
    ASSERT_EQ(lod.offsets.back(), to_index(rows.size()));
    for (Index c = 0; c < lod.size(); ++c) {
        ASSERT_GE(lod[c].size(), 1u);
        ASSERT_LE(lod[c].size(), to_size(max_size));
        const Positions members = gather(p, lod[c]);
        const double scale = 1.0 + members.cwiseAbs().maxCoeff();
        EXPECT_LT((lod.centroids.row(c) - members.colwise().mean()).norm(), 1e-14 * scale);
    }
    std::vector<Index> seen(lod.members);
    std::ranges::sort(seen);
    std::vector<Index> expected(rows.begin(), rows.end());
    std::ranges::sort(expected);
    EXPECT_EQ(seen, expected);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const auto members = lod[lod.cluster[i]];
        EXPECT_NE(std::ranges::find(members, rows[i]), members.end());
    }
}

TEST(Lod, AgreesWithTheDefinition) {
    for (const Index max_size : {1, 5, 12, 100}) {
        for (const Positions& p : {shapes::torus(6000, 0.4), shapes::cube_noise(3000)}) {
            const Lod lod = simplified(p, max_size);
            expect_partition(lod, p, all_rows(p), max_size);
            Clusters expected;
            split(p, all_rows(p), to_size(max_size), expected);
            EXPECT_EQ(clusters(lod), expected);
        }
    }
}

TEST(Lod, TakesSomeRowsInAnyOrder) {
    const Positions p = shapes::torus(5000, 0.4);
    auto rows = shapes::permutation(5000, 11);
    rows.resize(3000);
    const Lod lod = simplified(p, rows, 12);
    expect_partition(lod, p, rows, 12);
}

TEST(Lod, ClustersAreNotMuchSmallerThanAllowed) {
    const Positions p = shapes::torus(20000, 0.4);
    const Lod lod = simplified(p, 12);
    EXPECT_GT(p.rows(), 6 * lod.size());
}

TEST(Lod, CoincidentPointsAreSplitToo) {
    Positions p = shapes::cube_noise(500);
    p.middleRows(100, 300).rowwise() = Eigen::RowVector3d(0.1, 0.2, 0.3);
    for (const Index max_size : {1, 7})
        expect_partition(simplified(p, max_size), p, all_rows(p), max_size);

    const Positions same = Positions::Constant(5000, 3, 1.0 / 3.0);
    const Lod lod = simplified(same, 8);
    expect_partition(lod, same, all_rows(same), 8);
    for (Index c = 0; c < lod.size(); ++c)  // by row, as evenly as possible
        EXPECT_EQ(lod[c].back() - lod[c].front() + 1, to_index(lod[c].size()));
    EXPECT_LE(lod.size(), 2 * 5000 / 8);
}

TEST(Lod, DegenerateCloudsEnd) {
    for (const Index count : {0, 1, 2, 40}) {
        Positions line = Positions::Zero(count, 3);
        for (Index i = 0; i < count; ++i) line.row(i) << i, 2.0 * i, -i;
        expect_partition(simplified(line, 3), line, all_rows(line), 3);
    }
    // Every split takes away one point only.
    Positions halving(1000, 3);
    for (Index i = 0; i < halving.rows(); ++i) halving.row(i) << std::ldexp(1.0, -i), 0.0, 1.0;
    expect_partition(simplified(halving, 2), halving, all_rows(halving), 2);
    // Apart by no more than rounding, far from the origin.
    Positions rounding(64, 3);
    for (Index i = 0; i < rounding.rows(); ++i)
        rounding.row(i) << 1e6, std::nextafter(1e6, i % 2 == 0 ? 0.0 : 1e9), -1e6;
    expect_partition(simplified(rounding, 3), rounding, all_rows(rounding), 3);
}

TEST(Lod, FollowsMotionAndScaleAndOrderOfThePoints) {
    const Positions p = shapes::torus(5000, 0.4);
    const Clusters reference = clusters(simplified(p, 12));
    const Positions moved = ((1e-3 * p) * shapes::rotation(2).transpose()).rowwise() +
                            Eigen::RowVector3d(0.1, 0.2, 0.3);
    EXPECT_EQ(clusters(simplified(moved, 12)), reference);

    const auto order = shapes::permutation(5000, 5);
    const Lod permuted = simplified(gather(p, order), 12);
    Clusters found;
    for (Index c = 0; c < permuted.size(); ++c) {
        std::vector<Index> members;
        for (const Index m : permuted[c]) members.push_back(order[to_size(m)]);
        std::ranges::sort(members);
        found.insert(members);
    }
    EXPECT_EQ(found, reference);
    EXPECT_LT((permuted.centroids - simplified(p, 12).centroids).cwiseAbs().maxCoeff(), 1e-14);
}

TEST(Lod, DoesNotDependOnThreads) {
    const Positions p = shapes::torus(30000, 0.4);
    Lod results[2];
    for (const int threads : {1, 4}) {
        const ThreadCount scope(threads);
        results[threads > 1] = simplified(p, 12);
    }
    EXPECT_EQ(results[0].members, results[1].members);
    EXPECT_EQ(results[0].offsets, results[1].offsets);
    EXPECT_EQ(results[0].cluster, results[1].cluster);
    EXPECT_EQ(results[0].centroids, results[1].centroids);
}

TEST(Lod, RefusesAnEmptyClusterAndCanBeCancelled) {
    const Positions p = shapes::cube_noise(10);
    EXPECT_THROW(simplified(p, 0), OptionError);
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(simplify(p, all_rows(p), {}, progress), Cancelled);
}

TEST(Example, Lod) {
    const Positions positions = shapes::sphere(500);
    const std::vector<Index> rows = all_rows(positions);
    Progress progress;
    // --- example
    const Lod lod = simplify(positions, rows, {.max_cluster_size = 12}, progress);
    const Eigen::RowVector3d centroid = lod.centroids.row(0);
    const std::span<const Index> members = lod[0];
    const Index cluster = lod.cluster[7];
    // --- end of the example
    EXPECT_LE(members.size(), 12u);
    EXPECT_LT((gather(positions, members).colwise().mean() - centroid).norm(), 1e-12);
    EXPECT_EQ(std::ranges::count(lod[cluster], rows[7]), 1);
}

}  // namespace
}  // namespace pointmorph

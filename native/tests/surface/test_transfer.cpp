#include "pointmorph/surface/transfer.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

DiskPoints plane_noise(Index count, unsigned seed) {
    return shapes::cube_noise(count, seed).leftCols<2>();
}

Positions at(const DiskPoints& samples, const Positions& values, const DiskPoints& queries) {
    Progress progress;
    return transfer<2>(KdTree<2>(samples), values, queries, {}, progress);
}

Positions linear(const DiskPoints& u) {
    Eigen::Matrix<double, 2, 3> slope;
    slope << 1.0, -2.0, 0.5, 3.0, 0.25, -1.0;
    Positions values = u * slope;
    return values.rowwise() + Eigen::RowVector3d(4.0, 5.0, 6.0);
}

TEST(Transfer, IsExactForLinearFunctions) {
    const DiskPoints samples = plane_noise(4000, 1);
    const DiskPoints queries = plane_noise(2000, 2);  // on the rim, too
    EXPECT_LT((at(samples, linear(samples), queries) - linear(queries)).cwiseAbs().maxCoeff(),
              1e-7);
    EXPECT_LT((at(samples, linear(samples), samples) - linear(samples)).cwiseAbs().maxCoeff(),
              1e-7);
}

TEST(Transfer, IsExactInSpecksAndInStretchedPlaces) {
    Eigen::Matrix2d squeeze;
    squeeze << 1.0, 0.0, 0.0, 1e-3;
    for (const double scale : {1.0, 1e-6}) {
        const DiskPoints samples = (scale * plane_noise(4000, 1) * squeeze).array() + 0.3;
        const DiskPoints queries = (0.95 * scale * plane_noise(500, 2) * squeeze).array() + 0.3;
        const double extent =
            (linear(samples).rowwise() - linear(samples).colwise().mean()).cwiseAbs().maxCoeff();
        EXPECT_LT((at(samples, linear(samples), queries) - linear(queries)).cwiseAbs().maxCoeff(),
                  1e-4 * extent)
            << scale;
    }
}

TEST(Transfer, IsExactInSpace) {
    const Positions samples = shapes::cube_noise(4000, 1), queries = shapes::cube_noise(500, 2);
    Progress progress;
    const Positions result = transfer<3>(KdTree<3>(samples), 2.0 * samples, queries, {}, progress);
    // Among random samples of space a few queries are far from all near ones.
    const auto inexact = ((result - 2.0 * queries).rowwise().norm().array() > 1e-7).count();
    EXPECT_LE(inexact, 5);
    EXPECT_LT((result - 2.0 * queries).cwiseAbs().maxCoeff(), 0.2);
}

TEST(Transfer, ErrorOfASmoothFunctionFallsWithTheSquareOfTheSpacing) {
    const auto wave = [](const DiskPoints& u) {
        Positions values(u.rows(), 3);
        values.col(0) = (3.0 * u.col(0)).array().sin();
        values.col(1) = (2.0 * u.col(1)).array().cos();
        values.col(2) = u.col(0).cwiseProduct(u.col(1));
        return values;
    };
    const DiskPoints queries = 0.9 * plane_noise(500, 2);
    const auto error = [&](Index count) {
        const DiskPoints samples = plane_noise(count, 1);
        return (at(samples, wave(samples), queries) - wave(queries)).rowwise().norm().mean();
    };
    EXPECT_LT(error(16000), error(1000) / 10.0);  // a quarter of the spacing: about 1/16
}

TEST(Transfer, IsContinuous) {
    const DiskPoints samples = plane_noise(300, 4);
    const Positions values = shapes::cube_noise(300, 5);  // as rough as can be
    const Index steps = 20000;
    DiskPoints line(steps, 2);
    for (Index i = 0; i < steps; ++i) line.row(i) << -0.9 + 1.8 * i / steps, 0.3;
    const Positions coarse = at(samples, values, line);
    DiskPoints half(2 * steps, 2);
    for (Index i = 0; i < 2 * steps; ++i) half.row(i) << -0.9 + 0.9 * i / steps, 0.3;
    const Positions fine = at(samples, values, half);
    const auto largest_step = [](const Positions& p) {
        return (p.bottomRows(p.rows() - 1) - p.topRows(p.rows() - 1)).rowwise().norm().maxCoeff();
    };
    // a step that didn't shrink with the sampling would be a jump
    EXPECT_LT(largest_step(fine), 0.75 * largest_step(coarse));
}

TEST(Transfer, IsContinuousOutsideTheSamples) {
    const DiskPoints samples = 0.2 * plane_noise(300, 4);
    const Positions values = shapes::cube_noise(300, 5);
    const Index steps = 20000;
    const auto largest_step = [&](Index count) {
        DiskPoints line(count, 2);  // past the samples, from outside to outside
        for (Index i = 0; i < count; ++i) line.row(i) << -0.9 + 1.8 * i / count, 0.19;
        const Positions p = at(samples, values, line);
        return (p.bottomRows(count - 1) - p.topRows(count - 1)).rowwise().norm().maxCoeff();
    };
    EXPECT_LT(largest_step(2 * steps), 0.75 * largest_step(steps));
}

TEST(Transfer, OrderOfTheSamplesMakesNoDifference) {
    const DiskPoints samples = plane_noise(1000, 1), queries = plane_noise(300, 2);
    const Positions values = shapes::cube_noise(1000, 3);
    const auto order = shapes::permutation(1000, 4);
    const Positions expected = at(samples, values, queries);
    EXPECT_LT((at(gather(samples, order), gather(values, order), queries) - expected)
                  .cwiseAbs()
                  .maxCoeff(),
              1e-12);
}

TEST(Transfer, DegenerateSamplesGiveFiniteValuesNearTheirs) {
    const DiskPoints queries = plane_noise(50, 3);
    DiskPoints one_place = DiskPoints::Ones(40, 2), on_a_line(40, 2);
    for (Index i = 0; i < 40; ++i) on_a_line.row(i) << i / 40.0, 0.0;
    const Positions values = shapes::cube_noise(40);
    for (const DiskPoints& samples : {one_place, on_a_line}) {
        const Positions result = at(samples, values, queries);
        ASSERT_TRUE(result.allFinite());
        EXPECT_LE(result.cwiseAbs().maxCoeff(), 11.0);  // values of ±1, standard deviations of 1
    }
    for (const Index count : {1, 2, 3, 6, 12}) {
        const DiskPoints few = plane_noise(count, 7);
        const Positions result = at(few, Positions::Constant(count, 3, 7.0), queries);
        EXPECT_LT((result.array() - 7.0).abs().maxCoeff(), 1e-9) << count;
    }
    const Positions exact = at(one_place, Positions::Constant(40, 3, 7.0), one_place);
    EXPECT_LT((exact.array() - 7.0).abs().maxCoeff(), 1e-12);
}

TEST(Transfer, FollowsALineOfSamples) {
    DiskPoints samples(400, 2), queries(100, 2);
    for (Index i = 0; i < 400; ++i) samples.row(i) << i / 400.0, i / 200.0;
    for (Index i = 0; i < 100; ++i) queries.row(i) << 0.1 + i / 130.0, 0.2 + 2 * i / 130.0;
    EXPECT_LT((at(samples, linear(samples), queries) - linear(queries)).cwiseAbs().maxCoeff(),
              1e-7);
}

TEST(Transfer, DoesNotRunAwayOutsideTheSamples) {
    const DiskPoints samples = 0.1 * plane_noise(500, 1);
    DiskPoints far(1, 2);
    far << 30.0, -20.0;
    const Positions values = linear(samples);
    const Positions result = at(samples, values, far);
    // Followed for some standard deviations of the few samples that are nearest to it.
    const Eigen::RowVector3d low = values.colwise().minCoeff(), high = values.colwise().maxCoeff();
    for (int d = 0; d < 3; ++d) {
        EXPECT_GE(result(0, d), low[d] - (high[d] - low[d]));
        EXPECT_LE(result(0, d), high[d] + (high[d] - low[d]));
    }
}

TEST(Transfer, SameBitsForAnyNumberOfThreads) {
    const DiskPoints samples = plane_noise(3000, 1), queries = plane_noise(3000, 2);
    Positions one, three;
    {
        const ThreadCount threads(1);
        one = at(samples, linear(samples), queries);
    }
    {
        const ThreadCount threads(3);
        three = at(samples, linear(samples), queries);
    }
    EXPECT_EQ(one, three);
}

TEST(Transfer, RefusesOptionsOutOfRange) {
    const DiskPoints samples = plane_noise(100, 1);
    for (const Index neighbors : {-1, 0, 5, 65}) {
        Progress progress;
        EXPECT_THROW(
            transfer<2>(KdTree<2>(samples), linear(samples), samples, {neighbors}, progress),
            OptionError)
            << neighbors;
    }
}

TEST(Transfer, CanBeCancelled) {
    const DiskPoints samples = plane_noise(3000, 1);
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(
        transfer<2>(KdTree<2>(samples), linear(samples), samples, TransferOptions{}, progress),
        Cancelled);
}

TEST(Example, Transfer) {
    const DiskPoints target_disk = plane_noise(4000, 1), source_disk = plane_noise(100, 2);
    const Positions target = linear(target_disk);
    Progress progress;
    // --- example
    const KdTree<2> tree(target_disk);
    const Positions images = transfer<2>(tree, target, source_disk, {}, progress);
    // --- end of the example
    EXPECT_LT((images - linear(source_disk)).cwiseAbs().maxCoeff(), 1e-7);
}

}  // namespace
}  // namespace pointmorph

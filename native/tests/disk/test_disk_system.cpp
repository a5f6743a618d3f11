#include "disk/disk_system.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <random>

#include "pointmorph/base/error.hpp"

using namespace pointmorph;

namespace {

/// Row of a place in a grid, blocks of 4 by 4 one after the other where `side` is divisible.
Index row_at(Index x, Index y, Index side) {
    if (side % 4 != 0) return y * side + x;
    return 16 * (y / 4 * (side / 4) + x / 4) + 4 * (y % 4) + x % 4;
}

/// A Laplacian of a square grid with random weights, tied down along one side.
Eigen::SparseMatrix<double> grid(Index side) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> weight(0.1, 2.0);
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(side * side, side * side);
    const auto tie = [&](Index i, Index j) {
        const double w = weight(random);
        matrix(i, j) -= w;
        matrix(j, i) -= w;
        matrix(i, i) += w;
        matrix(j, j) += w;
    };
    for (Index y = 0; y < side; ++y)
        for (Index x = 0; x < side; ++x) {
            const Index i = row_at(x, y, side);
            if (x + 1 < side) tie(i, row_at(x + 1, y, side));
            if (y + 1 < side) tie(i, row_at(x, y + 1, side));
            if (y == 0) matrix(i, i) += weight(random);
        }
    return matrix.sparseView();
}

DiskPoints random_sides(Eigen::Index count) {
    std::mt19937 random(4);
    std::normal_distribution<double> number;
    return DiskPoints::NullaryExpr(count, 2, [&] { return number(random); });
}

}  // namespace

TEST(DiskSystem, SolvesWhatADenseFactorSolves) {
    for (const Index side : {1, 2, 3, 5, 20, 30}) {
        const auto matrix = grid(side);
        const DiskPoints sides = random_sides(matrix.rows());
        Progress progress;
        const DiskSolution solution = solve_for_disk(matrix, sides, 1e-13, 1000, progress);
        const DiskPoints expected = Eigen::MatrixXd(matrix).ldlt().solve(sides);
        EXPECT_LE(solution.relative_residual, 1e-13) << side;
        EXPECT_LT((solution.points - expected).norm(), 1e-10 * expected.norm()) << side;
    }
}

TEST(DiskSystem, TakesHardlyMoreIterationsForMorePoints) {
    // With an incomplete factor alone it's twice as many on twice the side.
    for (const Index side : {24, 48}) {
        const auto matrix = grid(side);
        Progress progress;
        const DiskSolution solution =
            solve_for_disk(matrix, random_sides(matrix.rows()), 1e-8, 1000, progress);
        EXPECT_LE(solution.relative_residual, 1e-8);
        EXPECT_LT(solution.iterations, 36) << side;
    }
}

TEST(DiskSystem, LeavesACoordinateWithoutSidesAtZero) {
    const auto matrix = grid(12);
    DiskPoints sides = random_sides(matrix.rows());
    sides.col(1).setZero();
    Progress progress;
    const DiskSolution solution = solve_for_disk(matrix, sides, 1e-10, 1000, progress);
    EXPECT_LE(solution.relative_residual, 1e-10);
    EXPECT_EQ(solution.points.col(1).cwiseAbs().maxCoeff(), 0.0);
    EXPECT_GT(solution.points.col(0).norm(), 0.0);
    sides.setZero();
    EXPECT_EQ(solve_for_disk(matrix, sides, 1e-10, 1000, progress).iterations, 0);
}

TEST(DiskSystem, SaysHowFarItCameAndStopsWhenCancelled) {
    const auto matrix = grid(20);
    const DiskPoints sides = random_sides(matrix.rows());
    Progress progress;
    const DiskSolution early = solve_for_disk(matrix, sides, 1e-12, 3, progress);
    EXPECT_EQ(early.iterations, 3);
    const double residual = (sides - matrix * early.points)
                                .colwise()
                                .norm()
                                .cwiseQuotient(sides.colwise().norm())
                                .maxCoeff();
    EXPECT_NEAR(early.relative_residual, residual, 1e-9);
    EXPECT_GT(residual, 1e-12);

    Progress cancelled([](std::string_view, double) { return false; });
    EXPECT_THROW(solve_for_disk(matrix, sides, 1e-12, 1000, cancelled), Cancelled);
}

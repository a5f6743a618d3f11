#include "mesh/block_system.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <random>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {
namespace {

/// A ring with chords; the last vertex has no neighbors.
Laplacian graph(Index count, std::mt19937_64& random) {
    std::uniform_real_distribution<double> uniform(0.1, 2.0);
    Eigen::MatrixXd weights = Eigen::MatrixXd::Zero(count, count);
    for (Index i = 0; i + 1 < count; ++i)
        for (const Index step : {1, 7}) {
            const Index j = (i + step) % (count - 1);
            if (i != j) weights(i, j) = weights(j, i) = uniform(random);
        }
    Laplacian result;
    for (Index i = 0; i < count; ++i) {
        double sum = 0.0;
        for (Index j = 0; j < count; ++j) {
            if (!(weights(i, j) > 0.0)) continue;
            result.neighbors.push_back(j);
            result.weights.push_back(weights(i, j));
            sum += weights(i, j);
        }
        result.sums.push_back(sum);
        result.offsets.push_back(to_index(result.neighbors.size()));
    }
    return result;
}

struct System {
    Laplacian laplacian;
    std::vector<SymmetricBlock> blocks;
    Positions right, start;

    explicit System(Index count) {
        std::mt19937_64 random(1);
        std::normal_distribution<double> normal;
        laplacian = graph(count, random);
        right = Positions::NullaryExpr(count, 3, [&] { return normal(random); });
        start = Positions::NullaryExpr(count, 3, [&] { return normal(random); });
        for (Index i = 0; i < count; ++i) {
            const Vector3 n(normal(random), normal(random), normal(random));
            blocks.emplace_back();
            if (i + 1 < count) blocks.back().add_along(n, 1.0);
        }
    }

    Positions by_dense_factorization() const {
        const Index count = laplacian.size();
        Eigen::MatrixXd all = Eigen::MatrixXd::Zero(3 * count, 3 * count);
        for (Index i = 0; i < count; ++i) {
            all.block<3, 3>(3 * i, 3 * i) =
                blocks[to_size(i)].full() + laplacian.sums[to_size(i)] * Matrix3::Identity();
            for (Index k = laplacian.offsets[to_size(i)]; k < laplacian.offsets[to_size(i) + 1];
                 ++k)
                all.block<3, 3>(3 * i, 3 * laplacian.neighbors[to_size(k)]) =
                    -laplacian.weights[to_size(k)] * Matrix3::Identity();
        }
        const Index free = 3 * (count - 1);
        Positions x = start;
        const Eigen::VectorXd solution =
            all.topLeftCorner(free, free)
                .ldlt()
                .solve(Eigen::Map<const Eigen::VectorXd>(right.data(), free));
        Eigen::Map<Eigen::VectorXd>(x.data(), free) = solution;
        return x;
    }
};

TEST(BlockSystem, BlocksAreSymmetricMatrices) {
    const Vector3 n(0.3, -1.2, 2.0), v(-0.7, 0.4, 1.1);
    SymmetricBlock block;
    block.add_along(n, 1.5);
    block.add_isotropic(0.25);
    const Matrix3 expected = 1.5 * n * n.transpose() + 0.25 * Matrix3::Identity();
    EXPECT_LT((block.full() - expected).norm(), 1e-15);
    EXPECT_LT((block * v - expected * v).norm(), 1e-14);
}

TEST(BlockSystem, IsSolvedAsByAFactorization) {
    const System system(60);
    Positions x = system.start;
    Progress progress;
    solve(system.laplacian, system.blocks, system.right,
          {.most_iterations = 1000, .tolerance = 1e-12}, x, progress);
    EXPECT_LT((x - system.by_dense_factorization()).norm(), 1e-8);
    EXPECT_EQ(x.bottomRows(1), system.start.bottomRows(1));  // nothing holds it
}

TEST(BlockSystem, StopsAtTheIterationsAllowed) {
    const System system(60);
    Positions x = system.start;
    Progress progress;
    EXPECT_EQ(solve(system.laplacian, system.blocks, system.right,
                    {.most_iterations = 3, .tolerance = 0.0}, x, progress),
              3);
}

TEST(BlockSystem, IsTheSameForAnyNumberOfThreads) {
    const System system(1500);
    const auto solved = [&] {
        Positions x = system.start;
        Progress progress;
        solve(system.laplacian, system.blocks, system.right, {}, x, progress);
        return x;
    };
    const Positions all = solved();
    const ThreadCount one(1);
    EXPECT_EQ(solved(), all);
}

TEST(BlockSystem, CanBeCancelled) {
    const System system(60);
    Positions x = system.start;
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(solve(system.laplacian, system.blocks, system.right, {}, x, progress), Cancelled);
}

}  // namespace
}  // namespace pointmorph

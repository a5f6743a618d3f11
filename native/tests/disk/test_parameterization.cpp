#include "pointmorph/disk/parameterization.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

/// An open patch with analytic normals and its boundary.
struct OpenPatch {
    Positions positions;
    Normals normals;
    BoundaryLoop loop;
    Neighborhoods nearest;

    OpenPatch(Positions p, Normals n, BoundaryLoop l)
        : positions(std::move(p)), normals(std::move(n)), loop(std::move(l)) {
        Progress progress;
        nearest = nearest_neighbors(KdTree<3>(positions), 16, progress);
    }
};

/// Upper half of the unit sphere, `count` points and a rim of evenly spaced ones.
OpenPatch hemisphere(Index count) {
    const auto rim =
        to_index(std::lround(2 * std::numbers::pi * std::sqrt(count / (2 * std::numbers::pi))));
    Positions p(count + rim, 3);
    p.topRows(count) = shapes::sphere(count, 0.02);
    BoundaryLoop loop;
    for (Index i = 0; i < rim; ++i) {
        const double angle = 2 * std::numbers::pi * i / rim;
        p.row(count + i) << std::cos(angle), std::sin(angle), 0.0;
        loop.push_back(count + i);
    }
    return {p, p, loop};
}

OpenPatch square(Index side) {
    Normals up = Normals::Zero(side * side, 3);
    up.col(2).setOnes();
    return {shapes::grid(side), up, shapes::grid_border(side)};
}

Parameterization onto_disk(const OpenPatch& patch, const ParameterizationOptions& options = {},
                           Progress* progress = nullptr) {
    Progress silent;
    const auto angles = boundary_angles(patch.positions, patch.loop, options.boundary_spacing, {});
    return parameterize({patch.positions, patch.normals, patch.nearest, "patch"},
                        {patch.loop, angles}, options, progress ? *progress : silent);
}

ParameterizationOptions full() {
    ParameterizationOptions options;
    options.solve = SolveMode::kFull;
    options.tolerance = 1e-12;
    return options;
}

TEST(BoundaryAngles, ChordLengthIsProportionalToLength) {
    const OpenPatch patch = square(11);
    const auto angles =
        boundary_angles(patch.positions, patch.loop, BoundarySpacing::kChordLength, {});
    for (std::size_t i = 0; i < angles.size(); ++i)
        EXPECT_NEAR(angles[i], 2 * std::numbers::pi * i / 40, 1e-12);
}

TEST(BoundaryAngles, UniformIgnoresLength) {
    Positions p(4, 3);
    p << 0, 0, 0, 1, 0, 0, 1, 7, 0, 0, 7, 0;
    const std::vector<Index> loop{0, 1, 2, 3};
    const auto uniform = boundary_angles(p, loop, BoundarySpacing::kUniform, {});
    const auto chord = boundary_angles(p, loop, BoundarySpacing::kChordLength, {});
    for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(uniform[i], std::numbers::pi / 2 * i, 1e-12);
    EXPECT_NEAR(chord[1], 2 * std::numbers::pi / 16, 1e-12);
    EXPECT_NEAR(chord[2], 2 * std::numbers::pi * 8 / 16, 1e-12);
}

TEST(BoundaryAngles, PinsAreMetAndTheRestSpreadBetweenThem) {
    const OpenPatch patch = square(11);
    const std::vector<BoundaryPin> pins{{5, 0.5}, {20, 1.0}, {35, 4.0}};
    const auto angles =
        boundary_angles(patch.positions, patch.loop, BoundarySpacing::kChordLength, pins);
    for (const auto& pin : pins) EXPECT_NEAR(angles[to_size(pin.position)], pin.angle, 1e-12);
    for (std::size_t i = 5; i < 20; ++i) EXPECT_NEAR(angles[i + 1] - angles[i], 0.5 / 15, 1e-12);
    const double last = (0.5 + 2 * std::numbers::pi - 4.0) / 10;
    EXPECT_NEAR(angles[36] - 4.0, last, 1e-12);
    EXPECT_NEAR(angles[0] - 4.0, 5 * last, 1e-12);
}

TEST(BoundaryAngles, CoincidentBoundaryPointsAreSpreadEvenly) {
    const Positions p = Positions::Ones(8, 3);
    const std::vector<Index> loop{0, 1, 2, 3, 4, 5, 6, 7};
    const auto angles = boundary_angles(p, loop, BoundarySpacing::kChordLength, {});
    for (std::size_t i = 0; i < 8; ++i) EXPECT_NEAR(angles[i], 2 * std::numbers::pi * i / 8, 1e-12);
}

TEST(BoundaryAngles, DisorderedPinsAreRefused) {
    const OpenPatch patch = square(11);
    const auto angles = [&](std::vector<BoundaryPin> pins) {
        return boundary_angles(patch.positions, patch.loop, BoundarySpacing::kUniform, pins);
    };
    EXPECT_THROW(angles({{5, 1.0}, {4, 2.0}}), FeatureError);
    EXPECT_THROW(angles({{5, 1.0}, {6, 0.5}}), FeatureError);
    EXPECT_THROW(angles({{5, 1.0}, {6, 8.0}}), FeatureError);
    EXPECT_THROW(angles({{40, 1.0}}), FeatureError);
    EXPECT_THROW(angles({{-1, 1.0}}), FeatureError);
}

TEST(MatchPins, TheSameLoopShiftedMeetsItself) {
    const OpenPatch patch = square(11);
    BoundaryLoop shifted = patch.loop;
    std::ranges::rotate(shifted, shifted.begin() + 13);
    std::vector<IndexPair> features;
    for (const Index i : {2, 12, 17, 31}) features.push_back({i, (i - 13 + 40) % 40});
    const auto pins = match_pins(patch.positions, patch.loop, patch.positions, shifted,
                                 BoundarySpacing::kChordLength, features);
    const auto a =
        boundary_angles(patch.positions, patch.loop, BoundarySpacing::kChordLength, pins.source);
    const auto b =
        boundary_angles(patch.positions, shifted, BoundarySpacing::kChordLength, pins.target);
    for (std::size_t i = 0; i < 40; ++i)  // every point, not only the pins
        EXPECT_NEAR(std::remainder(a[(i + 13) % 40] - b[i], 2 * std::numbers::pi), 0.0, 1e-12);
}

TEST(MatchPins, FeaturesShareAnAngleOnAnyTwoLoops) {
    const OpenPatch source = square(11);
    const OpenPatch target = hemisphere(500);
    const auto n = to_index(target.loop.size());
    const std::vector<IndexPair> features{{30, 2}, {1, n / 3}, {12, n / 2}, {16, n - 3}};
    const auto pins = match_pins(source.positions, source.loop, target.positions, target.loop,
                                 BoundarySpacing::kChordLength, features);
    const auto a =
        boundary_angles(source.positions, source.loop, BoundarySpacing::kChordLength, pins.source);
    const auto b =
        boundary_angles(target.positions, target.loop, BoundarySpacing::kChordLength, pins.target);
    for (const auto& [s, t] : features)
        EXPECT_NEAR(std::remainder(a[s] - b[t], 2 * std::numbers::pi), 0.0, 1e-12);
}

TEST(MatchPins, AnotherOrderIsRefused) {
    const OpenPatch patch = square(11);
    const auto match = [&](std::vector<IndexPair> features) {
        return match_pins(patch.positions, patch.loop, patch.positions, patch.loop,
                          BoundarySpacing::kUniform, features);
    };
    EXPECT_THROW(match({{0, 0}, {10, 20}, {20, 10}}), FeatureError);
    EXPECT_THROW(match({{0, 5}, {10, 5}}), FeatureError);
    EXPECT_THROW(match({{3, 5}, {3, 8}}), FeatureError);
    EXPECT_NO_THROW(match({{0, 5}, {10, 20}}));
    EXPECT_TRUE(match({}).source.empty());
}

TEST(Parameterization, APatchWithoutPointsInsideIsItsBoundary) {
    const Positions ring = shapes::grid(2);
    const Normals up = Eigen::RowVector3d(0, 0, 1).replicate(4, 1);
    const std::vector<Index> loop{0, 2, 3, 1};
    const std::vector<double> angles{0.0, 1.5, 3.0, 4.5};
    Progress progress;
    for (const SolveMode mode : {SolveMode::kLod, SolveMode::kFull}) {
        ParameterizationOptions options;
        options.solve = mode;
        const DiskPoints disk =
            parameterize({ring, up, {}, "ring"}, {loop, angles}, options, progress).points;
        for (std::size_t i = 0; i < loop.size(); ++i)
            EXPECT_EQ(disk.row(loop[i]),
                      Eigen::RowVector2d(std::cos(angles[i]), std::sin(angles[i])));
    }
}

TEST(Parameterization, EveryInteriorPointIsAConvexCombinationOfItsNeighbors) {
    const OpenPatch patch = hemisphere(800);
    const auto options = full();
    const auto result = onto_disk(patch, options);
    // the relation of the system: ten nearest, made mutual (no sheet is thin here)
    std::vector<std::vector<Index>> mutual(to_size(patch.positions.rows()));
    for (Index i = 0; i < patch.positions.rows(); ++i)
        for (const Index j : patch.nearest[i].first(10)) {
            mutual[to_size(i)].push_back(j);
            mutual[to_size(j)].push_back(i);
        }
    for (Index i = 0; i < 800; ++i) {
        auto& near = mutual[to_size(i)];
        std::ranges::sort(near);
        near.erase(std::ranges::unique(near).begin(), near.end());
        Eigen::RowVector2d mean = Eigen::RowVector2d::Zero();
        double sum = 0.0;
        for (const Index j : near) {
            const double weight = 1.0 / (patch.positions.row(i) - patch.positions.row(j)).norm();
            mean += weight * result.points.row(j);
            sum += weight;
        }
        EXPECT_LT((mean / sum - result.points.row(i)).norm(), 1e-9);
    }
    EXPECT_EQ(result.unknowns, 800);
    EXPECT_GT(result.iterations, 0);
    EXPECT_LE(result.relative_residual, 1e-12);
}

TEST(Parameterization, BoundaryIsOnTheCircleAndTheRestInside) {
    for (const SolveMode solve : {SolveMode::kFull, SolveMode::kLod}) {
        const OpenPatch patch = hemisphere(3000);
        ParameterizationOptions options;
        options.solve = solve;
        const auto result = onto_disk(patch, options);
        ASSERT_TRUE(result.points.allFinite());
        for (Index i = 0; i < 3000; ++i) EXPECT_LT(result.points.row(i).norm(), 1.0);
        for (const Index i : patch.loop) EXPECT_NEAR(result.points.row(i).norm(), 1.0, 1e-12);
    }
}

TEST(Parameterization, AHemisphereKeepsItsSymmetry) {
    const OpenPatch patch = hemisphere(4000);
    for (const auto& options : {full(), ParameterizationOptions{}}) {
        const auto result = onto_disk(patch, options);
        const double spacing =
            3.0 * std::sqrt(std::numbers::pi / result.unknowns);  // of what was solved for
        for (Index i = 0; i < 4000; ++i) {
            // every point stays on its meridian, up to the unevenness of the sampling
            const Eigen::RowVector2d meridian = patch.positions.row(i).head<2>().normalized();
            const auto& u = result.points.row(i);
            EXPECT_LT(std::abs(meridian.x() * u.y() - meridian.y() * u.x()), spacing);
        }
        EXPECT_LT(result.points.row(0).norm(), 0.05);  // the pole
    }
}

TEST(Parameterization, TheSimplifiedSolutionComesCloserToTheFullOneAsItGetsFiner) {
    const OpenPatch patch = hemisphere(8000);
    const auto exact = onto_disk(patch, full());
    std::vector<double> error;
    for (const Index size : {64, 16, 4}) {
        ParameterizationOptions options;
        options.lod.max_cluster_size = size;
        const auto result = onto_disk(patch, options);
        EXPECT_LT(result.unknowns, exact.unknowns);
        error.push_back((result.points - exact.points).rowwise().norm().mean());
    }
    EXPECT_LT(error[1], error[0]);
    EXPECT_LT(error[2], error[1]);
    EXPECT_LT(error[1], 0.06);
}

TEST(Parameterization, RadiusNeighborhoodsGiveAboutTheSame) {
    const OpenPatch patch = hemisphere(3000);
    ParameterizationOptions ball;
    ball.radius = 2.2;
    const auto a = onto_disk(patch), b = onto_disk(patch, ball);
    EXPECT_LT((a.points - b.points).rowwise().norm().mean(), 0.05);
}

TEST(Parameterization, DoesNotDependOnPoseSizeOrThreads) {
    const OpenPatch patch = hemisphere(2000);
    const Matrix3 turn = shapes::rotation(5);
    const OpenPatch moved(
        (patch.positions * turn.transpose() * 250.0).rowwise() + Eigen::RowVector3d(3, -1, 2),
        patch.normals * turn.transpose(), patch.loop);
    EXPECT_LT((onto_disk(patch, full()).points - onto_disk(moved, full()).points)
                  .rowwise()
                  .norm()
                  .maxCoeff(),
              1e-6);
    DiskPoints one, many;
    {
        const ThreadCount threads(1);
        one = onto_disk(patch).points;
    }
    {
        const ThreadCount threads(3);
        many = onto_disk(patch).points;
    }
    EXPECT_EQ(one, many);
}

TEST(Parameterization, CoincidentPointsStayFiniteAndTogether) {
    const OpenPatch once = square(21);
    Positions p(2 * 441, 3);
    p << once.positions, once.positions;
    Normals n(2 * 441, 3);
    n << once.normals, once.normals;
    const OpenPatch twice(p, n, once.loop);
    for (const auto& options : {full(), ParameterizationOptions{}}) {
        const auto result = onto_disk(twice, options);
        ASSERT_TRUE(result.points.allFinite());
        EXPECT_LE(result.points.rowwise().norm().maxCoeff(), 1.0 + 1e-12);
    }
}

TEST(Parameterization, OnlyABoundary) {
    Positions p(12, 3);
    BoundaryLoop loop;
    for (Index i = 0; i < 12; ++i) {
        p.row(i) << std::cos(i * std::numbers::pi / 6), std::sin(i * std::numbers::pi / 6), 0.0;
        loop.push_back(i);
    }
    Normals up = Normals::Zero(12, 3);
    up.col(2).setOnes();
    const auto result = onto_disk(OpenPatch(p, up, loop));
    for (Index i = 0; i < 12; ++i) EXPECT_NEAR(result.points.row(i).norm(), 1.0, 1e-12);
    EXPECT_EQ(result.unknowns, 0);
}

TEST(Parameterization, PartsThatDoNotReachTheBoundaryAreRefused) {
    const OpenPatch one = square(21);
    Positions p(2 * 441, 3);
    p << one.positions, one.positions.rowwise() + Eigen::RowVector3d(40, 0, 0);
    Normals n(2 * 441, 3);
    n << one.normals, one.normals;
    const OpenPatch apart(p, n, one.loop);
    try {
        onto_disk(apart);
        FAIL();
    } catch (const TopologyError& error) {
        EXPECT_NE(std::string(error.what()).find("441 points"), std::string::npos) << error.what();
        EXPECT_NE(std::string(error.what()).find("patch"), std::string::npos);
    }
}

TEST(Parameterization, TooFewIterationsAreSaid) {
    auto options = full();
    options.max_iterations = 2;
    EXPECT_THROW(onto_disk(hemisphere(2000), options), ConvergenceError);
}

TEST(Parameterization, CancelWorksInsideTheSolver) {
    const OpenPatch patch = hemisphere(20000);
    Progress progress([](std::string_view, double fraction) { return fraction < 0.3; },
                      std::chrono::milliseconds{0});
    progress.enter("parameterization");
    EXPECT_THROW(onto_disk(patch, full(), &progress), Cancelled);
}

TEST(Parameterization, TiesSeparatePartsToTheRestWhereAsked) {
    constexpr Index kSide = 25, kBall = 400;
    Positions p(kSide * kSide + kBall, 3);
    p.topRows(kSide * kSide) = shapes::grid(kSide);
    p.bottomRows(kBall) = 0.05 * shapes::sphere(kBall);  // floats above the middle
    p.bottomRows(kBall).col(2).array() += 0.6;
    const Normals n = Eigen::RowVector3d(0, 0, 1).replicate(p.rows(), 1);
    Progress progress;
    const Neighborhoods nearest = nearest_neighbors(KdTree<3>(p), 16, progress);
    const auto loop = shapes::grid_border(kSide);
    const auto angles = boundary_angles(p, loop, BoundarySpacing::kChordLength, {});
    for (const SolveMode solve : {SolveMode::kFull, SolveMode::kLod}) {
        ParameterizationOptions options;
        options.solve = solve;
        EXPECT_THROW(parameterize({p, n, nearest, "grid"}, {loop, angles}, options, progress),
                     TopologyError);
        options.join_parts = true;
        const auto result =
            parameterize({p, n, nearest, "grid"}, {loop, angles}, options, progress);
        EXPECT_EQ(result.joined, kBall);
        EXPECT_TRUE(result.points.allFinite());
        for (Index i = kSide * kSide; i < p.rows(); ++i)
            EXPECT_LT(result.points.row(i).norm(), 0.3);  // where it floats
    }
}

TEST(Example, Parameterization) {
    const OpenPatch half = hemisphere(1500);
    const Positions& positions = half.positions;
    const Normals& normals = half.normals;
    const Neighborhoods& nearest = half.nearest;
    const BoundaryLoop& loop = half.loop;
    Progress progress;
    // --- example
    const auto angles = boundary_angles(positions, loop, BoundarySpacing::kChordLength, {});
    const Parameterization disk =
        parameterize({positions, normals, nearest}, {loop, angles}, {}, progress);
    const Eigen::RowVector2d place = disk.points.row(0);
    // --- end of the example
    EXPECT_LT(place.norm(), 0.1);  // the pole
    EXPECT_LE(disk.points.rowwise().norm().maxCoeff(), 1.0 + 1e-9);
}

}  // namespace
}  // namespace pointmorph

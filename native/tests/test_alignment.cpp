#include "pointmorph/alignment.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>

#include "pointmorph/error.hpp"
#include "pointmorph/parallel.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

constexpr double kPi = std::numbers::pi;

/// Rings of points from the centre to the circle, with the triangles between them.
struct Rings {
    DiskPoints points;
    std::vector<std::array<Index, 3>> triangles;
    Index first_on_circle;

    explicit Rings(Index rings) {
        const Index around = 6 * rings;
        points.resize(1 + rings * around, 2);
        points.row(0).setZero();
        const auto at = [&](Index ring, Index i) { return 1 + (ring - 1) * around + i % around; };
        for (Index ring = 1; ring <= rings; ++ring)
            for (Index i = 0; i < around; ++i) {
                const double angle = 2 * kPi * i / around, r = double(ring) / rings;
                points.row(at(ring, i)) << r * std::cos(angle), r * std::sin(angle);
            }
        for (Index i = 0; i < around; ++i) triangles.push_back({0, at(1, i), at(1, i + 1)});
        for (Index ring = 1; ring < rings; ++ring)
            for (Index i = 0; i < around; ++i) {
                triangles.push_back({at(ring, i), at(ring + 1, i), at(ring + 1, i + 1)});
                triangles.push_back({at(ring, i), at(ring + 1, i + 1), at(ring, i + 1)});
            }
        first_on_circle = at(rings, 0);
    }

    /// Triangles that have turned over.
    static Index flipped(const DiskPoints& p, const std::vector<std::array<Index, 3>>& triangles) {
        Index count = 0;
        for (const auto& [a, b, c] : triangles) {
            const Eigen::RowVector2d e = p.row(b) - p.row(a), f = p.row(c) - p.row(a);
            count += e.x() * f.y() - e.y() * f.x() <= 0.0;
        }
        return count;
    }
};

Alignment align(DiskPoints& source, DiskPoints& target, const std::vector<IndexPair>& features,
                AlignmentOptions options = {}, bool keep_rotation = false) {
    Progress progress;
    return align_features(source, target, features, keep_rotation, options, progress);
}

/// `count` pairs of interior points, the targets up to `distance` away from the sources.
std::vector<IndexPair> random_features(const Rings& rings, Index count, double distance,
                                       unsigned seed) {
    std::mt19937_64 random(seed);
    const auto any = [&] { return static_cast<Index>(random() % rings.first_on_circle); };
    std::vector<IndexPair> features;
    while (static_cast<Index>(features.size()) < count) {
        const IndexPair next{any(), any()};
        const bool fresh = std::ranges::all_of(features, [&](const IndexPair& f) {
            return f.source != next.source && f.target != next.target;
        });
        const double apart = (rings.points.row(next.source) - rings.points.row(next.target)).norm();
        if (fresh && apart < distance) features.push_back(next);
    }
    return features;
}

TEST(Alignment, RotationIsTheBestOfAll) {
    const Rings rings(12);
    const auto features = random_features(rings, 6, 2.0, 3);
    const auto misfit = [&](double angle) {
        double sum = 0.0;
        for (const auto& [s, t] : features)
            sum += (Eigen::Rotation2Dd(angle) * rings.points.row(s).transpose() -
                    rings.points.row(t).transpose())
                       .squaredNorm();
        return sum;
    };
    const double best = best_rotation(rings.points, rings.points, features);
    for (int i = 0; i < 3600; ++i) EXPECT_GE(misfit(2 * kPi * i / 3600), misfit(best) - 1e-12);
}

TEST(Alignment, ATurnedDiskIsTurnedBack) {
    const Rings rings(12);
    DiskPoints source = rings.points, target = rings.points;
    source = source * Eigen::Rotation2Dd(1.2).toRotationMatrix();
    const auto result = align(source, target, {{5, 5}, {100, 100}, {300, 300}});
    EXPECT_LT((source - target).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_NEAR(result.rotation, 1.2, 1e-9);
    EXPECT_EQ(result.sweeps, 0);
}

TEST(Alignment, FeaturesMeetWithinTheError) {
    const Rings rings(30);
    for (unsigned seed = 0; seed < 50; ++seed) {
        DiskPoints source = rings.points, target = rings.points;
        const Index count = 3 + static_cast<Index>(seed % 8);
        const auto features = random_features(rings, count, 0.25, seed);
        const auto result = align(source, target, features, {}, true);
        EXPECT_LE(result.residual, AlignmentOptions{}.error) << seed;
        for (const auto& [s, t] : features)
            EXPECT_LT((source.row(s) - target.row(t)).norm(), 1e-4) << seed;
    }
}

TEST(Alignment, TheWarpIsOneToOneAndKeepsTheDisk) {
    const Rings rings(30);
    for (unsigned seed = 0; seed < 20; ++seed) {
        DiskPoints source = rings.points, target = rings.points;
        align(source, target, random_features(rings, 4, 0.3, seed), {}, true);
        for (const DiskPoints* disk : {&source, &target}) {
            EXPECT_LE(disk->rowwise().norm().maxCoeff(), 1.0 + 1e-12);
            const auto rim = static_cast<Eigen::Index>(rings.first_on_circle);
            EXPECT_EQ(disk->bottomRows(disk->rows() - rim),
                      rings.points.bottomRows(disk->rows() - rim));
        }
    }
}

TEST(Alignment, NoTriangleTurnsOver) {
    const Rings rings(60);
    for (const double influence : {5.0, 8.0, 20.0}) {
        DiskPoints source = rings.points, target = rings.points;
        AlignmentOptions options;
        options.influence = influence;
        align(source, target, random_features(rings, 3, 0.15, 11), options, true);
        EXPECT_EQ(Rings::flipped(source, rings.triangles), 0) << influence;
        EXPECT_EQ(Rings::flipped(target, rings.triangles), 0) << influence;
    }
}

TEST(Alignment, ALargerInfluenceStretchesLess) {
    const Rings rings(40);
    const auto stretch = [&](double influence) {
        DiskPoints source = rings.points, target = rings.points;
        AlignmentOptions options;
        options.influence = influence;
        align(source, target, {{1, 3 * 240 + 1}}, options, true);
        double largest = 0.0;
        for (const auto& [a, b, c] : rings.triangles)
            largest = std::max(largest, (source.row(a) - source.row(b)).norm() /
                                            (rings.points.row(a) - rings.points.row(b)).norm());
        return largest;
    };
    EXPECT_LT(stretch(8.0), stretch(2.0));
}

TEST(Alignment, AFixedRadiusMovesNothingBeyondIt) {
    const Rings rings(40);
    DiskPoints source = rings.points, target = rings.points;
    AlignmentOptions options;
    options.influence_radius = 0.2;
    const Index s = 1, t = 2 * 240 + 1;  // 0.05 apart
    align(source, target, {{s, t}}, options, true);
    for (Index i = 0; i < source.rows(); ++i)
        if ((rings.points.row(i) - rings.points.row(s)).norm() > 0.35) {
            EXPECT_EQ(source.row(i), rings.points.row(i));
        }
    EXPECT_LT((source.row(s) - target.row(t)).norm(), 1e-4);
}

TEST(Alignment, SpecksMeetAtTheirOwnScale) {
    // two features a millionth apart, each among points of that spacing
    const Rings rings(20);
    DiskPoints source = rings.points * 1e-6, target = source;
    source.rowwise() += Eigen::RowVector2d(0.5, 0.1);
    target.rowwise() += Eigen::RowVector2d(0.2, -0.3);
    const std::vector<IndexPair> features{{100, 150}, {600, 700}, {1000, 900}};
    const auto result = align(source, target, features, {}, true);
    EXPECT_LE(result.residual, AlignmentOptions{}.error);
    for (const auto& [s, t] : features)
        EXPECT_LT((source.row(s) - target.row(t)).norm(), 1e-3 * 1e-6);
}

TEST(Alignment, NeighboursThatChangePlacesStillMeet) {
    const Rings rings(30);
    DiskPoints source = rings.points, target = rings.points;
    const auto result = align(source, target, {{200, 203}, {203, 200}}, {}, true);
    EXPECT_LE(result.residual, AlignmentOptions{}.error);
}

TEST(Alignment, FeaturesThatCannotMeetAreRefused) {
    const Rings rings(10);
    DiskPoints source = rings.points, target = rings.points;
    const Index rim = rings.first_on_circle;
    EXPECT_THROW(align(source, target, {{rim, rim + 5}}, {}, true), FeatureError);
    EXPECT_THROW(align(source, target, {{3, 4}, {3, 7}}, {}, true), FeatureError);
    EXPECT_NO_THROW(align(source, target, {{rim, rim}, {3, 4}}, {}, true));
    AlignmentOptions fold;
    fold.influence = 0.5;
    EXPECT_THROW(align(source, target, {{3, 4}}, fold), OptionError);
    AlignmentOptions hasty;
    hasty.max_sweeps = 1;
    EXPECT_THROW(align(source, target, {{3, 400}}, hasty, true), ConvergenceError);
}

TEST(Alignment, NoneOrOneFeature) {
    const Rings rings(10);
    DiskPoints source = rings.points, target = rings.points;
    EXPECT_EQ(align(source, target, {}).sweeps, 0);
    EXPECT_EQ(source, rings.points);
    align(source, target, {{50, 90}});
    EXPECT_LT((source.row(50) - target.row(90)).norm(), 1e-3);
}

TEST(Alignment, SameBitsForAnyNumberOfThreads) {
    const Rings rings(40);
    const auto features = random_features(rings, 5, 0.3, 1);
    DiskPoints one = rings.points, one_target = rings.points;
    DiskPoints three = rings.points, three_target = rings.points;
    {
        const ThreadCount threads(1);
        align(one, one_target, features);
    }
    {
        const ThreadCount threads(3);
        align(three, three_target, features);
    }
    EXPECT_EQ(one, three);
    EXPECT_EQ(one_target, three_target);
}

}  // namespace
}  // namespace pointmorph

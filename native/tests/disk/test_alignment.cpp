#include "pointmorph/disk/alignment.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// Rings of points from the center to the circle, with the triangles between them.
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
                const double angle = 2 * std::numbers::pi * i / around, r = double(ring) / rings;
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
    const auto any = [&] { return to_index(random() % rings.first_on_circle); };
    std::vector<IndexPair> features;
    while (to_index(features.size()) < count) {
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
    for (int i = 0; i < 3600; ++i)
        EXPECT_GE(misfit(2 * std::numbers::pi * i / 3600), misfit(best) - 1e-12);
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

TEST(Alignment, WithoutAnyBestRotationThereIsNone) {
    const DiskPoints zero = DiskPoints::Zero(3, 2);
    EXPECT_EQ(best_rotation(zero, zero, std::vector<IndexPair>{{0, 1}, {2, 2}}), 0.0);
    EXPECT_EQ(best_rotation(zero, zero, {}), 0.0);
    DiskPoints opposite(2, 2), same(2, 2);  // every rotation is as bad as any other
    opposite << 0.5, 0.0, -0.5, 0.0;
    same << 0.0, 0.3, 0.0, 0.3;
    EXPECT_EQ(best_rotation(opposite, same, std::vector<IndexPair>{{0, 0}, {1, 1}}), 0.0);
}

TEST(Alignment, FeaturesMeetHoweverFarTheyHaveToGo) {
    SKIP_WHERE_WATCHED();
    const Rings rings(40);
    for (unsigned seed = 0; seed < 50; ++seed)
        for (const double distance : {0.1, 0.3, 2.0}) {
            DiskPoints source = rings.points, target = rings.points;
            const Index count = 3 + to_index(seed % 18);
            const auto features = random_features(rings, count, distance, seed);
            const auto result = align(source, target, features, {}, seed % 2 == 0);
            EXPECT_LE(result.residual, AlignmentOptions{}.error) << seed << " " << distance;
            for (const auto& [s, t] : features)
                EXPECT_LT((source.row(s) - target.row(t)).norm(), 1.25e-3 / 40) << seed;
        }
}

TEST(Alignment, BoundaryPointsStayAndNothingLeavesTheDisk) {
    const Rings rings(30);
    const auto circle = rings.points.rows() - rings.first_on_circle;
    for (unsigned seed = 0; seed < 20; ++seed)
        for (const double influence : {0.6, 2.0, 8.0, 100.0}) {
            if (seed % 4 != 0 && is_watched()) continue;
            DiskPoints source = rings.points, target = rings.points;
            AlignmentOptions options;
            options.influence = influence;
            align(source, target, random_features(rings, 6, 0.5, seed), options, true);
            for (const DiskPoints* disk : {&source, &target}) {
                EXPECT_LE(disk->rowwise().norm().maxCoeff(), 1.0 + 1e-15);
                EXPECT_EQ(disk->bottomRows(circle), rings.points.bottomRows(circle));
            }
        }
}

TEST(Alignment, TheMapIsOneToOne) {
    // Triangles so small that the map is linear on them, but for the few that a crease runs
    // through: none turns over, wherever it is and however far features have to go.
    constexpr double kSide = 1e-8;
    const Index triangle_count = is_watched() ? 300 : 2000;
    const Rings rings(30);
    const auto first = rings.points.rows();
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> uniform(-0.7, 0.7);
    DiskPoints start(first + 3 * triangle_count, 2);
    start.topRows(first) = rings.points;
    for (Index i = 0; i < triangle_count; ++i) {
        const Eigen::RowVector2d corner(uniform(random), uniform(random));
        start.middleRows(first + 3 * i, 3) << corner, corner + Eigen::RowVector2d(kSide, 0.0),
            corner + Eigen::RowVector2d(0.0, kSide);
    }
    std::vector<std::array<Index, 3>> triangles;
    for (Index i = 0; i < triangle_count; ++i) {
        const auto row = to_index(first) + 3 * i;
        triangles.push_back({row, row + 1, row + 2});
    }
    for (unsigned seed = 0; seed < 20; ++seed) {
        DiskPoints source = start, target = start;
        align(source, target, random_features(rings, 3 + to_index(seed), 0.6, seed));
        EXPECT_EQ(Rings::flipped(source, triangles), 0) << seed;
        EXPECT_EQ(Rings::flipped(target, triangles), 0) << seed;
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
    double before = stretch(0.75);
    for (const double influence : {2.0, 5.0, 8.0}) {  // the paper's figure 2
        const double now = stretch(influence);
        EXPECT_LT(now, before) << influence;
        before = now;
    }
    // The source's feature goes 2/3 of the way, in ever smaller steps with the same d: along it
    // distances change by the share 2/3 ‖p‖/d.
    EXPECT_LT(before, 1.0 + 1.05 * (2.0 / 3.0) / 8.0);
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

TEST(Alignment, NeighborsThatChangePlacesStillMeet) {
    const Rings rings(30);
    DiskPoints source = rings.points, target = rings.points;
    auto result = align(source, target, {{200, 203}, {203, 200}}, {}, true);
    EXPECT_LE(result.residual, AlignmentOptions{}.error);
    source = target = rings.points;  // on one line, in the opposite order
    result = align(source, target, {{1, 1801}, {901, 901}, {1801, 1}}, {}, true);
    EXPECT_LE(result.residual, AlignmentOptions{}.error);
}

TEST(Alignment, FeaturesThatCoincideMoveNothing) {
    const Rings rings(20);
    DiskPoints source = rings.points, target = rings.points;
    const Index circle = rings.first_on_circle;
    const auto result =
        align(source, target, {{5, 5}, {700, 700}, {circle, circle}, {5, 5}}, {}, true);
    EXPECT_EQ(result.sweeps, 0);
    EXPECT_EQ(result.residual, 0.0);
    EXPECT_EQ(source, rings.points);
    EXPECT_EQ(target, rings.points);
}

TEST(Alignment, BoundaryFeaturesStayWhileOthersMeet) {
    const Rings rings(30);
    const Index circle = rings.first_on_circle;
    for (unsigned seed = 0; seed < 10; ++seed) {
        DiskPoints source = rings.points, target = rings.points;
        auto features = random_features(rings, 5, 0.3, seed);
        features.push_back({circle, circle});
        features.push_back({circle + 60, circle + 60});
        EXPECT_LE(align(source, target, features, {}, true).residual, AlignmentOptions{}.error);
    }
}

TEST(Alignment, CoincidentPointsAtAFeature) {
    // A limb that has shrunk to a point: the spacing is that of the points around.
    Rings rings(20);
    rings.points.middleRows(200, 30).rowwise() = rings.points.row(200).eval();
    DiskPoints source = rings.points, target = rings.points;
    const auto result = align(source, target, {{210, 500}, {700, 650}}, {}, true);
    EXPECT_LE(result.residual, AlignmentOptions{}.error);
    EXPECT_LT((source.row(210) - target.row(500)).norm(), 1e-3 / 20);
    EXPECT_EQ(source.row(200), source.row(229));
}

TEST(Alignment, FeaturesThatCannotMeetAreRefused) {
    const Rings rings(10);
    DiskPoints source = rings.points, target = rings.points;
    const Index circle = rings.first_on_circle;
    EXPECT_THROW(align(source, target, {{circle, circle + 5}}, {}, true), FeatureError);
    EXPECT_THROW(align(source, target, {{circle, 30}}, {}, true), FeatureError);
    EXPECT_THROW(align(source, target, {{30, circle}}, {}, true), FeatureError);
    EXPECT_THROW(align(source, target, {{3, 4}, {3, 7}}, {}, true), FeatureError);
    EXPECT_THROW(align(source, target, {{3, 7}, {4, 7}}, {}, true), FeatureError);
    EXPECT_NO_THROW(align(source, target, {{circle, circle}, {3, 4}}, {}, true));
}

TEST(Alignment, RefusesOptionsOutOfRange) {
    const Rings rings(10);
    DiskPoints source = rings.points, target = rings.points;
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const auto refuses = [&](auto&& change) {
        AlignmentOptions options;
        change(options);
        EXPECT_THROW(align(source, target, {{3, 4}}, options), OptionError);
    };
    for (const double value : {0.0, 0.5, -1.0, 1001.0, nan})
        refuses([&](AlignmentOptions& options) { options.influence = value; });
    for (const double value : {0.0, -1.0, 2.5, nan})
        refuses([&](AlignmentOptions& options) { options.influence_radius = value; });
    for (const double value : {0.0, 1e-7, 1.5, nan})
        refuses([&](AlignmentOptions& options) { options.error = value; });
    refuses([&](AlignmentOptions& options) { options.max_sweeps = 0; });
}

TEST(Alignment, AnErrorLeavesTheDisksAsTheyWere) {
    const Rings rings(10);
    DiskPoints source = rings.points, target = rings.points;
    AlignmentOptions hasty;
    hasty.max_sweeps = 1;
    EXPECT_THROW(align(source, target, {{3, 400}, {7, 70}}, hasty), ConvergenceError);
    EXPECT_EQ(source, rings.points);
    EXPECT_EQ(target, rings.points);
}

TEST(Alignment, CanBeCancelled) {
    const Rings rings(30);
    DiskPoints source = rings.points, target = rings.points;
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(
        align_features(source, target, std::vector<IndexPair>{{3, 400}}, true, {}, progress),
        Cancelled);
}

TEST(Alignment, OrderOfThePointsMakesNoDifference) {
    const Rings rings(40);
    const auto features = random_features(rings, 5, 0.3, 2);
    DiskPoints source = rings.points, target = rings.points;
    align(source, target, features);
    const auto order = shapes::permutation(to_index(rings.points.rows()), 3);
    std::vector<Index> rank(order.size());
    DiskPoints shuffled(rings.points.rows(), 2);
    for (std::size_t i = 0; i < order.size(); ++i) {
        shuffled.row(static_cast<Eigen::Index>(i)) = rings.points.row(order[i]);
        rank[to_size(order[i])] = to_index(i);
    }
    std::vector<IndexPair> renamed;
    for (const auto& [s, t] : features) renamed.push_back({rank[to_size(s)], rank[to_size(t)]});
    DiskPoints shuffled_target = shuffled;
    align(shuffled, shuffled_target, renamed);
    for (std::size_t i = 0; i < order.size(); ++i)
        EXPECT_LT((shuffled.row(static_cast<Eigen::Index>(i)) - source.row(order[i])).norm(),
                  1e-12);
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

TEST(Example, Alignment) {
    const Rings rings(12);
    DiskPoints source = rings.points, target = rings.points;
    const std::vector<IndexPair> features = random_features(rings, 4, 0.3, 3);
    Progress progress;
    // --- example
    const Alignment done = align_features(source, target, features, false,
                                          {.influence = 5.0, .influence_radius = {}}, progress);
    const bool meet = done.residual <= 1e-3;
    // --- end of the example
    EXPECT_TRUE(meet);
    for (const auto& [s, t] : features)
        EXPECT_LE((source.row(s) - target.row(t)).norm(), done.residual + 1e-12);
}

}  // namespace
}  // namespace pointmorph

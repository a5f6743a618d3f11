#include "pointmorph/frames/motion.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <numbers>
#include <optional>
#include <utility>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

Matrix3 turn(double angle) {
    return Eigen::AngleAxisd(angle, Vector3(1, 2, 3).normalized()).toRotationMatrix();
}

/// A thin bar along x from −1 to 1, with its normals.
struct Bar {
    Positions positions{2400, 3};
    Normals normals{2400, 3};

    Bar() {
        for (Index i = 0; i < 2400; ++i) {
            const double angle = 2 * std::numbers::pi * (i % 24) / 24.0;
            const Vector3 out(0, std::cos(angle), std::sin(angle));
            normals.row(i) = out;
            positions.row(i) = 0.1 * out;
            positions(i, 0) = -1.0 + 2.0 * (i / 24) / 99.0;
        }
    }

    /// The part right of the middle turned up by `angle`, with an even bend of radius 0.3.
    static Vector3 bent(const Vector3& p, double angle) {
        constexpr double kRadius = 0.3;
        const double length = kRadius * angle, along = std::clamp(p.x(), 0.0, length);
        const double a = length > 0 ? along / kRadius : 0.0;
        const Vector3 axis(kRadius * std::sin(a), kRadius * (1 - std::cos(a)), 0);
        const Vector3 rest(p.x() - along, p.y(), p.z());
        return axis + Eigen::AngleAxisd(a, Vector3::UnitZ()) * rest;
    }
    Positions bent(double angle) const {
        Positions result(positions.rows(), 3);
        for (Index i = 0; i < positions.rows(); ++i)
            result.row(i) = bent(positions.row(i).transpose(), angle);
        return result;
    }
};

TEST(Motion, ATurnedAndGrownShapeTurnsAndGrowsEvenly) {
    const Positions ball = shapes::sphere(800).rowwise() + Eigen::RowVector3d(3, 1, 0);
    const Similarity whole{4.0, turn(2.0), Vector3(1, -5, 2)};
    const GradualSimilarity similarity{whole, ball.colwise().mean().transpose()};
    Progress progress;
    for (const PathKind path : {PathKind::kSimilarity, PathKind::kRigid}) {
        const Motion motion(ball, shapes::sphere(800), whole.apply(ball), similarity, path,
                            progress);
        for (const double t : {0.0, 0.25, 0.5, 1.0}) {
            const OrientedPoints at = motion.at(t);
            const Vector3 center = (1 - t) * similarity.center +
                                   t * (4.0 * (turn(2.0) * similarity.center) + whole.translation);
            const Positions expected =
                (std::pow(4.0, t) * (ball.rowwise() - similarity.center.transpose()) *
                 turn(2.0 * t).transpose())
                    .rowwise() +
                center.transpose();
            EXPECT_LT((at.positions - expected).cwiseAbs().maxCoeff(), 1e-6)
                << t << static_cast<int>(path);
            EXPECT_LT((at.normals - shapes::sphere(800) * turn(2.0 * t).transpose())
                          .cwiseAbs()
                          .maxCoeff(),
                      1e-5);
        }
    }
}

TEST(Motion, ALinearPathIsStraight) {
    const Bar bar;
    const Positions from = bar.positions.rowwise() + Eigen::RowVector3d(3, 1, 0);
    const Positions to = 4.0 * bar.bent(2.0);
    const GradualSimilarity similarity{fit_similarity(from, to), from.colwise().mean().transpose()};
    Progress progress;
    const Motion motion(from, bar.normals, to, similarity, PathKind::kLinear, progress);
    for (const double t : {0.0, 0.3, 1.0}) {
        const OrientedPoints at = motion.at(t);
        EXPECT_LT((at.positions - ((1 - t) * from + t * to)).cwiseAbs().maxCoeff(), 1e-12);
        EXPECT_LT((at.normals - bar.normals).cwiseAbs().maxCoeff(), 1e-7);  // floats
    }
}

TEST(Motion, ALimbSwingsInsteadOfShrinking) {
    const Bar bar;
    const double angle = 2.0;
    Progress progress;
    const auto worst_shrink = [&](PathKind path) {
        const Motion motion(bar.positions, bar.normals, bar.bent(angle), {{}, Vector3::Zero()},
                            path, progress);
        const Positions half = motion.at(0.5).positions;
        // Along the straight part of the limb.
        const double length = (half.row(99 * 24) - half.row(85 * 24)).norm();
        return length / (bar.positions.row(99 * 24) - bar.positions.row(85 * 24)).norm();
    };
    EXPECT_NEAR(worst_shrink(PathKind::kRigid), 1.0, 0.03);
    EXPECT_LT(worst_shrink(PathKind::kSimilarity), 0.75);  // cos(angle / 2) is 0.54

    const Motion motion(bar.positions, bar.normals, bar.bent(angle), {{}, Vector3::Zero()},
                        PathKind::kRigid, progress);
    const Positions half = motion.at(0.5).positions;
    const Similarity onto = fit_similarity(half, bar.bent(angle / 2));
    EXPECT_LT((onto.apply(half) - bar.bent(angle / 2)).rowwise().norm().maxCoeff(), 0.08);
}

TEST(Motion, EndsAreTheShapesThemselves) {
    const Bar bar;
    Progress progress;
    for (const double size : {1e-7, 1.0, 1e6}) {
        const Eigen::RowVector3d place(50 * size, -70 * size, size);
        const Positions from = (size * bar.positions).rowwise() + place, to = size * bar.bent(1.5);
        const GradualSimilarity similarity{fit_similarity(from, to),
                                           from.colwise().mean().transpose()};
        const Motion motion(from, bar.normals, to, similarity, PathKind::kRigid, progress);
        EXPECT_LT((motion.at(0.0).positions - from).cwiseAbs().maxCoeff(), 1e-6 * size);
        EXPECT_LT((motion.at(1.0).positions - to).cwiseAbs().maxCoeff(), 1e-6 * size);
        EXPECT_TRUE(motion.at(0.3).positions.allFinite());
    }
}

TEST(Motion, EndsAreTheImagesAlsoWhereTurnsCancel) {
    Progress progress;
    // Flat scattered points with any images. On the whole way, turns around some of them cancel.
    for (const unsigned seed : {245U, 1453U, 1757U, 1969U, 2177U, 2729U}) {
        const auto count = static_cast<Index>(4 + seed % 20);
        Positions from = shapes::cube_noise(count, seed);
        from.col(2).setZero();
        const Positions to = shapes::cube_noise(count, seed + 10000);
        const GradualSimilarity similarity{fit_similarity(from, to),
                                           from.colwise().mean().transpose()};
        const Motion motion(from, Eigen::RowVector3d(0, 0, 1).replicate(count, 1), to, similarity,
                            PathKind::kRigid, progress);
        EXPECT_LT((motion.at(0.0).positions - from).cwiseAbs().maxCoeff(), 1e-6) << seed;
        EXPECT_LT((motion.at(1.0).positions - to).cwiseAbs().maxCoeff(), 1e-12) << seed;
    }
}

TEST(Motion, ASimilarityRunsBackwardsTheSameWay) {
    const GradualSimilarity there{{2.5, turn(1.7), Vector3(3, 2, 1)}, Vector3(-1, 0, 4)};
    const GradualSimilarity back = there.reversed();
    const Positions points = shapes::sphere(50), ends = there.whole.apply(points);
    for (const double t : {0.0, 0.2, 0.7, 1.0})
        EXPECT_LT((there.at(t).apply(points) - back.at(1.0 - t).apply(ends)).cwiseAbs().maxCoeff(),
                  1e-12);
}

TEST(Motion, StaysNearTheShapesWhereAllImagesNearlyCoincide) {
    const Positions ball = shapes::sphere(300), large = 1e30 * ball;
    const Positions images = shapes::cube_noise(300, 5);
    const GradualSimilarity similarity = whole_motion(large, images, large);
    Progress progress;
    for (const PathKind path : {PathKind::kSimilarity, PathKind::kRigid}) {
        const auto ways =
            Motion::both_ways({large, ball, images, similarity},
                              {large, ball, images, similarity.reversed()}, path, progress);
        for (const double t : {0.03, 0.5, 0.97})
            for (const Motion* way : {&ways.there, &ways.back})
                EXPECT_LT(way->at(t).positions.cwiseAbs().maxCoeff(), 1e37) << t;
        EXPECT_LT((ways.there.at(1.0).positions - images).cwiseAbs().maxCoeff(), 1e30 * 1e-9);
        EXPECT_LT((ways.back.at(1.0).positions - images).cwiseAbs().maxCoeff(), 1e30 * 1e-9);
    }
}

TEST(Motion, AWholeThatFitsIsWhatItWasFittedTo) {
    const Positions ball = shapes::sphere(300).rowwise() + Eigen::RowVector3d(3, 1, 0);
    const Similarity whole{1e-5, turn(2.0), Vector3(1, -5, 2)};
    const Positions images = whole.apply(ball), other = 1e-3 * ball;
    const GradualSimilarity found = whole_motion(ball, images, other);
    const Similarity fitted = fit_similarity(ball, images);
    EXPECT_EQ(found.whole.scale, fitted.scale);
    EXPECT_EQ(found.whole.translation, fitted.translation);
    // Of smaller images, the center goes to that of the images all the same.
    const GradualSimilarity limited = whole_motion(ball, 1e-9 * images, other);
    EXPECT_NEAR(limited.whole.scale, 1e-9, 1e-15);
    const Positions center = limited.at(1.0).apply(limited.center.transpose());
    EXPECT_LT((center - 1e-9 * images.colwise().mean()).norm(), 1e-12);
}

TEST(Motion, BothWaysTogetherAreAsEachByItself) {
    const Bar bar;
    const Positions ends = bar.bent(1.3), half = ends.topRows(ends.rows() / 2);
    const Positions half_start = bar.positions.topRows(half.rows());
    const Normals half_normals = bar.normals.topRows(half.rows());
    const GradualSimilarity similarity{fit_similarity(bar.positions, ends),
                                       bar.positions.colwise().mean().transpose()};
    Progress progress;
    for (const PathKind path : {PathKind::kLinear, PathKind::kSimilarity, PathKind::kRigid}) {
        // Of different sizes: the other one has half of the points.
        const auto there = [&](std::optional<MotionGround> ground) {
            return Motion::Ends{bar.positions, bar.normals, ends, similarity, std::move(ground)};
        };
        const auto back = [&](std::optional<MotionGround> ground) {
            return Motion::Ends{half, half_normals, half_start, similarity.reversed(),
                                std::move(ground)};
        };
        const Motion::BothWays ways = Motion::both_ways(there({}), back({}), path, progress);
        const Motion forth(bar.positions, bar.normals, ends, similarity, path, progress);
        const Motion reverse(half, half_normals, half_start, similarity.reversed(), path, progress);
        // With what the clouds alone give made before, all of it and a part.
        std::optional<MotionGround> whole, part;
        whole.emplace(bar.positions, bar.normals, path, progress);
        whole->follow(bar.normals, progress);
        part.emplace(half, half_normals, path, progress);
        const Motion::BothWays made =
            Motion::both_ways(there(std::move(whole)), back(std::move(part)), path, progress);
        EXPECT_EQ(made.there.at(0.3).positions, forth.at(0.3).positions);
        EXPECT_EQ(made.back.at(0.3).positions, reverse.at(0.3).positions);
        EXPECT_EQ(made.back.at(0.3).normals, reverse.at(0.3).normals);
        Midway midway;
        for (const double t : {0.2, 0.9}) {  // the second time into the first one's memory
            find_midway(ways.there, ways.back, t, midway);
            EXPECT_EQ(midway.t, t);
            const OrientedPoints from = as_arrays(midway.source), to = as_arrays(midway.target);
            EXPECT_EQ(from.positions, forth.at(t).positions);
            EXPECT_EQ(from.normals, forth.at(t).normals);
            EXPECT_EQ(to.positions, reverse.at(1.0 - t).positions);
            EXPECT_EQ(to.normals, reverse.at(1.0 - t).normals);
        }
    }
}

TEST(Motion, FadesFromTheSourcesToTheTargetsOwn) {
    const Midway midway{{{{0, 0, 0}, {0, 0, 1, 0}}}, {{{1, 1, 1}, {0, 0, -1, 0}}}};
    const std::vector<IndexPair> pairs{{0, 0}};
    std::vector<double> positions(3), normals(3);
    for (const double t : {0.0, 0.3, 0.5, 0.8, 1.0}) {
        fade<double>(midway, pairs, t, positions, normals);
        EXPECT_NEAR(positions[1], t * t * (3 - 2 * t), 1e-15);
        EXPECT_NEAR(std::abs(normals[2]), 1.0, 1e-12);  // opposite ends too
    }
}

template <class Scalar>
void expect_faded_by_the_formula(const Midway& midway, std::span<const IndexPair> pairs, double t) {
    std::vector<Scalar> positions(3 * pairs.size()), normals(positions.size());
    fade<Scalar>(midway, pairs, t, positions, normals);
    const double share = t * t * (3.0 - 2.0 * t);
    const OrientedPoints from = as_arrays(midway.source), to = as_arrays(midway.target);
    for (std::size_t i = 0; i < pairs.size(); ++i) {
        const auto [s, r] = pairs[i];
        const auto mix = [&](const Positions& a, const Positions& b) {
            return Vector3(((1.0 - share) * a.row(s) + share * b.row(r)).transpose());
        };
        const Vector3 place = mix(from.positions, to.positions);
        const Vector3 normal = mix(from.normals, to.normals).normalized();
        const double fine = std::numeric_limits<Scalar>::epsilon();
        for (std::size_t d = 0; d < 3; ++d) {
            ASSERT_NEAR(positions[3 * i + d], place[to_index(d)], fine) << i;
            ASSERT_NEAR(normals[3 * i + d], normal[to_index(d)], 20.0 * fine) << i;
        }
    }
    // Each by itself as well.
    std::vector<Scalar> alone(positions.size());
    fade<Scalar>(midway, pairs, t, alone, {});
    ASSERT_EQ(alone, positions);
    fade<Scalar>(midway, pairs, t, {}, alone);
    ASSERT_EQ(alone, normals);
}

TEST(Motion, FadesByTheFormulaInEitherPrecision) {
    const Positions places = shapes::cube_noise(1000, 5), others = shapes::cube_noise(700, 6);
    const auto points = [](const Positions& of, const Vector3& up) {
        std::vector<OrientedPoint> result;
        for (Index i = 0; i < of.rows(); ++i) {
            const Vector3 n = (of.row(i).transpose() + up).normalized();
            result.push_back({{of(i, 0), of(i, 1), of(i, 2)},
                              {static_cast<float>(n[0]), static_cast<float>(n[1]),
                               static_cast<float>(n[2]), 0.0F}});
        }
        return result;
    };
    const Midway midway{points(places, {0, 0, 2}), points(others, {0, 2, 0})};
    std::vector<IndexPair> pairs;
    for (Index i = 0; i < 1300; ++i) pairs.push_back({i * 7 % 1000, i * 11 % 700});
    for (const double t : {0.1, 0.5, 0.93}) {
        expect_faded_by_the_formula<double>(midway, pairs, t);
        expect_faded_by_the_formula<float>(midway, pairs, t);
    }
}

TEST(Motion, FadedNormalsThatCancelAreThoseOfTheNearerEnd) {
    constexpr Index kPairs = 40, kOpposed = 13;
    Midway midway;
    std::vector<IndexPair> pairs;
    for (Index i = 0; i < kPairs; ++i) {
        midway.source.push_back({{}, {0.0F, 0.6F, 0.8F, 0.0F}});
        midway.target.push_back({{}, {0.0F, 0.0F, 1.0F, 0.0F}});
        pairs.push_back({i, i});
    }
    midway.target[to_size(kOpposed)].normal = {0.0F, -0.6F, -0.8F, 0.0F};
    std::vector<float> normals(to_size(3 * kPairs));
    fade<float>(midway, pairs, 0.5, {}, normals);
    for (Index i = 0; i < kPairs; ++i) {
        Vector3 expected = Vector3(0.0, 0.6, 1.8).normalized();
        if (i == kOpposed) expected = {0.0, -0.6, -0.8};  // at half time, the target's
        for (Index d = 0; d < 3; ++d) EXPECT_NEAR(normals[to_size(3 * i + d)], expected[d], 1e-6);
    }
}

TEST(Motion, SameBitsForAnyNumberOfThreads) {
    const Bar bar;
    const auto with = [&](int count) {
        const ThreadCount threads(count);
        Progress progress;
        return Motion(bar.positions, bar.normals, bar.bent(1.0), {{}, Vector3::Zero()},
                      PathKind::kRigid, progress)
            .at(0.4)
            .positions;
    };
    EXPECT_EQ(with(1), with(2));
}

TEST(Motion, CanBeCancelled) {
    const Bar bar;
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(Motion(bar.positions, bar.normals, bar.positions, {{}, Vector3::Zero()},
                        PathKind::kRigid, progress),
                 Cancelled);
}

TEST(Example, Motion) {
    const Positions source = shapes::sphere(400);
    const GradualSimilarity similarity{{1.0, turn(2.0), Vector3::Zero()}, Vector3::Zero()};
    const Positions target = similarity.whole.apply(source);
    const Positions &source_normals = source, &target_normals = target;
    const Positions &source_images = target, &target_images = source;
    std::vector<IndexPair> pairs;
    for (Index i = 0; i < 400; ++i) pairs.push_back({i, i});
    std::vector<float> positions(1200), normals(1200);
    const double t = 0.5;
    Progress progress;
    // --- example
    const Motion::BothWays ways = Motion::both_ways(
        {source, source_normals, source_images, similarity},
        {target, target_normals, target_images, similarity.reversed()}, PathKind::kRigid, progress);
    Midway midway;
    find_midway(ways.there, ways.back, t, midway);
    fade<float>(midway, pairs, t, positions, normals);
    // --- end of the example
    const Positions half = source * turn(1.0).transpose();
    for (Index i = 0; i < 400; ++i)
        for (Index d = 0; d < 3; ++d) {
            EXPECT_NEAR(positions[to_size(3 * i + d)], half(i, d), 1e-5);
            EXPECT_NEAR(normals[to_size(3 * i + d)], half(i, d), 1e-5);
        }
}

}  // namespace
}  // namespace pointmorph

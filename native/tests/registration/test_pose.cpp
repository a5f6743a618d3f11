#include "pointmorph/registration/pose.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/registration/pose_symmetry.hpp"
#include "pointmorph/registration/proposals.hpp"
#include "registration/coarse_of_cloud.hpp"
#include "registration/watched_options.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// An ellipsoid of about unit area; `bump` breaks all its symmetries.
CoarseShape egg(Index count, double bump, unsigned seed, const Matrix3& turn,
                std::vector<Vector3> marks = {}) {
    Positions p = shapes::sphere(count) * shapes::rotation(seed).transpose();
    Normals normals(count, 3);
    const Vector3 axes(0.42, 0.27, 0.18), bump_at = Vector3(1.0, 0.7, 0.9).normalized();
    for (Index i = 0; i < count; ++i) {
        const Vector3 d = p.row(i).transpose();
        normals.row(i) = d.cwiseQuotient(axes).normalized();
        p.row(i) = (1.0 + bump * std::exp((d.dot(bump_at) - 1.0) / 0.05)) * d.cwiseProduct(axes);
    }
    std::vector<Index> required;
    for (const Vector3& mark : marks) {
        Index row;
        (p.rowwise() - mark.transpose()).rowwise().squaredNorm().minCoeff(&row);
        required.push_back(row);
    }
    p *= turn.transpose();
    normals *= turn.transpose();
    return coarse_of_cloud(p, normals, required);
}

Pose pose_between(const CoarseShape& source, const CoarseShape& target) {
    Progress progress;
    return find_pose({source, target}, lighter_where_watched().pose, {}, progress);
}

TEST(Pose, SymmetricShapesAreAmbiguousAndTheRivalsAreNamed) {
    const Index count = is_watched() ? 900 : 2500;
    const CoarseShape source = egg(count, 0.0, 1, Matrix3::Identity());
    const CoarseShape target = egg(count - 300, 0.0, 2, shapes::rotation(7));
    const Pose pose = pose_between(source, target);
    EXPECT_LT(pose.margin, 1.1);
    EXPECT_LT(pose.confidence, 0.55);
    const std::vector<Rival> rivals = describe_rivals(source, target, pose);
    ASSERT_FALSE(rivals.empty());
    for (const Rival& rival : rivals) {
        EXPECT_TRUE(rival.swap == Swap::kEnds || rival.swap == Swap::kSides);
        EXPECT_FALSE(rival.places.empty());
        // The mark that it asks for is on different sides under the two maps.
        EXPECT_GT(
            (target.positions.row(rival.target) - target.positions.row(rival.rival_target)).norm(),
            0.25);
    }
    EXPECT_TRUE(
        std::ranges::any_of(rivals, [](const Rival& rival) { return rival.swap == Swap::kEnds; }));
}

TEST(Pose, OneMarkSettlesAnAmbiguousShapeEitherWay) {
    SKIP_WHERE_WATCHED();
    const Vector3 end(0.42, 0.0, 0.0);
    const CoarseShape source = egg(2500, 0.0, 1, Matrix3::Identity(), {end});
    for (const double side : {1.0, -1.0}) {
        const Matrix3 turn = shapes::rotation(7);
        const CoarseShape target = egg(2200, 0.0, 2, turn, {side * end});
        const std::vector<IndexPair> mark{{0, 0}};
        Progress progress;
        const Pose pose = find_pose({source, target, mark}, {}, {}, progress);
        const Positions images =
            pose.best.alignment.inverse().apply(pose.best.registration.source_points.positions);
        const Values along = (images * turn).col(0), truth = side * source.positions.col(0);
        EXPECT_LT((along - truth).cwiseAbs().mean(), 0.03) << side;
        for (const Rival& rival : describe_rivals(source, target, pose))
            EXPECT_NE(rival.swap, Swap::kEnds);
    }
}

/// Four legs, a head and a tail; unit area. The left is where y > 0.
Positions two_sided(Index count, unsigned seed, Normals* normals) {
    shapes::Urchin animal(count,
                          {{0.9, 0.6, -0.6},
                           {0.9, -0.6, -0.6},
                           {-0.9, 0.5, -0.7},
                           {-0.9, -0.5, -0.7},
                           {1.4, 0.0, 0.6},
                           {-0.6, 0.0, 0.4}},
                          seed);
    *normals = animal.normals;
    return animal.positions / std::sqrt(estimated_area(KdTree<3>(animal.positions)));
}

CoarseShape coarse_two_sided(unsigned seed) {
    Normals normals;
    const Positions positions = two_sided(3000, seed, &normals);
    return coarse_of_cloud(positions, normals);
}

TEST(Pose, IsTheSameToTheBitForAnyNumberOfThreads) {
    SKIP_WHERE_WATCHED();
    // Limbs, so that extremities are varied and anchor trials.
    const CoarseShape source = coarse_two_sided(3), target = coarse_two_sided(4);
    std::vector<Pose> poses;
    for (const int threads : {1, 3}) {
        const ThreadCount count(threads);
        poses.push_back(pose_between(source, target));
    }
    EXPECT_EQ(poses[0].best.registration.source_points.positions,
              poses[1].best.registration.source_points.positions);
    EXPECT_EQ(poses[0].best.alignment.rotation, poses[1].best.alignment.rotation);
    EXPECT_EQ(poses[0].margin, poses[1].margin);
    EXPECT_EQ(poses[0].confidence, poses[1].confidence);
    EXPECT_EQ(poses[0].rivals.size(), poses[1].rivals.size());
}

TEST(Pose, ConfidenceFallsWithWhatSpeaksAgainstAMap) {
    Misfit misfit;
    const auto with = [&](std::vector<Competitor> competitors) {
        return pose_confidence(misfit, competitors);
    };
    EXPECT_GT(with({}), 0.9);
    EXPECT_LE(with({{1.0, 1.0}}), 0.5);
    EXPECT_LT(with({{1.02, 0.5}}), with({{1.2, 0.5}}));
    EXPECT_LT(with({{1.02, 0.5}}), with({{1.02, 0.02}}));
    EXPECT_LT(with({{1.02, 0.5}, {1.1, 0.5}}), with({{1.02, 0.5}}));
    double last = with({});
    for (const double opposed : {0.001, 0.01, 0.1, 1.0}) {
        misfit.opposed = opposed;
        EXPECT_LT(with({}), last);
        last = with({});
        EXPECT_GE(last, 0.0);
    }
}

TEST(Pose, TheTurnOfAShapeWithoutSymmetryIsFound) {
    SKIP_WHERE_WATCHED();
    const CoarseShape source = egg(2500, 0.8, 1, Matrix3::Identity());
    for (const unsigned seed : {7u, 8u}) {
        const CoarseShape target = egg(2200, 0.8, 2, shapes::rotation(seed));
        const Pose pose = pose_between(source, target);
        EXPECT_GT(pose.margin, 1.1);
        const Positions truth = source.positions * shapes::rotation(seed).transpose();
        const Positions images =
            pose.best.alignment.inverse().apply(pose.best.registration.source_points.positions);
        EXPECT_LT((images - truth).rowwise().norm().mean(), 0.03);
    }
}

TEST(Pose, EndsWhenAskedTo) {
    SKIP_WHERE_WATCHED();
    const CoarseShape shape = egg(1500, 0.8, 1, Matrix3::Identity());
    for (const double share : {0.0, 0.4, 0.7}) {
        Progress progress([&](std::string_view, double fraction) { return fraction < share; },
                          std::chrono::milliseconds{0});
        EXPECT_THROW(
            {
                progress.enter("pose");
                find_pose({shape, shape}, {}, {}, progress);
            },
            Cancelled);
    }
}

Positions other_side(Positions positions) {
    positions.col(1) *= -1.0;
    return positions;
}

Symmetry symmetry_of(const CoarseShape& shape) {
    Progress progress;
    return reflection_symmetry(shape, node_distances(shape), {}, {}, progress);
}

TEST(Symmetry, LeftIsTakenToRightHoweverTheShapeLies) {
    for (const unsigned seed : {3u, 4u}) {
        if (seed > 3u && is_watched()) break;
        Normals normals;
        const Matrix3 turn = shapes::rotation(seed);
        const Positions upright = two_sided(3000, seed, &normals);
        const Positions turned = upright * turn.transpose();
        const CoarseShape shape = coarse_of_cloud(turned, normals * turn.transpose());
        const Symmetry symmetry = symmetry_of(shape);
        ASSERT_EQ(symmetry.images.rows(), shape.positions.rows());
        const Positions truth = other_side(shape.positions * turn) * turn.transpose();
        EXPECT_LT((symmetry.images - truth).rowwise().norm().mean(), 0.02);
        EXPECT_LT((symmetry.linear - turn * Vector3(1.0, -1.0, 1.0).asDiagonal() * turn.transpose())
                      .norm(),
                  0.1);
    }
}

TEST(Symmetry, ThereIsNoneWithoutSidesOrWithManyReflections) {
    EXPECT_EQ(symmetry_of(egg(2500, 0.0, 1, Matrix3::Identity())).images.rows(), 0);
    const shapes::Urchin odd(
        3000, {{1.2, 0.3, -0.2}, {-0.3, 0.9, 0.5}, {-0.6, -0.5, 0.7}, {0.1, -0.4, -1.0}}, 5);
    const double unit = std::sqrt(estimated_area(KdTree<3>(odd.positions)));
    EXPECT_EQ(symmetry_of(coarse_of_cloud(odd.positions / unit, odd.normals)).images.rows(), 0);
}

TEST(Symmetry, WhatIsMarkedOnOneSideIsNoReasonAgainstIt) {
    CoarseShape shape = coarse_two_sided(3);
    shape.labels = Labels::Zero(shape.size(), 16);
    shape.pulls = Values::Ones(shape.size());
    for (Index i = 0; i < shape.size(); ++i)
        if (shape.positions(i, 0) > 0.15 && shape.positions(i, 1) > 0.1) {
            shape.labels(i, 0) = 0.5;
            shape.pulls[i] = 20.0;
        }
    EXPECT_GT(symmetry_of(shape).trust, 0.5);
}

TEST(Symmetry, FlatShapesDoNoHarm) {
    for (const double height : {0.0, 1e-3}) {
        Positions sheet = 0.5 * shapes::grid(30);
        sheet.col(1) *= height;
        const Normals up = Eigen::RowVector3d(0, 0, 1).replicate(sheet.rows(), 1);
        const Symmetry symmetry = symmetry_of(coarse_of_cloud(sheet, up));
        EXPECT_TRUE(symmetry.images.allFinite());
        EXPECT_TRUE(symmetry.linear.allFinite());
    }
}

TEST(Symmetry, AsymmetryIsHowFarSidesAreTakenApart) {
    const CoarseShape shape = coarse_two_sided(6);
    const Positions& x = shape.positions;
    Symmetry exact;
    exact.images = other_side(x);
    exact.linear = Vector3(1.0, -1.0, 1.0).asDiagonal();
    exact.trust = 1.0;
    const KdTree<3> tree(x);
    exact.nearest = nearest_rows(tree, exact.images);
    const auto images = [&](const Positions& places) {
        return Images{places, nearest_rows(tree, places)};
    };
    const std::array<Symmetry, 2> both{exact, exact};
    constexpr double kFar = 0.2;
    EXPECT_LT(asymmetry(shape, shape, both, images(x), images(x), kFar), 0.01);
    const Positions about = x * Vector3(-1.0, -1.0, 1.0).asDiagonal();
    EXPECT_LT(asymmetry(shape, shape, both, images(about), images(about), kFar), 0.01);

    // One leg elsewhere: so are it and its counterpart, after one order or the other.
    for (const double off : {0.1, 0.3}) {
        const auto one_leg_moved = [&](Positions places) {
            for (Eigen::Index i = 0; i < places.rows(); ++i)
                if (places(i, 0) > 0.15 && places(i, 1) > 0.1) places(i, 2) += off;
            return places;
        };
        const Positions moved = one_leg_moved(x);
        Values apart = (one_leg_moved(other_side(x)) - other_side(moved)).rowwise().norm();
        for (double& d : apart) d = std::min(1.0, d * d / (kFar * kFar));
        const double truth = shape.areas.dot(apart) / shape.areas.sum();
        EXPECT_GT(truth, 0.02);
        EXPECT_NEAR(asymmetry(shape, shape, both, images(moved), images(moved), kFar), truth,
                    0.2 * truth);
        Symmetry doubted = exact;
        doubted.trust = 0.5;
        EXPECT_NEAR(asymmetry(shape, shape, {exact, doubted}, images(moved), images(moved), kFar),
                    0.5 * asymmetry(shape, shape, both, images(moved), images(moved), kFar), 1e-12);
        EXPECT_EQ(asymmetry(shape, shape, {exact, {}}, images(moved), images(moved), kFar), 0.0);
    }
}

TEST(Pose, AMapCostsMoreForSidesThatItTreatsDifferently) {
    SKIP_WHERE_WATCHED();
    const CoarseShape source = coarse_two_sided(3), target = coarse_two_sided(4);
    Progress progress;
    PoseOptions options;
    options.likeness = 0.0;
    options.as_given = 1.0;
    const Candidate with = find_pose({source, target}, options, {}, progress).best;
    EXPECT_GT(with.energy, with.misfit.energy());
    EXPECT_LT(with.energy, 1.2 * with.misfit.energy());
    options.symmetry.weight = 0.0;
    const Candidate without = find_pose({source, target}, options, {}, progress).best;
    EXPECT_EQ(without.energy, without.misfit.energy());
}

TEST(Pose, AMapCostsMoreTheFartherItTurnsTheTarget) {
    SKIP_WHERE_WATCHED();
    // An egg lies on another in four ways. Given nearly as one of them, that one is taken, and is
    // no coin toss; turned far, none is better than another.
    const CoarseShape source = egg(2500, 0.0, 1, Matrix3::Identity());
    const auto pose_of = [&](double angle) {
        const Matrix3 turn(Eigen::AngleAxisd(angle, Vector3(1.0, 2.0, 2.0) / 3.0));
        return std::pair(pose_between(source, egg(2200, 0.0, 2, turn)), turn);
    };
    for (const double angle : {0.0, 0.2, -0.4}) {
        const auto [pose, turn] = pose_of(angle);
        const Positions images = images_at_rest(pose.best);
        EXPECT_LT((images - source.positions * turn.transpose()).rowwise().norm().mean(), 0.1)
            << angle;
        EXPECT_GT(pose.confidence, 0.8) << angle;
        EXPECT_GT(pose.margin, 1.05) << angle;
    }
    PoseOptions without;
    without.as_given = 1.0;
    Progress progress;
    EXPECT_LT(find_pose({source, egg(2200, 0.0, 2, Matrix3::Identity())}, without, {}, progress)
                  .confidence,
              0.55);
}

TEST(Pose, ACubeOnABallIsNoCoinTossAsItWasGiven) {
    SKIP_WHERE_WATCHED();
    const Positions directions = shapes::sphere(2500) * shapes::rotation(3).transpose();
    const CoarseShape ball = coarse_of_cloud(0.282 * directions, directions);
    Positions cube = shapes::sphere(2200) * shapes::rotation(4).transpose();
    Normals normals = Normals::Zero(cube.rows(), 3);
    for (Index i = 0; i < cube.rows(); ++i) {
        Index axis;
        const double most = cube.row(i).cwiseAbs().maxCoeff(&axis);
        normals(i, axis) = cube(i, axis) > 0.0 ? 1.0 : -1.0;
        cube.row(i) *= 0.2 / most;
    }
    EXPECT_GT(pose_between(ball, coarse_of_cloud(cube, normals)).confidence, 0.8);
    PoseOptions without;
    without.as_given = 1.0;
    without.unlike = 0.0;
    Progress progress;
    EXPECT_LT(find_pose({ball, coarse_of_cloud(cube, normals)}, without, {}, progress).confidence,
              0.4);
}

TEST(Pose, UnlikeShapesStayAsTheyWereGiven) {
    SKIP_WHERE_WATCHED();
    // A ring has little in common with an egg; it lies a bit better along it than round it.
    const Vector3 axes(0.3, 0.33, 0.4);
    const Positions directions = shapes::sphere(2500) * shapes::rotation(3).transpose();
    const CoarseShape egg =
        coarse_of_cloud(directions * axes.asDiagonal(),
                        (directions * axes.cwiseInverse().asDiagonal()).rowwise().normalized());
    constexpr Index kCount = 2200;
    constexpr double kGoldenAngle = 2.399963;
    Positions places(kCount, 3);
    Normals normals(kCount, 3);
    for (Index i = 0; i < kCount; ++i) {
        const double across = kGoldenAngle * i, along = 2.0 * std::numbers::pi * (i + 0.5) / kCount;
        normals.row(i) << std::cos(across) * std::cos(along), std::cos(across) * std::sin(along),
            std::sin(across);
        places.row(i) << 0.4 * std::cos(along), 0.4 * std::sin(along), 0.0;
    }
    places += 0.13 * normals;
    const CoarseShape ring = coarse_of_cloud(places, normals);
    const auto turned = [&](const PoseOptions& options) {
        Progress progress;
        const Pose pose = find_pose({ring, egg}, options, {}, progress);
        const Similarity implied = fit_similarity(ring.positions, images_at_rest(pose.best));
        return Eigen::AngleAxisd(implied.rotation).angle();
    };
    EXPECT_LT(turned({}), 0.2);
    PoseOptions without;
    without.unlike = 0.0;
    EXPECT_GT(turned(without), 1.0);

    // Where only the finest maps show how little they have in common, maps are chosen anew.
    Progress progress;
    const Candidate best = find_pose({ring, egg}, without, {}, progress).best;
    PoseOptions late;
    late.alike = 0.8 * best.misfit.energy() * best.unlikeness;
    EXPECT_LT(turned(late), 0.2);
}

/// A dish of revolution about the z axis, its wall as thick as `wall`, in √area.
CoarseShape dish(double radius, double height, double wall) {
    // Along the profile: outside, rim, inside, the ground within, the ground.
    const std::vector<Eigen::Vector2d> corners{
        {radius, 0.0},         {radius, height}, {radius - wall, height},
        {radius - wall, wall}, {0.0, wall},      {0.0, 0.0}};
    std::mt19937 random(1);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::vector<Eigen::RowVector3d> places, normals;
    for (std::size_t k = 0; k < corners.size(); ++k) {
        const Eigen::Vector2d a = corners[k], b = corners[(k + 1) % corners.size()];
        const Eigen::Vector2d along = (b - a).normalized();
        if (k == 4) continue;  // the axis
        const auto count = static_cast<int>(2500.0 * (b - a).norm() * (a[0] + b[0]) / 2.0);
        for (int i = 0; i < count; ++i) {
            const double share = uniform(random), angle = 2.0 * std::numbers::pi * uniform(random);
            // Even in area: squares of radii are even where these change.
            const double r = std::sqrt(a[0] * a[0] + share * (b[0] * b[0] - a[0] * a[0]));
            const double z = a[1] + share * (b[1] - a[1]);
            places.emplace_back(r * std::cos(angle), r * std::sin(angle), z);
            normals.emplace_back(along[1] * std::cos(angle), along[1] * std::sin(angle), -along[0]);
        }
    }
    const auto rows = [](const std::vector<Eigen::RowVector3d>& list) {
        Positions all(static_cast<Eigen::Index>(list.size()), 3);
        for (std::size_t i = 0; i < list.size(); ++i)
            all.row(static_cast<Eigen::Index>(i)) = list[i];
        return all;
    };
    const Positions at = rows(places);
    return coarse_of_cloud(at / std::sqrt(estimated_area(KdTree<3>(at))), rows(normals));
}

TEST(Pose, ShapesThatHaveNothingInCommonStayAsTheyWereGivenHoweverTheyFit) {
    SKIP_WHERE_WATCHED();
    // An egg that stands fits a dish far better lying down.
    const Vector3 axes(0.2, 0.24, 0.4);
    const Positions directions = shapes::sphere(2500);
    const CoarseShape egg =
        coarse_of_cloud(directions * axes.asDiagonal(),
                        (directions * axes.cwiseInverse().asDiagonal()).rowwise().normalized());
    const CoarseShape into = dish(1.2, 0.6, 0.15);
    const auto turned = [&](const PoseOptions& options) {
        Progress progress;
        const Pose pose = find_pose({egg, into}, options, {}, progress);
        return Eigen::AngleAxisd(fit_similarity(egg.positions, images_at_rest(pose.best)).rotation)
            .angle();
    };
    EXPECT_LT(turned({}), 0.2);
    PoseOptions without;
    without.unlike = 0.0;
    EXPECT_GT(turned(without), 1.0);
}

TEST(Pose, AMapIsRatedByHowAlikeItsPointsAre) {
    SKIP_WHERE_WATCHED();
    const CoarseShape source = coarse_two_sided(3), target = coarse_two_sided(4);
    Progress progress;
    PoseOptions options;
    options.symmetry.weight = 0.0;
    for (const Index rounds : {0, 1, 9}) {
        options.plain_rounds = rounds;
        const Candidate best = find_pose({source, target}, options, {}, progress).best;
        // Two samplings of one shape: nearly alike, so that the factor is near the root of .1.
        const double factor = best.energy / best.misfit.energy();
        EXPECT_GT(factor, std::sqrt(0.1));
        EXPECT_LT(factor, std::sqrt(0.5));
    }
}

TEST(Pose, AMapCostsMoreForItsTears) {
    SKIP_WHERE_WATCHED();
    // A table, which has many ways to stand on another, and a limb on top that the other hasn't
    // got: it can't be mapped without a tear.
    const std::vector<Vector3> legs{
        {0.9, 0.6, -0.6}, {0.9, -0.6, -0.6}, {-0.9, 0.6, -0.6}, {-0.9, -0.6, -0.6}};
    std::vector<Vector3> more = legs;
    more.emplace_back(0.0, 0.0, 1.6);
    const auto of = [](const std::vector<Vector3>& spikes, unsigned seed) {
        const shapes::Urchin urchin(6000, spikes, seed);
        const double unit = std::sqrt(estimated_area(KdTree<3>(urchin.positions)));
        return coarse_of_cloud(urchin.positions / unit, urchin.normals);
    };
    const CoarseShape source = of(more, 3), target = of(legs, 4);
    Progress progress;
    PoseOptions options;
    options.as_given = 1.0;
    for (const double weight : {0.0, 1e6}) {
        options.tear_weight = weight;
        const Pose pose = find_pose({source, target}, options, {}, progress);
        ASSERT_FALSE(pose.rivals.empty());
        EXPECT_DOUBLE_EQ(pose.margin, pose.rivals.front().cost / pose.best.cost);
        EXPECT_GE(pose.margin, 1.0);
        for (const Candidate& rival : pose.rivals) {
            if (weight == 0.0) {
                EXPECT_LE(pose.best.energy, rival.energy);
            } else {
                EXPECT_LT(pose.best.torn * pose.best.energy, 1.001 * rival.torn * rival.energy);
            }
        }
    }
}

TEST(Example, Pose) {
    SKIP_WHERE_WATCHED();
    const Matrix3 turn = shapes::rotation(7);
    const Vector3 end(0.42, 0.0, 0.0);
    const CoarseShape source = egg(2500, 0.0, 1, Matrix3::Identity(), {end});
    const CoarseShape target = egg(2200, 0.0, 2, turn, {end});
    const std::vector<IndexPair> features{{0, 0}};
    Progress progress;
    // --- example
    const Pose pose = find_pose({source, target, features}, {}, {}, progress);
    const CoarseShape there = moved(target, pose.best.alignment);
    const Positions& images = pose.best.registration.source_points.positions;
    const bool is_clear = pose.confidence > 0.9;
    // --- end of the example
    const Similarity back = pose.best.alignment.inverse();
    EXPECT_LT((back.apply(there.positions) - target.positions).cwiseAbs().maxCoeff(), 1e-9);
    const Values along = (back.apply(images) * turn).col(0);
    EXPECT_LT((along - source.positions.col(0)).cwiseAbs().mean(), 0.03);
    EXPECT_FALSE(is_clear);  // any side of it may be up
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/registration/candidate_poses.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numbers>
#include <vector>

#include "base/angle.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "registration/coarse_urchin.hpp"
#include "registration/eggs.hpp"

namespace pointmorph {
namespace {

/// Largest difference between the rotations.
double apart(const Matrix3& a, const Matrix3& b) {
    return (a - b).cwiseAbs().maxCoeff();
}

bool has_rotation(const std::vector<Similarity>& poses, const Matrix3& rotation) {
    return std::ranges::any_of(
        poses, [&](const Similarity& pose) { return apart(pose.rotation, rotation) < 0.05; });
}

TEST(CandidatePoses, TakePrincipalAxesToPrincipalAxesInEveryWay) {
    const Eggs eggs;
    const Similarity move{1.0, shapes::rotation(5), Vector3(0.3, -0.2, 0.5)};
    const CoarseShape target = moved(eggs.coarse_source, move);
    PoseOptions options;
    options.spread_ratio = 1e6;
    const auto poses = candidate_poses({eggs.coarse_source, target}, options);
    EXPECT_EQ(poses.size(), 24u + 1u);  // and as it was given
    const Matrix3 back = move.rotation.transpose();
    EXPECT_TRUE(has_rotation(poses, back));
    // An egg's axes are those of space.
    for (const Vector3& signs : {Vector3(1, -1, -1), Vector3(-1, 1, -1), Vector3(-1, -1, 1)})
        EXPECT_TRUE(has_rotation(poses, signs.asDiagonal() * back));
    EXPECT_TRUE(has_rotation(poses, Matrix3::Identity()));
    // Axes of other lengths aren't taken for one another.
    options.spread_ratio = 1.1;
    EXPECT_EQ(candidate_poses({eggs.coarse_source, target}, options).size(), 4u + 1u);
}

TEST(CandidatePoses, NoneContradictsTheFeatures) {
    const Eggs eggs;
    const Similarity move{1.0, shapes::rotation(5), Vector3(0.3, -0.2, 0.5)};
    const CoarseShape target = moved(eggs.coarse_target, move);
    const auto poses = candidate_poses({eggs.coarse_source, target, eggs.features}, {});
    ASSERT_FALSE(poses.empty());
    for (const Similarity& pose : poses) {
        const Positions there = pose.apply(target.positions);
        for (const IndexPair& f : eggs.features)
            EXPECT_LT((there.row(f.target) - eggs.coarse_source.positions.row(f.source)).norm(),
                      0.6);
        EXPECT_NEAR(pose.rotation.determinant(), 1.0, 1e-9);
    }
    EXPECT_TRUE(has_rotation(poses, move.rotation.transpose()));
}

TEST(CandidatePoses, APartIsLaidWhereItLiesOnTheWhole) {
    const std::vector<Vector3> spikes{
        {1.2, 0, 0}, {0, 0.9, 0.2}, {-0.3, -0.5, 0.6}, {-0.5, 0.2, -0.8}};
    const CoarseShape whole = coarse_urchin(6000, spikes, 2);
    const CoarseShape all = coarse_urchin(6000, spikes, 1);
    constexpr double kCut = 0.8, kBorder = 0.06;
    std::vector<Index> kept;
    for (Index i = 0; i < all.size(); ++i)
        if (all.positions(i, 0) < kCut) kept.push_back(i);
    const Positions positions = gather(all.positions, kept);
    Progress progress;
    CoarseShape part = coarse_shape(KdTree<3>(positions), gather(all.normals, kept), {},
                                    {600, {100, 200}, {}}, progress);
    const Similarity move{1.0, shapes::rotation(5), Vector3(0.3, -0.2, 0.5)};
    const CoarseShape moved_whole = moved(whole, move);
    const auto off = [&](bool part_is_source) {
        double least = std::numeric_limits<double>::infinity();
        const CoarseShape &source = part_is_source ? part : moved_whole,
                          &target = part_is_source ? moved_whole : part;
        for (Similarity pose : candidate_poses({source, target}, {})) {
            if (!part_is_source) pose = pose.inverse();
            const Positions there = pose.apply(moved_whole.positions);
            least = std::min(least, (there - whole.positions).rowwise().norm().mean());
        }
        return least;
    };
    const double middles_together = off(true);
    for (Index i = 0; i < part.size(); ++i)
        part.ends.push_back(part.positions(i, 0) > kCut - kBorder);
    EXPECT_LT(off(true), 0.7 * middles_together);
    EXPECT_LT(off(false), 0.7 * middles_together);
}

TEST(CandidatePoses, TiltsGoToEitherSideAboutEachAxisAndKeepTheMiddle) {
    const Eggs eggs;
    const CoarseShape& egg = eggs.coarse_source;
    const auto found = tilts(egg, 0.4);
    ASSERT_EQ(found.size(), 6u);
    const Vector3 middle = egg.positions.transpose() * (egg.areas / egg.areas.sum());
    for (const Similarity& tilt : found) {
        EXPECT_NEAR(std::acos(0.5 * (tilt.rotation.trace() - 1.0)), 0.4, 1e-9);
        EXPECT_LT((tilt.rotation * middle + tilt.translation - middle).norm(), 1e-9);
    }
    EXPECT_LT(apart(found[0].rotation * found[1].rotation, Matrix3::Identity()), 1e-9);
}

TEST(CandidatePoses, HalfTurnsFollowTheShapeWhereItsPrincipalAxesLieAskew) {
    // Half a turn about z takes an ellipsoid onto itself, but not its spike, which draws the axes
    // aside.
    const shapes::Urchin urchin(6000, {{0.6, 0.1, 0.3}}, 2);
    const Vector3 stretched(0.7, 0.4, 2.0);
    Progress progress;
    const Positions positions = urchin.positions * stretched.asDiagonal();
    const Normals normals =
        (urchin.normals * stretched.cwiseInverse().asDiagonal()).rowwise().normalized();
    const CoarseShape shape = coarse_shape(KdTree<3>(positions), normals, {}, {}, progress);
    const Matrix3 about_z = Vector3(-1, -1, 1).asDiagonal();
    const auto nearest = [&](const std::vector<Similarity>& turns) {
        double least = std::numeric_limits<double>::infinity();
        for (const Similarity& turn : turns)
            least = std::min(least, angle_axis(turn.rotation * about_z.transpose()).angle());
        return least;
    };
    EXPECT_GT(nearest(tilts(shape, std::numbers::pi)), 0.3);
    const auto turns = half_turns(shape);
    ASSERT_EQ(turns.size(), 3u);
    EXPECT_LT(nearest(turns), 0.12);
}

TEST(CandidatePoses, HalfTurnsOfLinesAndFewPointsAreRotations) {
    Positions line = Positions::Zero(40, 3);
    line.col(0).setLinSpaced(0.0, 1.0);
    for (const Positions& points : {line, Positions(line.topRows(2)), Positions(line.topRows(1)),
                                    Positions(shapes::grid(8))}) {
        Progress progress;
        const CoarseShape shape = coarse_shape(KdTree<3>(points), shapes::upward(points.rows()), {},
                                               {600, {100, 200}, {}}, progress);
        for (const Similarity& turn : half_turns(shape)) {
            EXPECT_NEAR(turn.rotation.determinant(), 1.0, 1e-9);
            EXPECT_LT(apart(turn.rotation * turn.rotation.transpose(), Matrix3::Identity()), 1e-9);
            EXPECT_TRUE(turn.translation.allFinite());
        }
    }
}

TEST(CandidatePoses, WhatAgreesWithTheFeaturesStays) {
    const Eggs eggs;
    const CoarsePair shapes{eggs.coarse_source, eggs.coarse_target, eggs.features};
    const Similarity turned{1.0, Vector3(1, -1, -1).asDiagonal().toDenseMatrix(), Vector3::Zero()};
    const auto kept = agreeing_with_features(shapes, {turned, {}, turned}, {});
    ASSERT_EQ(kept.size(), 1u);
    EXPECT_EQ(kept[0].rotation, Matrix3::Identity());
    const CoarsePair plain{eggs.coarse_source, eggs.coarse_target, {}};
    EXPECT_EQ(agreeing_with_features(plain, {turned, {}, turned}, {}).size(), 3u);
}

}  // namespace
}  // namespace pointmorph

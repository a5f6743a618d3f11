#include "registration/self_motions.hpp"

#include <gtest/gtest.h>

#include <numeric>
#include <vector>

#include "registration/eggs.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

std::vector<Index> all_rows(const CoarseShape& shape) {
    std::vector<Index> rows(to_size(shape.size()));
    std::iota(rows.begin(), rows.end(), 0);
    return rows;
}

Similarity half_turn(int axis) {
    return {1.0, Eigen::AngleAxisd(EIGEN_PI, Vector3::Unit(axis)).toRotationMatrix(),
            Vector3::Zero()};
}

/// With a dent at one end, if `depth` isn't 0.
CoarseShape dented_egg(double depth) {
    Egg egg = oriented_egg(4000, 3);
    for (auto place : egg.positions.rowwise())
        if (place.x() > 0.3) place.x() = 0.3 + (place.x() - 0.3) * (1.0 - depth);
    Progress progress;
    return coarse_shape(KdTree<3>(egg.positions), egg.normals, {}, {2000, {100, 300}, {}},
                        progress);
}

TEST(SelfMotions, AreThoseUnderWhichAShapeLooksTheSame) {
    const CoarseShape egg = dented_egg(0.0), dented = dented_egg(0.5);
    const std::vector<Index> rows = all_rows(egg), dented_rows = all_rows(dented);
    const SelfMotions of_egg(egg, rows), of_dented(dented, dented_rows);
    EXPECT_TRUE(of_egg.keep({}));
    EXPECT_TRUE(of_dented.keep({}));
    for (int axis = 0; axis < 3; ++axis) {
        EXPECT_TRUE(of_egg.keep(half_turn(axis))) << axis;
        EXPECT_EQ(of_dented.keep(half_turn(axis)), axis == 0) << axis;
        const Matrix3 quarter =
            Eigen::AngleAxisd(0.5 * EIGEN_PI, Vector3::Unit(axis)).toRotationMatrix();
        EXPECT_FALSE(of_egg.keep({1.0, quarter, Vector3::Zero()})) << axis;
    }
    EXPECT_FALSE(of_egg.keep({1.0, Matrix3::Identity(), Vector3(0.1, 0.0, 0.0)}));
    EXPECT_NEAR(of_egg.distance({1.0, Matrix3::Identity(), Vector3(0.1, 0.0, 0.0)}), 0.1, 1e-12);
}

TEST(SelfMotions, OneOfThePosesThatLookTheSameIsKept) {
    const CoarseShape egg = dented_egg(0.0), dented = dented_egg(0.5);
    const std::vector<Index> rows = all_rows(egg), dented_rows = all_rows(dented);
    const SelfMotions of_egg(egg, rows), of_dented(dented, dented_rows);
    const std::vector<Similarity> poses{half_turn(0), half_turn(1), {}, half_turn(2), {}};

    // Of four, that which rotates nothing; the three others are half turns of the target.
    const DistinctPoses one = distinct_poses(poses, of_dented, of_egg);
    ASSERT_EQ(one.poses.size(), 1u);
    EXPECT_TRUE(one.poses.front().rotation.isIdentity());
    ASSERT_EQ(one.motions.size(), 3u);
    for (const SelfMotion& motion : one.motions) EXPECT_FALSE(motion.of_source);
    // The other way round they are the source's.
    const DistinctPoses other = distinct_poses(poses, of_egg, of_dented);
    EXPECT_EQ(other.poses.size(), 1u);
    EXPECT_EQ(other.motions.size(), 3u);
    EXPECT_TRUE(other.motions.back().of_source);
    // Where only the half turn about the long axis changes nothing, two are left.
    const DistinctPoses two = distinct_poses(poses, of_dented, of_dented);
    EXPECT_EQ(two.poses.size(), 2u);
    EXPECT_EQ(two.motions.size(), 1u);
}

TEST(SelfMotions, AMapFollowedByOneArrivesWhereThatTakesItsImages) {
    const CoarseShape source = dented_egg(0.0);
    const Similarity move{1.0, shapes::rotation(5), Vector3(0.1, -0.2, 0.3)};
    const CoarseShape target = moved(source, move);
    Candidate map{.alignment = move.inverse(), .registration = {}};
    const CoarseShape there = moved(target, map.alignment);
    const auto still = [](const CoarseShape& shape) {
        const DeformationGraph& graph = shape.levels.back();
        return Deformation{gather(shape.positions, graph.node_rows),
                           std::vector<Matrix3>(to_size(graph.size()), Matrix3::Identity()),
                           Values::Ones(graph.size())};
    };
    map.registration.source = still(source);
    map.registration.target = still(there);
    map.registration.source_points =
        deformed(source.positions, source.normals, source.levels.back(), map.registration.source);
    map.registration.target_points =
        deformed(there.positions, there.normals, there.levels.back(), map.registration.target);

    for (int axis = 0; axis < 3; ++axis) {
        const Similarity turn = half_turn(axis);
        const SelfMotion motions[] = {{turn, true},
                                      {composed(composed(move, turn), move.inverse()), false}};
        for (const SelfMotion& motion : motions) {
            const Registration other = followed_by_motion(map, source, target, motion).registration;
            const Positions turned = turn.apply(source.positions);
            EXPECT_LT((other.source_points.positions - turned).cwiseAbs().maxCoeff(), 1e-9);
            EXPECT_LT((other.target_points.positions - turned).cwiseAbs().maxCoeff(), 1e-9);
            // Its deformations are those of the same map.
            for (const auto& [shape, deformation] :
                 {std::pair(&source, &other.source), std::pair(&there, &other.target)})
                EXPECT_LT(
                    (deformed(shape->positions, shape->normals, shape->levels.back(), *deformation)
                         .positions -
                     turned)
                        .cwiseAbs()
                        .maxCoeff(),
                    1e-6);
        }
    }
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/pose.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "pointmorph/error.hpp"
#include "pointmorph/parallel.hpp"
#include "pointmorph/proposals.hpp"
#include "shapes.hpp"

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
    Progress progress;
    CoarseShapeOptions options;
    options.points = 1500;
    return coarse_shape(KdTree<3>(p), normals, required, options, progress);
}

Pose found(const CoarseShape& source, const CoarseShape& target) {
    Progress progress;
    return find_pose(source, target, {}, {}, {}, progress);
}

TEST(Pose, SymmetricShapesAreAmbiguousAndTheRivalsAreNamed) {
    const CoarseShape source = egg(2500, 0.0, 1, Matrix3::Identity());
    const CoarseShape target = egg(2200, 0.0, 2, shapes::rotation(7));
    const Pose pose = found(source, target);
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
    const Vector3 end(0.42, 0.0, 0.0);
    const CoarseShape source = egg(2500, 0.0, 1, Matrix3::Identity(), {end});
    for (const double side : {1.0, -1.0}) {
        const Matrix3 turn = shapes::rotation(7);
        const CoarseShape target = egg(2200, 0.0, 2, turn, {side * end});
        const std::vector<IndexPair> mark{{0, 0}};
        Progress progress;
        const Pose pose = find_pose(source, target, mark, {}, {}, progress);
        const Positions images =
            pose.best.alignment.inverse().apply(pose.best.registration.source_points.positions);
        const Values along = (images * turn).col(0), truth = side * source.positions.col(0);
        EXPECT_LT((along - truth).cwiseAbs().mean(), 0.03) << side;
        for (const Rival& rival : describe_rivals(source, target, pose))
            EXPECT_NE(rival.swap, Swap::kEnds);
    }
}

TEST(Pose, IsTheSameToTheBitForAnyNumberOfThreads) {
    const CoarseShape source = egg(1500, 0.8, 1, Matrix3::Identity());
    const CoarseShape target = egg(1500, 0.8, 2, shapes::rotation(7));
    std::vector<Pose> poses;
    for (const int threads : {1, 3}) {
        const ThreadCount count(threads);
        poses.push_back(found(source, target));
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
    const CoarseShape source = egg(2500, 0.8, 1, Matrix3::Identity());
    for (const unsigned seed : {7u, 8u}) {
        const CoarseShape target = egg(2200, 0.8, 2, shapes::rotation(seed));
        const Pose pose = found(source, target);
        EXPECT_GT(pose.margin, 1.1);
        const Positions truth = source.positions * shapes::rotation(seed).transpose();
        const Positions images =
            pose.best.alignment.inverse().apply(pose.best.registration.source_points.positions);
        EXPECT_LT((images - truth).rowwise().norm().mean(), 0.03);
    }
}

TEST(Pose, EndsWhenAskedTo) {
    const CoarseShape shape = egg(1500, 0.8, 1, Matrix3::Identity());
    for (const double share : {0.0, 0.4, 0.7}) {
        Progress progress([&](std::string_view, double fraction) { return fraction < share; });
        EXPECT_THROW(
            {
                progress.enter("pose");
                find_pose(shape, shape, {}, {}, {}, progress);
            },
            Cancelled);
    }
}

}  // namespace
}  // namespace pointmorph

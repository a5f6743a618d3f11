#include "pointmorph/registration/registration.hpp"

#include <gtest/gtest.h>

#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/thin_plate.hpp"
#include "registration/eggs.hpp"

namespace pointmorph {
namespace {

TEST(Registration, ReturnsFromAWrongPose) {
    const Eggs eggs;
    // No feature helps; an egg is smooth and slides, so that not all of it comes back.
    const Matrix3 turn = Eigen::AngleAxisd(0.3, Vector3(1, 2, 3).normalized()).toRotationMatrix();
    const Similarity off{1.0, turn, Vector3(0.05, -0.03, 0.04)};
    const RegistrationStart start{off.apply(eggs.coarse_source.positions),
                                  off.inverse().apply(eggs.coarse_target.positions)};
    Progress progress;
    const Registration r =
        register_shapes({eggs.coarse_source, eggs.coarse_target}, start, {}, progress);
    const auto distance = [](const Positions& a, const Positions& b) {
        return (a - b).rowwise().norm().mean();
    };
    EXPECT_LT(distance(r.source_points.positions, eggs.coarse_source.positions),
              0.5 * distance(start.source, eggs.coarse_source.positions));
    EXPECT_LT(distance(r.target_points.positions, eggs.coarse_target.positions),
              0.5 * distance(start.target, eggs.coarse_target.positions));
    // On the surface it is all the same.
    const KdTree<3> tree(eggs.target.positions);
    double gap = 0.0;
    for (Index i = 0; i < eggs.coarse_source.size(); ++i) {
        Index nearest;
        double squared;
        tree.nearest(r.source_points.positions.row(i).data(), {&nearest, 1}, {&squared, 1});
        gap += std::sqrt(squared) / eggs.coarse_source.size();
    }
    EXPECT_LT(gap, 1.0 / std::sqrt(1200.0));
}

TEST(Registration, HoldsTheFeatures) {
    const Eggs eggs;
    // The features turn the target by 30 degrees about its first axis: the rest must follow.
    const Similarity turn{1.0, Eigen::AngleAxisd(0.5, Vector3::UnitX()).toRotationMatrix(),
                          Vector3::Zero()};
    CoarseShape turned = eggs.coarse_target;
    turned.positions = turn.apply(turned.positions);
    turned.normals = turn.rotated(turned.normals);
    Progress progress;
    const CoarsePair shapes{eggs.coarse_source, turned, eggs.features};
    const Registration r = register_shapes(shapes, thin_plate_start(shapes), {}, progress);
    for (const IndexPair& f : eggs.features)
        EXPECT_LT((r.source_points.positions.row(f.source) - turned.positions.row(f.target)).norm(),
                  0.005);
    EXPECT_LT((r.source_points.positions - turn.apply(eggs.coarse_source.positions))
                  .rowwise()
                  .norm()
                  .mean(),
              0.02);
    for (Index k = 0; k < eggs.coarse_source.levels.back().size(); ++k)
        EXPECT_NEAR(r.source.scales[k], 1.0, 0.2);
    EXPECT_EQ(r.source.rotations.size(), to_size(eggs.coarse_source.levels.back().size()));
}

TEST(Example, Registration) {
    const Eggs eggs;
    const CoarseShape &source = eggs.coarse_source, &target = eggs.coarse_target;
    const std::vector<IndexPair>& features = eggs.features;
    Progress progress;
    // --- example
    const CoarsePair shapes{source, target, features};
    const Registration map = register_shapes(shapes, thin_plate_start(shapes), {}, progress);
    const Positions& images = map.source_points.positions;
    // --- end of the example
    for (const IndexPair& f : features)
        EXPECT_LT((images.row(f.source) - target.positions.row(f.target)).norm(), 0.005);
}

}  // namespace
}  // namespace pointmorph

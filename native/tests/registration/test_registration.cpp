#include "pointmorph/registration/registration.hpp"

#include <gtest/gtest.h>

#include "pointmorph/cloud/similarity.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

/// An ellipsoid of about unit area with three different axes.
struct Egg {
    Positions positions;
    Normals normals;
};
Egg egg(Index count, unsigned seed) {
    const Positions d = shapes::sphere(count) * shapes::rotation(seed).transpose();
    const Eigen::RowVector3d axes(0.42, 0.3, 0.2);
    Egg e{d.array().rowwise() * axes.array(), d.array().rowwise() / axes.array()};
    e.normals.rowwise().normalize();
    return e;
}

Index nearest_row(const Positions& p, const Vector3& q) {
    Index best;
    (p.rowwise() - q.transpose()).rowwise().squaredNorm().minCoeff(&best);
    return best;
}

struct Eggs {
    Egg source = egg(1500, 1), target = egg(1200, 2);
    std::vector<Index> source_rows, target_rows;
    std::vector<IndexPair> features;
    CoarseShape coarse_source, coarse_target;

    Eggs() {
        const CoarseShapeOptions options{600, {40, 150}, {}};
        for (Index k = 0; k < 6; ++k) {
            const Vector3 mark =
                (k % 2 ? -1.0 : 1.0) * Vector3::Unit(k / 2).cwiseProduct(Vector3(0.42, 0.3, 0.2));
            source_rows.push_back(nearest_row(source.positions, mark));
            target_rows.push_back(nearest_row(target.positions, mark));
            features.push_back({k, k});
        }
        Progress progress;
        coarse_source = coarse_shape(KdTree<3>(source.positions), source.normals, source_rows,
                                     options, progress);
        coarse_target = coarse_shape(KdTree<3>(target.positions), target.normals, target_rows,
                                     options, progress);
    }
};

TEST(Registration, ThinPlateTakesFeaturesAlmostToTheirPartners) {
    const Eggs eggs;
    const RegistrationStart start =
        thin_plate_start(eggs.coarse_source, eggs.coarse_target, eggs.features);
    for (const IndexPair& f : eggs.features)
        EXPECT_LT((start.source.row(f.source) - eggs.coarse_target.positions.row(f.target)).norm(),
                  0.02);
    const auto few = std::span(eggs.features).first(4);
    EXPECT_EQ(thin_plate_start(eggs.coarse_source, eggs.coarse_target, few).source,
              eggs.coarse_source.positions);
}

TEST(Registration, ReturnsFromAWrongPose) {
    const Eggs eggs;
    // No feature helps; an egg is smooth and slides, so that not all of it comes back.
    const Matrix3 turn = Eigen::AngleAxisd(0.3, Vector3(1, 2, 3).normalized()).toRotationMatrix();
    const Similarity off{1.0, turn, Vector3(0.05, -0.03, 0.04)};
    const RegistrationStart start{off.apply(eggs.coarse_source.positions),
                                  off.inverse().apply(eggs.coarse_target.positions)};
    Progress progress;
    const Registration r =
        register_shapes(eggs.coarse_source, eggs.coarse_target, {}, start, {}, progress);
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
    const Registration r =
        register_shapes(eggs.coarse_source, turned, eggs.features,
                        thin_plate_start(eggs.coarse_source, turned, eggs.features), {}, progress);
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

}  // namespace
}  // namespace pointmorph

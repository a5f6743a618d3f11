#include "pointmorph/pose.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "pointmorph/error.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

/// An ellipsoid of about unit area; `bump` breaks all its symmetries.
CoarseShape egg(Index count, double bump, unsigned seed, const Matrix3& turn) {
    Positions p = shapes::sphere(count) * shapes::rotation(seed).transpose();
    Normals normals(count, 3);
    const Vector3 axes(0.42, 0.27, 0.18), bump_at = Vector3(1.0, 0.7, 0.9).normalized();
    for (Index i = 0; i < count; ++i) {
        const Vector3 d = p.row(i).transpose();
        normals.row(i) = d.cwiseQuotient(axes).normalized();
        p.row(i) = (1.0 + bump * std::exp((d.dot(bump_at) - 1.0) / 0.05)) * d.cwiseProduct(axes);
    }
    p *= turn.transpose();
    normals *= turn.transpose();
    Progress progress;
    CoarseShapeOptions options;
    options.points = 1500;
    return coarse_shape(KdTree<3>(p), normals, {}, options, progress);
}

Pose found(const CoarseShape& source, const CoarseShape& target) {
    Progress progress;
    return find_pose(source, target, {}, {}, {}, progress);
}

TEST(Pose, SymmetricShapesAreAmbiguous) {
    const CoarseShape source = egg(2500, 0.0, 1, Matrix3::Identity());
    const CoarseShape target = egg(2200, 0.0, 2, shapes::rotation(7));
    EXPECT_LT(found(source, target).margin, 1.1);
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

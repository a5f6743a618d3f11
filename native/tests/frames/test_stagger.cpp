#include "pointmorph/frames/stagger.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

Positions line(Index count) {
    Positions rows = Positions::Zero(count, 3);
    for (Index i = 0; i < count; ++i) rows(i, 2) = 5.0 + 2.0 * i;
    return rows;
}

TEST(Stagger, DelaysAlongAnAxisGoFromTheLeastToTheLargest) {
    StaggerOptions options;
    EXPECT_EQ(delays(line(5), {}, options).size(), 0);
    options.kind = StaggerKind::kZ;
    const Values found = delays(line(5), {}, options);
    for (Index i = 0; i < 5; ++i) EXPECT_DOUBLE_EQ(found[i], i / 4.0);
    options.is_reversed = true;
    const Values reversed = delays(line(5), {}, options);
    for (Index i = 0; i < 5; ++i) EXPECT_DOUBLE_EQ(reversed[i], 1.0 - i / 4.0);
    options = {};
    options.kind = StaggerKind::kX;  // where all points are the same
    EXPECT_EQ(delays(line(5), {}, options), Values(Values::Zero(5)));
    EXPECT_EQ(delays(line(1), {}, options), Values(Values::Zero(1)));
}

TEST(Stagger, GivenDelaysAreTakenAsTheyAre) {
    StaggerOptions options;
    options.kind = StaggerKind::kDelay;
    Values given(3);
    given << 0.25, 0.0, 0.5;
    EXPECT_EQ(delays(line(3), given, options), given);
    EXPECT_THROW(delays(line(4), given, options), CloudError);
    EXPECT_THROW(delays(line(3), {}, options), CloudError);
    for (const double wrong : {-0.1, 1.1, std::numeric_limits<double>::quiet_NaN()}) {
        given[1] = wrong;
        EXPECT_THROW(delays(line(3), given, options), CloudError);
    }
}

TEST(Stagger, NoiseIsSmoothFromNoneToOneAndTheSameForAnyNumberOfThreads) {
    const Positions plane = shapes::grid(40);
    StaggerOptions options;
    options.kind = StaggerKind::kNoise;
    const Values found = delays(plane, {}, options);
    EXPECT_EQ(found.minCoeff(), 0.0);
    EXPECT_EQ(found.maxCoeff(), 1.0);
    // From a point to the next, a 40th of the side away, where patches are a quarter of it.
    double largest = 0.0;
    for (Index i = 0; i < 40; ++i)
        for (Index j = 0; j + 1 < 40; ++j)
            largest = std::max(largest, std::abs(found[40 * i + j + 1] - found[40 * i + j]));
    EXPECT_LT(largest, 0.35);
    EXPECT_GT(largest, 0.02);
    {
        const ThreadCount one(1);
        EXPECT_EQ(delays(plane, {}, options), found);
    }
    options.seed = 1;
    EXPECT_GT((delays(plane, {}, options) - found).cwiseAbs().mean(), 0.05);
}

TEST(Stagger, ATimeOfItsOwnIsTheClosedForm) {
    StaggerOptions options;
    for (const double overlap : {0.01, 0.3, 1.0})
        for (const double falloff : {0.0, 0.4, 1.0})
            for (const double delay : {0.0, 0.37, 1.0}) {
                options.overlap = overlap;
                options.falloff = falloff;
                EXPECT_EQ(local_time(0.0, delay, options), 0.0);
                EXPECT_EQ(local_time(1.0, delay, options), 1.0);
                double before = 0.0;
                for (int k = 1; k < 50; ++k) {
                    const double t = k / 50.0;
                    const double x = std::clamp((t - delay * (1.0 - overlap)) / overlap, 0.0, 1.0);
                    const double expected =
                        (1.0 - falloff) * x + falloff * (3 * x * x - 2 * x * x * x);
                    const double found = local_time(t, delay, options);
                    EXPECT_NEAR(found, expected, 1e-12);
                    EXPECT_GE(found, before - 1e-15);
                    before = found;
                }
            }
    options = {};
    options.overlap = 1.0;
    options.falloff = 0.0;
    EXPECT_EQ(local_time(0.3, 0.8, options), 0.3);
}

TEST(Example, Stagger) {
    // A row of points that turns by half a turn about the z axis, from the left to the right.
    const Index count = 11;
    Positions row = Positions::Zero(count, 3);
    for (Index i = 0; i < count; ++i) row(i, 0) = i / 10.0;
    const auto turned = [&](double t) {
        const Matrix3 turn =
            Eigen::AngleAxisd(t * std::numbers::pi, Vector3::UnitZ()).toRotationMatrix();
        return OrientedPoints{row * turn.transpose(), {}};
    };
    // --- example
    StaggerOptions options;
    options.kind = StaggerKind::kX;
    options.overlap = 0.25;
    const Values late = delays(row, {}, options);  // 0, 0.1, … 1
    const PointwisePath path(turned(0.0), turned(1.0), turned);

    Values times(count);
    for (Index i = 0; i < count; ++i) times[i] = local_time(0.5, late[i], options);
    const Positions half_way = path.at(times).positions;
    // --- end of the example
    EXPECT_EQ(half_way.row(10), row.row(10));                  // hasn't begun
    EXPECT_EQ(half_way.row(0), turned(1.0).positions.row(0));  // is there
    for (Index i = 0; i < count; ++i)
        EXPECT_LT((half_way.row(i) - turned(times[i]).positions.row(i)).norm(), 1e-6);
}

TEST(Stagger, APointwisePathHasUnitNormalsAndTheSameBitsForAnyNumberOfThreads) {
    const Positions plane = shapes::grid(20);
    const Normals up = Vector3::UnitZ().transpose().replicate(plane.rows(), 1);
    const auto at = [&](double t) {
        const Matrix3 turn = Eigen::AngleAxisd(2.0 * t, Vector3::UnitX()).toRotationMatrix();
        return OrientedPoints{plane * turn.transpose(), up * turn.transpose()};
    };
    const PointwisePath path(at(0.0), at(1.0), at);
    Values times(plane.rows());
    for (Index i = 0; i < times.size(); ++i) times[i] = static_cast<double>(i) / 399.0;
    const OrientedPoints found = path.at(times);
    EXPECT_LT((found.normals.rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-12);
    for (Index i = 0; i < times.size(); ++i)
        EXPECT_LT((found.normals.row(i) - at(times[i]).normals.row(i)).norm(), 1e-5);
    const ThreadCount one(1);
    EXPECT_EQ(path.at(times).positions, found.positions);
}

}  // namespace
}  // namespace pointmorph

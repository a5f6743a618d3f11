#include "registration/whole.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "shapes.hpp"

namespace pointmorph {
namespace {

/// With these root mean square extents along x, y and z, turned.
Whole box(const Vector3& extents, const Vector3& middle = Vector3::Zero(),
          const Matrix3& turn = Matrix3::Identity()) {
    Whole whole;
    whole.middle = middle.transpose();
    whole.covariance = turn * extents.cwiseAbs2().asDiagonal() * turn.transpose();
    whole.size = extents.norm();
    return whole;
}

TEST(Whole, DistancesAreOfPlaceAndExtentsAtOnce) {
    const Whole one = box({3, 2, 1});
    EXPECT_NEAR(DistanceFrom(one)(one), 0.0, 1e-6);
    EXPECT_NEAR(DistanceFrom(one)(box({3, 2, 1}, {3, 4, 0})), 5.0, 1e-9);
    EXPECT_NEAR(DistanceFrom(one)(box({3, 5, 5}, {0, 0, 0})), 5.0, 1e-9);
    EXPECT_NEAR(DistanceFrom(one)(box({3, 2, 5}, {3, 0, 0})), 5.0, 1e-9);
    // Both turned alike; and the same the other way round.
    const Matrix3 turn = shapes::rotation(3);
    const Whole a = box({3, 2, 1}, {1, 2, 3}, turn), b = box({1, 2, 3}, {1, 2, 3}, turn);
    EXPECT_NEAR(DistanceFrom(a)(b), std::sqrt(8.0), 1e-9);
    EXPECT_NEAR(DistanceFrom(b)(a), DistanceFrom(a)(b), 1e-9);
    for (const double place : {0.0, 0.5, 1.0})
        EXPECT_LE(DistanceFrom(one).at_least(b, place), DistanceFrom(one)(b, place) + 1e-12);
}

TEST(Whole, TheAxisIsTheLengthOfARodAndTheNormalOfAPlate) {
    const Matrix3 turn = shapes::rotation(5);
    const auto along = [&](const Vector3& extents, Index axis) {
        return std::abs(axis_of(box(extents, Vector3::Zero(), turn)).dot(turn.col(axis)));
    };
    EXPECT_NEAR(along({1, 8, 1.5}, 1), 1.0, 1e-9);
    EXPECT_NEAR(along({6, 5, 1}, 2), 1.0, 1e-9);
}

TEST(Whole, WhatLiesAslantIsLaidStraight) {
    const Matrix3 turn = Eigen::AngleAxisd(0.3, Vector3::UnitY()).toRotationMatrix();
    const Whole aslant = box({1, 2, 5}, {1, 2, 3}, turn);
    const Whole straight = straightened(aslant, Vector3::UnitZ());
    EXPECT_NEAR(straight.covariance(0, 2), 0.0, 1e-12);
    EXPECT_NEAR(straight.covariance(1, 2), 0.0, 1e-12);
    EXPECT_GT(std::abs(aslant.covariance(0, 2)), 1.0);
    EXPECT_NEAR(straight.covariance(2, 2), aslant.covariance(2, 2), 1e-12);
    EXPECT_EQ(straight.middle, aslant.middle);
    EXPECT_NEAR(std::abs(axis_of(straight).z()), 1.0, 1e-12);
}

}  // namespace
}  // namespace pointmorph

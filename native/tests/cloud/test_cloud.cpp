#include "pointmorph/cloud/cloud.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>

#include "pointmorph/base/error.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

Cloud full_cloud(const Positions& positions) {
    const auto count = positions.rows();
    return {"head", positions, Normals::Constant(count, 3, 0.5), Colors::Constant(count, 4, 1.0f),
            Values::Constant(count, 0.1)};
}

/// What `validate` finds wrong, or nothing.
std::string found(const Cloud& cloud, Index minimum_points = 4) {
    try {
        validate(cloud, minimum_points);
    } catch (const CloudError& error) {
        EXPECT_EQ(error.subject(), cloud.name);
        EXPECT_FALSE(error.expected().empty());
        EXPECT_FALSE(error.advice().empty());
        EXPECT_EQ(std::string(error.what()), error.subject() + ": expected " + error.expected() +
                                                 ", found " + error.found() + ". " +
                                                 error.advice());
        return error.found();
    }
    return "";
}

std::string found(const Positions& positions) {
    return found(full_cloud(positions));
}

TEST(Validate, NoticesFacesThatDoNotFollowOneAnother) {
    Cloud cloud = full_cloud(shapes::sphere(50));
    cloud.faces = {{0, 3, 6}, {0, 1, 2, 3, 4, 5}};
    EXPECT_EQ(found(cloud), "");
    for (const std::vector<std::int64_t>& offsets :
         {std::vector<std::int64_t>{}, {1, 3, 6}, {0, 3, 7}, {0, 3}, {0, 1000000, 6}, {0, -1, 6}}) {
        cloud.faces.offsets = offsets;
        EXPECT_EQ(found(cloud), "other ends of faces");
    }
}

TEST(Validate, AcceptsAnyRealShape) {
    for (const Positions& p :
         {shapes::grid(2), shapes::sphere(50), shapes::torus(300, 0.2), shapes::cube_noise(4)}) {
        EXPECT_EQ(found(p), "");
        Cloud bare;
        bare.positions = p;
        EXPECT_EQ(found(bare), "");
    }
}

TEST(Validate, AcceptsAnyScaleAndPlace) {
    const Positions p = shapes::sphere(100);
    for (const double scale : {1e-285, 1e-150, 1e-40, 1.0, 1e40, 1e150, 1e285}) {
        EXPECT_EQ(found(scale * p), "") << scale;
        EXPECT_EQ(found((scale * p).rowwise() + 1e6 * scale * Eigen::RowVector3d(3, -2, 1)), "")
            << scale;
    }
    // A narrow strip is a surface.
    Positions strip = shapes::grid(20);
    strip.col(1) *= 1e-4;
    EXPECT_EQ(found(strip * shapes::rotation(1).transpose()), "");
}

TEST(Validate, RefusesExtentsThatLoseDigits) {
    const Positions p = shapes::sphere(100);
    const double tiny = std::numeric_limits<double>::denorm_min();
    EXPECT_TRUE(found(64.0 * tiny * p).ends_with("e-322")) << found(64.0 * tiny * p);
    EXPECT_TRUE(found(1e-300 * p).ends_with("e-300")) << found(1e-300 * p);
    EXPECT_TRUE(found(1e300 * p).ends_with("e+300")) << found(1e300 * p);
    EXPECT_EQ(found(1.5e308 * p), "inf");
}

TEST(Validate, RefusesTooFewPoints) {
    EXPECT_EQ(found(Positions(0, 3)), "none");
    EXPECT_EQ(found(Positions(shapes::cube_noise(1))), "1 point");
    EXPECT_EQ(found(Positions(shapes::cube_noise(3))), "3 points");
    // Whatever the method needs, a surface has three points.
    EXPECT_EQ(found(full_cloud(Positions(0, 3)), 0), "none");
    EXPECT_EQ(found(full_cloud(shapes::cube_noise(2)), 0), "2 points");
    EXPECT_EQ(found(full_cloud(shapes::cube_noise(3)), 0), "");
}

TEST(Validate, RefusesPointsThatAreNoSurface) {
    EXPECT_EQ(found(Positions::Constant(50, 3, 7.5)), "points that all coincide");
    EXPECT_EQ(found(Positions::Zero(50, 3)), "points that all coincide");
    Positions line = Positions::Zero(50, 3);
    for (Index i = 0; i < line.rows(); ++i) line(i, 0) = i;
    for (unsigned seed = 0; seed < 5; ++seed) {
        const Positions turned = line * shapes::rotation(seed).transpose();
        for (const double scale : {1e-280, 1.0, 1e280})
            EXPECT_EQ(found(scale * turned), "points that all lie on one line");
        EXPECT_EQ(found(turned.rowwise() + Eigen::RowVector3d(1e6, 1e6, 0)),
                  "points that all lie on one line");
        // As a file in single precision holds it.
        EXPECT_EQ(found(turned.cast<float>().cast<double>()), "points that all lie on one line");
    }
    line(20, 1) = 1e-2;  // one point beside it is enough
    EXPECT_EQ(found(line), "");
}

TEST(Validate, RefusesNumbersThatArent) {
    const Positions p = shapes::sphere(20);
    for (const double bad : {kNaN, kInfinity, -kInfinity}) {
        Cloud cloud = full_cloud(p);
        cloud.positions(7, 2) = bad;
        EXPECT_EQ(found(cloud), "NaN or infinity at point 7");
        cloud = full_cloud(p);
        cloud.normals(8, 0) = bad;
        EXPECT_EQ(found(cloud), "NaN or infinity at point 8");
        cloud = full_cloud(p);
        cloud.colors(9, 3) = static_cast<float>(bad);
        EXPECT_EQ(found(cloud), "NaN or infinity at point 9");
        cloud = full_cloud(p);
        cloud.radii[10] = bad;
        EXPECT_EQ(found(cloud), "NaN or infinity at point 10");
    }
}

TEST(Validate, RefusesAttributesThatDontFit) {
    const Positions p = shapes::sphere(20);
    Cloud cloud = full_cloud(p);
    cloud.normals.conservativeResize(19, 3);
    EXPECT_EQ(found(cloud), "19 rows for 20 points");
    cloud = full_cloud(p);
    cloud.colors = Colors::Zero(1, 4);
    EXPECT_EQ(found(cloud), "1 rows for 20 points");
    cloud = full_cloud(p);
    cloud.radii = Values::Zero(21);
    EXPECT_EQ(found(cloud), "21 rows for 20 points");

    cloud = full_cloud(p);
    cloud.normals.row(3).setZero();
    EXPECT_EQ(found(cloud), "a zero normal at point 3");
    cloud.normals.row(3).setConstant(1e-200);
    EXPECT_NE(found(cloud).find("at point 3"), std::string::npos);
    cloud.normals.row(3).setConstant(1e200);
    EXPECT_NE(found(cloud).find("at point 3"), std::string::npos);
    cloud.normals.row(3).setConstant(1e-100);
    EXPECT_EQ(found(cloud), "");
    cloud.radii[4] = -1e-9;
    EXPECT_EQ(found(cloud), "a negative radius at point 4");
    cloud.radii[4] = 0.0;
    EXPECT_EQ(found(cloud), "");
}

TEST(Normalization, TakesTheShapeIntoTheUnitBallAndBack) {
    for (const double scale : {1e-285, 1e-150, 1.0, 1e150, 1e285}) {
        const Positions p =
            (scale * shapes::torus(500, 0.3)).rowwise() + scale * Eigen::RowVector3d(9, 8, -7);
        const Normalization unit = normalization(p);
        const Positions inside = unit.apply(p);
        EXPECT_LE(inside.rowwise().norm().maxCoeff(), 1.0 + 1e-15);
        EXPECT_GT(inside.rowwise().norm().maxCoeff(), 0.5);
        EXPECT_LT((unit.restore(inside) - p).cwiseAbs().maxCoeff(), 1e-14 * scale);
    }
}

TEST(Normalization, DoesNotDependOnTheOrderAtAll) {
    const Positions p = shapes::cube_noise(1000);
    const Normalization a = normalization(p);
    const Normalization b = normalization(gather(p, shapes::permutation(1000, 2)));
    EXPECT_EQ(a.center, b.center);
    EXPECT_EQ(a.scale, b.scale);
}

TEST(SpatialOrder, IsAPermutationThatIgnoresTheInputsOrder) {
    Positions p = shapes::cube_noise(3000);
    p.row(5) = p.row(2000);  // the only two that coincide: interchangeable
    const auto order = spatial_order(p);
    auto sorted = order;
    std::ranges::sort(sorted);
    std::vector<Index> all(3000);
    std::iota(all.begin(), all.end(), 0);
    EXPECT_EQ(sorted, all);

    const Positions shuffled = gather(p, shapes::permutation(3000, 6));
    EXPECT_EQ(gather(p, order), gather(shuffled, spatial_order(shuffled)));
}

TEST(SpatialOrder, VisitsOctantAfterOctant) {
    const Positions p = shapes::cube_noise(4000);
    const auto order = spatial_order(p);
    const Vector3 low = p.colwise().minCoeff();
    const double half = (p.colwise().maxCoeff().transpose() - low).maxCoeff() / 2.0;
    int before = 0;
    for (const Index i : order) {
        int octant = 0;
        for (int d = 0; d < 3; ++d) octant |= (p(i, d) - low[d] > half) << d;
        EXPECT_GE(octant, before);
        before = octant;
    }
    EXPECT_EQ(before, 7);
}

TEST(SpatialOrder, SortsOneCellByCoordinates) {
    Positions p(5, 3);  // all but one in a cell, too close for the curve to tell
    p << 1e-9, 0, 0, 0, 2e-9, 0, 0, 1e-9, 1e-9, 0, 1e-9, 0, 1, 1, 1;
    EXPECT_EQ(spatial_order(p), (std::vector<Index>{3, 2, 1, 0, 4}));
    EXPECT_TRUE(spatial_order(Positions(0, 3)).empty());
    EXPECT_EQ(spatial_order(Positions::Constant(4, 3, 2.0)), (std::vector<Index>{0, 1, 2, 3}));
}

TEST(InverseOrder, UndoesAnOrder) {
    const Positions p = shapes::cube_noise(200);
    const auto order = shapes::permutation(200, 9);
    EXPECT_EQ(gather(Positions(gather(p, order)), inverse_order(order)), p);
}

TEST(Example, Cloud) {
    const Cloud cloud = full_cloud(shapes::sphere(200));
    // --- example
    validate(cloud, 16);
    const Normalization unit = normalization(cloud.positions);
    const std::vector<Index> order = spatial_order(cloud.positions);
    const Positions p = unit.apply(gather(cloud.positions, order));
    const Positions back = gather(unit.restore(p), inverse_order(order));
    // --- end of the example
    EXPECT_LT((back - cloud.positions).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_LE(p.rowwise().norm().maxCoeff(), 1.0 + 1e-12);
}

}  // namespace
}  // namespace pointmorph

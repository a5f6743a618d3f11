#include "pointmorph/surface/mls.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "pointmorph/base/error.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

double sphere_spacing(Index count) {
    return std::sqrt(4.0 * std::numbers::pi / count);
}

/// Random places up to a quarter of a spacing off the unit sphere, and how far their feet are from
/// it: root mean squares of the distance and of the normals' error.
struct Errors {
    double distance = 0.0, normal = 0.0, idempotence = 0.0;
};
Errors on_sphere(const Positions& points, const MlsOptions& options, double spacing) {
    const Normals normals = points.rowwise().normalized();
    const KdTree<3> tree(points);
    MlsProjection project(tree, normals, options);
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> off(-0.25, 0.25);
    Errors errors;
    constexpr int kPlaces = 300;
    for (int i = 0; i < kPlaces; ++i) {
        const Vector3 direction =
            Vector3(normal(random), normal(random), normal(random)).normalized();
        const MlsFoot foot = project((1.0 + off(random) * spacing) * direction, direction, spacing);
        EXPECT_TRUE(foot.found);
        const double distance = foot.position.norm() - 1.0;
        errors.distance += distance * distance / kPlaces;
        errors.normal += (foot.normal - foot.position.normalized()).squaredNorm() / kPlaces;
        const MlsFoot again = project(foot.position, foot.normal, spacing);
        errors.idempotence += (again.position - foot.position).squaredNorm() / kPlaces;
    }
    return {std::sqrt(errors.distance), std::sqrt(errors.normal), std::sqrt(errors.idempotence)};
}

TEST(Mls, ErrorsFallWithTheSpacingAsTheDegreeSays) {
    // Distances: h², h⁴ (odd orders cancel on an even sampling), h⁴ and h⁶ at least; at the degree
    // of 4 the ridge is seen first.
    const std::array<double, 4> least_ratio{3.5, 10.0, 10.0, 20.0};
    for (Index degree = 1; degree <= 4; ++degree) {
        MlsOptions options;
        options.degree = degree;
        const Errors coarse = on_sphere(shapes::sphere(2000), options, sphere_spacing(2000));
        const Errors fine = on_sphere(shapes::sphere(8000), options, sphere_spacing(8000));
        EXPECT_GT(coarse.distance / fine.distance, least_ratio[to_size(degree - 1)]) << degree;
        EXPECT_GT(coarse.normal / fine.normal, 1.7) << degree;
        EXPECT_LT(fine.distance, (degree == 1 ? 0.1 : 0.002) * sphere_spacing(8000)) << degree;
    }
}

TEST(Mls, ProjectingTwiceChangesNothing) {
    for (const Index degree : {1, 2, 3}) {
        MlsOptions options;
        options.degree = degree;
        const double spacing = sphere_spacing(3000);
        EXPECT_LT(on_sphere(shapes::sphere(3000), options, spacing).idempotence, 2e-4 * spacing)
            << degree;
    }
}

TEST(Mls, APlaneIsItselfUpToItsBorder) {
    const Positions plane = shapes::grid(30);
    const Normals up = Eigen::RowVector3d(0, 0, 1).replicate(plane.rows(), 1);
    const KdTree<3> tree(plane);
    for (Index degree = 1; degree <= 4; ++degree) {
        MlsOptions options;
        options.degree = degree;
        MlsProjection project(tree, up, options);
        for (const double x : {0.0, 0.31, 0.97, 1.0}) {
            const MlsFoot foot = project({x, 0.11, 0.02}, Vector3(0.1, 0, 1).normalized(), 0.069);
            ASSERT_TRUE(foot.found);
            EXPECT_NEAR(foot.position.z(), 0.0, 1e-9);
            EXPECT_NEAR(foot.normal.z(), 1.0, 1e-12);
            EXPECT_LT((foot.position - Vector3(x, 0.11, 0)).norm(), 0.01);
        }
    }
}

TEST(Mls, BothSidesOfAThinSheetStayApart) {
    const Positions plane = shapes::grid(30);
    const double thickness = 0.01;  // a seventh of the spacing
    Positions sheet(2 * plane.rows(), 3);
    Normals normals(2 * plane.rows(), 3);
    sheet << plane, plane.rowwise() + Eigen::RowVector3d(0.01, 0.02, -thickness);
    normals << Eigen::RowVector3d(0, 0, 1).replicate(plane.rows(), 1),
        Eigen::RowVector3d(0, 0, -1).replicate(plane.rows(), 1);
    const KdTree<3> tree(sheet);
    MlsProjection project(tree, normals, {});
    const MlsFoot top = project({0.2, 0.3, -0.004}, {0, 0, 1}, 0.069);
    const MlsFoot bottom = project({0.2, 0.3, -0.004}, {0, 0, -1}, 0.069);
    EXPECT_NEAR(top.position.z(), 0.0, 1e-9);
    EXPECT_NEAR(bottom.position.z(), -thickness, 1e-9);
    EXPECT_NEAR(bottom.normal.z(), -1.0, 1e-9);
}

TEST(Mls, AveragesNoiseOut) {
    Positions points = shapes::sphere(4000);
    const double spacing = sphere_spacing(4000);
    std::mt19937_64 random(5);
    std::normal_distribution<double> noise(0.0, 0.2 * spacing);
    for (Index i = 0; i < points.rows(); ++i) points.row(i) *= 1.0 + noise(random);
    EXPECT_LT(on_sphere(points, {}, spacing).distance, 0.12 * spacing);
    MlsOptions wide;
    wide.scale = 3.0;
    EXPECT_LT(on_sphere(points, wide, spacing).distance, 0.05 * spacing);
}

TEST(Mls, WideRegistersChangeNoBit) {
    const Positions points = shapes::sphere(3000) + 0.01 * Positions::Random(3000, 3);
    const Normals normals = points.rowwise().normalized();
    const KdTree<3> tree(points);
    for (Index degree = 1; degree <= 4; ++degree) {
        MlsOptions options;
        options.degree = degree;
        MlsProjection wide(tree, normals, options), narrow(tree, normals, options, false);
        for (Index i = 0; i < 200; ++i) {
            const Vector3 normal = normals.row(i), place = 1.02 * normal;
            const MlsFoot one = wide(place, normal, sphere_spacing(3000)),
                          other = narrow(place, normal, sphere_spacing(3000));
            ASSERT_TRUE(one.found);
            EXPECT_EQ(one.position, other.position);
            EXPECT_EQ(one.normal, other.normal);
            EXPECT_NEAR(one.position.norm(), 1.0, 0.02);
        }
    }
}

TEST(Mls, DoesNotOvershootAtASharpEdge) {
    // The planes z = 0, x < 0 and x = 0, z < 0.
    const Positions plane = shapes::grid(41);
    std::vector<Vector3> points, directions;
    for (Index i = 0; i < plane.rows(); ++i)
        if (plane(i, 0) <= 0.0) {
            points.emplace_back(plane(i, 0), plane(i, 1), 0.0);
            directions.emplace_back(0, 0, 1);
            points.emplace_back(0.0, plane(i, 1), plane(i, 0));
            directions.emplace_back(1, 0, 0);
        }
    Positions rows(static_cast<Eigen::Index>(points.size()), 3);
    Normals normals(rows.rows(), 3);
    for (std::size_t i = 0; i < points.size(); ++i) {
        rows.row(static_cast<Eigen::Index>(i)) = points[i];
        normals.row(static_cast<Eigen::Index>(i)) = directions[i];
    }
    const KdTree<3> tree(rows);
    MlsProjection project(tree, normals, {});
    const double spacing = 0.05;
    for (double x = -0.1; x <= 0.0; x += 0.01) {
        const MlsFoot foot = project({x, 0.02, 0.0}, {0, 0, 1}, spacing);
        EXPECT_NEAR(foot.position.z(), 0.0, 1e-6) << x;  // only its own side counts
        const MlsFoot corner = project({x, 0.02, x}, Vector3(1, 0, 1).normalized(), spacing);
        EXPECT_LT(corner.position.x(), 0.5 * spacing) << x;
        EXPECT_LT(corner.position.z(), 0.5 * spacing) << x;
    }
}

TEST(Mls, TheSameAtAnyScalePlaceAndOrientation) {
    const Positions points = shapes::sphere(2000);
    const double spacing = sphere_spacing(2000);
    const Matrix3 turn = shapes::rotation(4);
    const Vector3 direction = Vector3(1, 2, 3).normalized();
    const KdTree<3> tree(points);
    const MlsFoot expected = MlsProjection(tree, points, {})(1.01 * direction, direction, spacing);
    for (const double size : {1e-6, 1.0, 1e6}) {
        const Vector3 place = size * Vector3(100, -50, 30);
        const Positions moved = (size * points * turn.transpose()).rowwise() + place.transpose();
        const Normals turned = points * turn.transpose();
        const KdTree<3> there(moved);
        const MlsFoot foot = MlsProjection(there, turned, {})(
            size * (turn * (1.01 * direction)) + place, turn * direction, size * spacing);
        EXPECT_LT((foot.position - place - size * (turn * expected.position)).norm(), 1e-5 * size);
        EXPECT_LT((foot.normal - turn * expected.normal).norm(), 1e-4);
    }
}

TEST(Mls, AFixedWidthDoesNotFollowTheSpacing) {
    const Positions points = shapes::sphere(2000);
    const KdTree<3> tree(points);
    MlsOptions options;
    options.width = 0.2;
    MlsProjection project(tree, points, options);
    const Vector3 direction = Vector3(1, 2, 3).normalized();
    EXPECT_EQ(project(direction, direction, 0.1).position,
              project(direction, direction, 0.9).position);
}

TEST(Mls, SaysWhenThePointsDoNotTell) {
    const Vector3 place(0.1, 0.2, 0.3), normal(0, 0, 1);
    const auto none_in = [&](const Positions& points) {
        const Normals normals = normal.transpose().replicate(points.rows(), 1);
        const KdTree<3> tree(points);
        const MlsFoot foot = MlsProjection(tree, normals, {})(place, normal, 0.1);
        return !foot.found && foot.position == place && foot.normal == normal;
    };
    EXPECT_TRUE(none_in(Positions(0, 3)));
    EXPECT_TRUE(none_in(place.transpose()));
    EXPECT_TRUE(none_in(place.transpose().replicate(50, 1)));
    Positions line = place.transpose().replicate(50, 1);
    for (Index i = 0; i < 50; ++i) line(i, 0) += 0.01 * (i - 25);
    EXPECT_TRUE(none_in(line));
    EXPECT_TRUE(none_in(place.transpose().replicate(50, 1).array() + 5.0));
}

TEST(Mls, RefusesBadOptions) {
    const Positions points = shapes::sphere(100);
    const KdTree<3> tree(points);
    MlsOptions degree, scale, width;
    degree.degree = 5;
    scale.scale = 0.0;
    width.width = std::nan("");
    for (const MlsOptions& options : {degree, scale, width})
        EXPECT_THROW(MlsProjection(tree, points, options), OptionError);
}

TEST(Example, Mls) {
    const Positions positions = shapes::sphere(2000);
    const Normals& normals = positions;
    const KdTree<3> tree(positions);
    const double spacing = sphere_spacing(2000);
    const Vector3 normal = Vector3(1, 2, 3).normalized(), place = 1.01 * normal;
    // --- example
    MlsProjection project(tree, normals, {.degree = 2});
    const MlsFoot foot = project(place, normal, spacing);
    const Vector3 on_surface = foot.found ? foot.position : place;
    // --- end of the example
    EXPECT_NEAR(on_surface.norm(), 1.0, 1e-3);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/surface/local_triangles.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "pointmorph/base/parallel.hpp"
#include "shaken_shapes.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

std::vector<Triangle> triangles_of(const Positions& positions, const Normals& normals,
                                   double reach = 2.0) {
    Progress progress;
    const auto nearest = nearest_neighbors(KdTree<3>(positions), 16, progress);
    return local_triangles(positions, normals, nearest, local_spacing(positions, nearest), reach,
                           progress);
}

TEST(LocalTriangles, AreDelaunayInThePlane) {
    const Positions points = shapes::shaken_grid(20, 0.3);
    const auto triangles = triangles_of(points, shapes::up(points.rows()));
    // All of a triangulation but slivers on the border: 2 n − 2 − border.
    EXPECT_NEAR(static_cast<double>(triangles.size()), 2.0 * 400 - 2 - 76, 30);
    for (const auto& [a, b, c] : triangles) {
        const Eigen::Vector2d p = points.row(a).head<2>(), q = points.row(b).head<2>(),
                              r = points.row(c).head<2>();
        Eigen::Matrix2d sides;
        sides << (q - p).transpose(), (r - p).transpose();
        const Eigen::Vector2d center =
            p + sides.inverse() * Eigen::Vector2d((q - p).squaredNorm(), (r - p).squaredNorm()) / 2;
        const double radius = (p - center).norm();
        for (Index i = 0; i < points.rows(); ++i)
            EXPECT_GE((points.row(i).head<2>().transpose() - center).norm(), radius * (1 - 1e-9));
    }
}

TEST(LocalTriangles, CloseASphere) {
    const Positions points = shapes::sphere(1000);
    const auto triangles = triangles_of(points, points);
    EXPECT_NEAR(static_cast<double>(triangles.size()), 2.0 * 1000 - 4, 60);
    std::vector<int> corners(1000);
    for (const Triangle& triangle : triangles)
        for (const Index corner : triangle) ++corners[to_size(corner)];
    EXPECT_GE(*std::ranges::min_element(corners), 3);
}

TEST(LocalTriangles, LeaveHolesOpenAndSheetsApart) {
    const Positions points = shapes::shaken_grid(40, 0.3);
    std::vector<Index> kept;
    for (Index i = 0; i < points.rows(); ++i)
        if (points.row(i).norm() > 0.3) kept.push_back(i);
    const Positions ring = points(kept, Eigen::all);
    for (const auto& [a, b, c] : triangles_of(ring, shapes::up(ring.rows())))
        EXPECT_GT(((ring.row(a) + ring.row(b) + ring.row(c)) / 3.0).norm(), 0.2);

    Positions sheets(2 * points.rows(), 3);
    Normals normals(2 * points.rows(), 3);
    sheets << points, points.rowwise() - Eigen::RowVector3d(0, 0, 0.02);
    normals << shapes::up(points.rows()), -shapes::up(points.rows());
    const auto rows = to_index(points.rows());
    const auto triangles = triangles_of(sheets, normals);
    EXPECT_GT(triangles.size(), 2U * 2U * 1500U * 95U / 100U);
    for (const auto& [a, b, c] : triangles) EXPECT_EQ(a < rows, c < rows);
}

TEST(LocalTriangles, CoincidentPointsAndTinyCloudsDoNoHarm) {
    Positions points(200, 3);
    points << shapes::shaken_grid(10, 0.3), shapes::shaken_grid(10, 0.3);
    EXPECT_GT(triangles_of(points, shapes::up(200)).size(), 100U);
    EXPECT_TRUE(triangles_of(Positions::Zero(20, 3), shapes::up(20)).empty());
    EXPECT_TRUE(triangles_of(Positions(0, 3), shapes::up(0)).empty());
    EXPECT_TRUE(triangles_of(Positions::Zero(1, 3), shapes::up(1)).empty());
}

TEST(LocalTriangles, AreSortedEachOnce) {
    std::mt19937 random(3);
    std::vector<Triangle> triangles;
    for (int k = 0; k < 5000; ++k) {
        Triangle corners;
        for (Index& corner : corners) corner = to_index(random() % 40);
        std::ranges::rotate(corners, std::ranges::min_element(corners));
        triangles.push_back(corners);
    }
    const std::set<Triangle> expected(triangles.begin(), triangles.end());
    for (std::size_t k = 0; k < triangles.size(); k += 100)
        triangles.insert(triangles.begin() + static_cast<std::ptrdiff_t>(k), kNoTriangle);
    Progress progress;
    const auto found = sorted_once(triangles, 40, progress);
    EXPECT_LT(found.size(), triangles.size());
    EXPECT_EQ(found, std::vector<Triangle>(expected.begin(), expected.end()));
    EXPECT_TRUE(sorted_once({}, 3, progress).empty());
}

TEST(LocalTriangles, SameForAnyNumberOfThreads) {
    const Positions points = shapes::torus(3000, 0.4);
    const Normals normals = points.rowwise().normalized();
    const auto with = [&](int count) {
        const ThreadCount threads(count);
        return triangles_of(points, normals);
    };
    EXPECT_EQ(with(1), with(2));
}

TEST(Example, LocalTriangles) {
    const Positions positions = shapes::sphere(1000);
    const Normals& normals = positions;
    const KdTree<3> tree(positions);
    Progress progress;
    // --- example
    const auto near = nearest_neighbors(tree, 16, progress);
    const Values spacing = local_spacing(positions, near);
    const auto triangles = local_triangles(positions, normals, near, spacing, 2.0, progress);
    // --- end of the example
    EXPECT_NEAR(static_cast<double>(triangles.size()), 2.0 * 1000 - 4, 60);
}

}  // namespace
}  // namespace pointmorph

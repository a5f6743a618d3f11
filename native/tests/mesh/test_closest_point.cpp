#include "pointmorph/mesh/closest_point.hpp"

#include <gtest/gtest.h>

#include <ctime>
#include <random>

#include "mesh_shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

Vector3 corner(const Mesh& mesh, Index f, Index k) {
    return mesh.positions.row(mesh.triangles(f, k)).transpose();
}

SurfacePoint by_brute_force(const Mesh& mesh, const Vector3& p) {
    SurfacePoint best;
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
        SurfacePoint point =
            closest_on_triangle(p, corner(mesh, f, 0), corner(mesh, f, 1), corner(mesh, f, 2));
        point.triangle = f;
        if (point.squared_distance < best.squared_distance) best = point;
    }
    return best;
}

std::vector<Vector3> random_places(int count, double size) {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> uniform(-size, size);
    std::vector<Vector3> places;
    for (int i = 0; i < count; ++i)
        places.emplace_back(uniform(random), uniform(random), uniform(random));
    return places;
}

TEST(ClosestPoint, OnATriangleIsTheLeastOfMany) {
    const Vector3 a(0, 0, 0), b(2, 0.2, 0.1), c(0.3, 1.5, -0.2);
    for (const Vector3& p : random_places(200, 2.5)) {
        const SurfacePoint found = closest_on_triangle(p, a, b, c);
        EXPECT_NEAR(found.weights.sum(), 1.0, 1e-12);
        EXPECT_GE(found.weights.minCoeff(), 0.0);
        constexpr int kSteps = 60;
        double least = std::numeric_limits<double>::infinity();
        for (int i = 0; i <= kSteps; ++i)
            for (int j = 0; j <= kSteps - i; ++j) {
                const double u = static_cast<double>(i) / kSteps;
                const double v = static_cast<double>(j) / kSteps;
                least = std::min(least, ((1 - u - v) * a + u * b + v * c - p).squaredNorm());
            }
        EXPECT_LE(found.squared_distance, least + 1e-12);
        EXPECT_NEAR(std::sqrt(found.squared_distance), std::sqrt(least), 0.05);
    }
}

TEST(ClosestPoint, AgreesWithBruteForce) {
    Progress progress;
    for (const Cloud& cloud :
         {mesh_shapes::cube(), mesh_shapes::icosphere(3), mesh_shapes::cylinder(40)}) {
        const Mesh mesh = make_mesh(cloud);
        const TriangleTree tree(mesh.positions, mesh.triangles, progress);
        for (const Vector3& p : random_places(300, 1.2)) {
            const SurfacePoint expected = by_brute_force(mesh, p);
            const SurfacePoint found = tree.closest(p);
            EXPECT_EQ(found.squared_distance, expected.squared_distance);
            EXPECT_EQ(found.triangle, expected.triangle);
            EXPECT_EQ(tree.closest(p, 10.0, 7).squared_distance, expected.squared_distance);
        }
    }
}

/// Processor time for the closest points to some places.
double time_on(const Mesh& mesh, const Positions& positions) {
    Progress progress;
    const TriangleTree tree(positions, mesh.triangles, progress);
    const std::vector<Vector3> places = random_places(4000, 1.2);  // long beside ticks of 1 ms
    const std::clock_t begin = std::clock();
    for (const Vector3& p : places) EXPECT_GE(tree.closest(p).triangle, 0);
    return static_cast<double>(std::clock() - begin);
}

TEST(ClosestPoint, TakesNoLongerWhereAllHasCollapsed) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    const Mesh mesh = make_mesh(mesh_shapes::icosphere(6));
    const Positions collapsed =
        Vector3(0.1, 0.2, 0.3).transpose().replicate(mesh.positions.rows(), 1);
    const TriangleTree tree(collapsed, mesh.triangles, progress);
    EXPECT_EQ(tree.closest({1, 0, 0}).triangle, 0);
    // With every triangle asked, it is some hundred times as long.
    EXPECT_LT(time_on(mesh, collapsed), 10.0 * time_on(mesh, mesh.positions));
}

TEST(ClosestPoint, LooksNoFartherThanAsked) {
    Progress progress;
    const Mesh mesh = make_mesh(mesh_shapes::icosphere(2));
    const TriangleTree tree(mesh.positions, mesh.triangles, progress);
    const Vector3 outside(3, 0, 0);
    const double distance = std::sqrt(tree.closest(outside).squared_distance);
    EXPECT_EQ(tree.closest(outside, 0.99 * distance).triangle, -1);
    EXPECT_GE(tree.closest(outside, 1.01 * distance).triangle, 0);
}

TEST(ClosestPoint, FollowsMovedCorners) {
    Progress progress;
    const Mesh mesh = make_mesh(mesh_shapes::icosphere(3));
    TriangleTree tree(mesh.positions, mesh.triangles, progress);
    Mesh moved = mesh;
    moved.positions.col(0) *= 2.0;
    moved.positions.col(1).array() += 0.3;
    tree.move(moved.positions, progress);
    for (const Vector3& p : random_places(200, 2.0))
        EXPECT_EQ(tree.closest(p).squared_distance, by_brute_force(moved, p).squared_distance);
}

TEST(ClosestPoint, TakesTrianglesThatCoincideAndNone) {
    Progress progress;
    const Triangles none(0, 3);
    const Positions nowhere(0, 3);
    EXPECT_EQ(TriangleTree(nowhere, none, progress).closest({0, 0, 0}).triangle, -1);
    Positions p(3, 3);
    p << 0, 0, 0, 1, 0, 0, 0, 1, 0;
    const Triangles same = Eigen::RowVector3i(0, 1, 2).replicate(100, 1);
    const TriangleTree tree(p, same, progress);
    EXPECT_EQ(tree.closest({0.2, 0.2, 1}).triangle, 0);
    EXPECT_EQ(tree.closest({0.2, 0.2, 1}).squared_distance, 1.0);
}

TEST(Example, ClosestPoint) {
    Progress progress;
    const Mesh mesh = make_mesh(mesh_shapes::icosphere(3));
    const Vector3 place(0.1, 0.2, 2.0);
    // --- example
    const TriangleTree tree(mesh.positions, mesh.triangles, progress);
    const SurfacePoint point = tree.closest(place);
    const Vector3 on_mesh = place_of(point, mesh.triangles, mesh.positions);
    // --- end of the example
    EXPECT_NEAR((on_mesh - place).squaredNorm(), point.squared_distance, 1e-12);
    EXPECT_NEAR(point.squared_distance, by_brute_force(mesh, place).squared_distance, 1e-12);
}

}  // namespace
}  // namespace pointmorph

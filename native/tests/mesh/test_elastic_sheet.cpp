#include "mesh/elastic_sheet.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "mesh_shapes.hpp"

namespace pointmorph {
namespace {

Positions laplacian_of(const ElasticSheet& sheet, const Positions& x) {
    Positions result = Positions::Zero(x.rows(), 3);
    const Laplacian& l = sheet.laplacian();
    for (Index i = 0; i < l.size(); ++i)
        for (Index k = l.offsets[to_size(i)]; k < l.offsets[to_size(i) + 1]; ++k)
            result.row(i) += l.weights[to_size(k)] * (x.row(i) - x.row(l.neighbors[to_size(k)]));
    return result;
}

/// What pulls the vertices from where they are.
double pull(ElasticSheet& sheet, const Positions& x, double flat) {
    Progress progress;
    const Normals normals = sheet.normals(x, progress);
    return (sheet.forces(x, normals, flat, progress) - laplacian_of(sheet, x)).norm();
}

TEST(ElasticSheet, IsAtRestWhereItIsTurnedOnly) {
    Progress progress;
    const Mesh mesh = make_mesh(mesh_shapes::icosphere(2));
    ElasticSheet sheet(mesh.positions, mesh.triangles, progress);
    const Matrix3 turn = Eigen::AngleAxisd(2.5, Vector3(1, 2, 3).normalized()).toRotationMatrix();
    // Forces of triangles, of about a tenth here, are kept in single precision.
    constexpr double kNone = 1e-6;
    EXPECT_LT(pull(sheet, mesh.positions, 0.0), kNone);
    ElasticSheet again(mesh.positions, mesh.triangles, progress);
    EXPECT_LT(pull(again, mesh.positions * turn.transpose(), 0.0), kNone);
}

TEST(ElasticSheet, TakesOnASmoothStretch) {
    Progress progress;
    const Mesh mesh = make_mesh(mesh_shapes::grid(12));
    ElasticSheet sheet(mesh.positions, mesh.triangles, progress);
    Positions x = mesh.positions;
    x.col(0) *= 2.0;
    x.col(1) *= 0.7;
    EXPECT_GT(pull(sheet, x, 0.0), 0.1);
    sheet.set_metric(x, 5, progress);
    // The metric is kept in single precision.
    for (const double flat : {0.0, 0.5, 1.0}) EXPECT_LT(pull(sheet, x, flat), 1e-5) << flat;
    EXPECT_NEAR(sheet.area_ratio(0), 1.4, 1e-6);
}

TEST(ElasticSheet, KeepsItsTrianglesInThePlaneWhereItIsFlat) {
    Progress progress;
    const Mesh mesh = make_mesh(mesh_shapes::terrain(
        8, [](double x, double y) { return 0.2 * std::sin(3 * x) * std::cos(3 * y); }));
    ElasticSheet sheet(mesh.positions, mesh.triangles, progress);
    Normals up = Normals::Zero(mesh.positions.rows(), 3);
    up.col(2).setOnes();
    EXPECT_LT(sheet.forces(mesh.positions, up, 1.0, progress).col(2).norm(), 1e-12);
}

TEST(ElasticSheet, KnowsNormals) {
    Progress progress;
    const Mesh mesh = make_mesh(mesh_shapes::cylinder(24));
    const ElasticSheet sheet(mesh.positions, mesh.triangles, progress);
    const Normals normals = sheet.normals(mesh.positions, progress);
    for (Index v = 0; v < normals.rows(); ++v) {
        EXPECT_NEAR(normals.row(v).norm(), 1.0, 1e-12);
        EXPECT_GT(normals.row(v).dot(mesh.positions.row(v)), 0.0);
    }
}

}  // namespace
}  // namespace pointmorph

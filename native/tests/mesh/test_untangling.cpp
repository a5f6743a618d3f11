#include "mesh/untangling.hpp"

#include <gtest/gtest.h>

#include <random>

#include "mesh_shapes.hpp"

namespace pointmorph {
namespace {

struct Sheet {
    Mesh mesh = make_mesh(mesh_shapes::grid(14));
    Progress progress;
    ElasticSheet sheet{mesh.positions, mesh.triangles, progress};
    WrapPartners planes{mesh.positions, Normals::Zero(mesh.positions.rows(), 3)};
    std::vector<char> is_fixed = std::vector<char>(to_size(mesh.positions.rows()), 0);

    Sheet() { planes.normals.col(2).setOnes(); }

    Index turned(const Positions& x) const {
        Index count = 0;
        for (Index f = 0; f < mesh.triangles.rows(); ++f) {
            const auto a = x.row(mesh.triangles(f, 0)), b = x.row(mesh.triangles(f, 1)),
                       c = x.row(mesh.triangles(f, 2));
            count += (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]) <= 0.0;
        }
        return count;
    }
    Index untangled(Positions& x) {
        Progress progress;
        return untangle(mesh, sheet, planes, is_fixed, {}, x, progress);
    }
};

TEST(Untangling, TurnsFacesBack) {
    Sheet sheet;
    Positions x = sheet.mesh.positions;
    const Index middle = 7 * 15 + 7;
    x.row(middle) += Eigen::RowVector3d(0.3, 0.25, 0.05);
    x.row(middle + 1) += Eigen::RowVector3d(-0.2, -0.2, 0.0);
    EXPECT_GT(sheet.turned(x), 0);
    EXPECT_EQ(sheet.untangled(x), 0);
    EXPECT_EQ(sheet.turned(x), 0);
    EXPECT_LT(x.col(2).cwiseAbs().maxCoeff(), 0.01);
}

TEST(Untangling, MovesOnlyWhatIsAround) {
    Sheet sheet;
    Positions x = sheet.mesh.positions;
    x.row(3 * 15 + 3) += Eigen::RowVector3d(0.3, 0.0, 0.0);
    const Positions before = x;
    EXPECT_EQ(sheet.untangled(x), 0);
    EXPECT_EQ(x.bottomRows(60), before.bottomRows(60));
}

TEST(Untangling, LeavesWhatIsRight) {
    Sheet sheet;
    Positions x = sheet.mesh.positions;
    EXPECT_EQ(sheet.untangled(x), 0);
    EXPECT_EQ(x, sheet.mesh.positions);
}

TEST(Untangling, LeavesFixedVertices) {
    Sheet sheet;
    Positions x = sheet.mesh.positions;
    const Index middle = 7 * 15 + 7;
    x.row(middle) += Eigen::RowVector3d(0.12, 0.1, 0.0);
    sheet.is_fixed[to_size(middle)] = 1;
    const Eigen::RowVector3d at = x.row(middle);
    sheet.untangled(x);
    EXPECT_EQ(x.row(middle), at);
    EXPECT_EQ(sheet.turned(x), 0);
}

TEST(Untangling, NeverMakesMoreOfThem) {
    Sheet sheet;
    std::mt19937_64 random(2);
    std::normal_distribution<double> normal;
    for (int time = 0; time < 5; ++time) {
        Positions x = sheet.mesh.positions;
        for (Index v = 0; v < x.rows(); ++v)
            x.row(v) += 0.04 * Eigen::RowVector3d(normal(random), normal(random), 0.0);
        const Index before = sheet.turned(x);
        EXPECT_GT(before, 0);
        sheet.untangled(x);
        EXPECT_LT(sheet.turned(x), before / 4);
    }
}

}  // namespace
}  // namespace pointmorph

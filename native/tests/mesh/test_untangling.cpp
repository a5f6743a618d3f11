#include "mesh/untangling.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <numeric>
#include <random>
#include <string_view>
#include <utility>

#include "mesh/mesh_patches.hpp"
#include "mesh/patch_energy.hpp"
#include "mesh_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "processor_time.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

struct Sheet {
    Mesh mesh;
    Progress progress;
    ElasticSheet sheet{mesh.positions, mesh.triangles, progress};
    WrapPartners planes{mesh.positions, Normals::Zero(mesh.positions.rows(), 3)};
    std::vector<char> is_fixed = std::vector<char>(to_size(mesh.positions.rows()), 0);

    explicit Sheet(Mesh of = make_mesh(mesh_shapes::grid(14))) : mesh(std::move(of)) {
        planes.normals.col(2).setOnes();
    }

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

/// Untangled where `off` says how far vertices are off the target.
Positions untangled_within(Sheet& sheet, const Positions& x, double most_off,
                           const std::function<double(Index, const Vector3&)>& off) {
    UntangleOptions options;
    options.off = off;
    options.most_off = most_off;
    Positions moved = x;
    untangle(sheet.mesh, sheet.sheet, sheet.planes, sheet.is_fixed, options, moved, sheet.progress);
    return moved;
}

TEST(Untangling, LeavesSurroundingsOfWhichManyWouldGoAstray) {
    Sheet sheet;
    Positions x = sheet.mesh.positions;
    const Index middle = 7 * 15 + 7;
    x.row(middle) += Eigen::RowVector3d(0.3, 0.25, 0.05);
    const auto way = [&](Index v, const Vector3& at) { return (at - x.row(v).transpose()).norm(); };
    Positions free = x;
    sheet.untangled(free);
    ASSERT_GT((free - x).rowwise().norm().maxCoeff(), 0.1);
    EXPECT_EQ(untangled_within(sheet, x, 0.5, way), free);  // none goes so far
    EXPECT_EQ(untangled_within(sheet, x, 1e-6, way), x);
}

TEST(Untangling, LeavesWhatIsAroundAFewStrays) {
    Sheet sheet;
    sheet.mesh = make_mesh(mesh_shapes::grid(60));
    sheet.sheet = ElasticSheet(sheet.mesh.positions, sheet.mesh.triangles, sheet.progress);
    const Index count = to_index(sheet.mesh.positions.rows());
    sheet.planes = {sheet.mesh.positions, Normals::Zero(count, 3)};
    sheet.planes.normals.col(2).setOnes();
    sheet.is_fixed.assign(to_size(count), 0);
    Positions x = sheet.mesh.positions;
    std::vector<Index> moved;  // so near to each other that they give way together
    for (Index i = 4; i < 57; i += 5)
        for (Index j = 4; j < 57; j += 5) moved.push_back(i * 61 + j);
    for (const Index v : moved) x.row(v) += Eigen::RowVector3d(0.06, 0.05, 0.01);
    Positions free = x;
    sheet.untangled(free);
    const Index stray = moved[60];
    ASSERT_GT((free.row(stray) - x.row(stray)).norm(), 0.01);
    const Positions kept = untangled_within(sheet, x, 0.005, [&](Index v, const Vector3& at) {
        return v == stray ? (at - x.row(v).transpose()).norm() : 0.0;
    });
    Index changed = 0;
    for (Index v = 0; v < count; ++v) changed += kept.row(v) != free.row(v);
    EXPECT_EQ(kept.row(stray), x.row(stray));
    EXPECT_GT(changed, 10);
    EXPECT_LT(changed, 49);  // three rings
    EXPECT_LT(sheet.turned(kept), sheet.turned(x));
}

/// A sheet all of which gives way: every vertex is moved at random.
struct RumpledSheet : Sheet {
    Positions x;

    explicit RumpledSheet(int side) : Sheet(make_mesh(mesh_shapes::grid(side))) {
        x = mesh.positions;
        std::mt19937_64 random(5);
        std::normal_distribution<double> normal;
        for (Index v = 0; v < x.rows(); ++v)
            x.row(v) += 0.5 / side * Eigen::RowVector3d(normal(random), normal(random), 0.0);
    }
    void untangle_all(int threads, Progress& asked) {
        const ThreadCount scope(threads);
        untangle(mesh, sheet, planes, is_fixed, {}, x, asked);
    }
};

TEST(Untangling, OfAMeshInOnePatchDoesntDependOnThreads) {
    RumpledSheet one(70), three(70);  // 9,800 triangles
    const Index before = one.turned(one.x);
    one.untangle_all(1, one.progress);
    three.untangle_all(3, three.progress);
    EXPECT_EQ(one.x, three.x);
    EXPECT_LT(one.turned(one.x), before / 4);
}

TEST(Untangling, EndsWhereItIsAskedToInAPatch) {
    for (const int side : {30, 70}) {  // as a small patch, and as a large one
        RumpledSheet whole(side);
        int calls = 0;
        Progress counted([&](std::string_view, double) { return ++calls > 0; },
                         std::chrono::milliseconds(0));
        whole.untangle_all(2, counted);
        EXPECT_GT(calls, 100);  // hundreds of steps
        RumpledSheet ended(side);
        int left = 20;
        Progress cancelled([&](std::string_view, double) { return --left > 0; },
                           std::chrono::milliseconds(0));
        EXPECT_THROW(ended.untangle_all(2, cancelled), Cancelled);
        EXPECT_EQ(left, 0);
    }
}

TEST(Untangling, LooksAroundFacesThatAllMeetAtAVertexAsSoon) {
    SKIP_WHERE_WATCHED();
    const auto time = [](const Cloud& cloud) {
        Sheet flat(make_mesh(cloud));
        flat.planes.normals *= -1.0;  // all faces lie against them
        UntangleOptions options;
        options.concerns = [](Index f) { return f % 2 == 0; };
        options.most_rounds = 0;
        return processor_time([&] {
            Positions x = flat.mesh.positions;
            EXPECT_GT(untangle(flat.mesh, flat.sheet, flat.planes, flat.is_fixed, options, x,
                               flat.progress),
                      0);
        });
    };
    // With all faces around a vertex asked for each of these, it is a hundred times as long.
    EXPECT_LT(time(mesh_shapes::fan(20000)), 20.0 * time(mesh_shapes::grid(100)));
}

TEST(PatchEnergy, HasTheGradientOfItsValues) {
    RumpledSheet sheet(4);
    sheet.planes.normals.col(0).setConstant(0.3);
    sheet.planes.normals.rowwise().normalize();
    std::vector<Index> faces(to_size(sheet.mesh.triangles.rows()));
    std::iota(faces.begin(), faces.end(), 0);
    sheet.is_fixed[12] = 1;
    const MeshPatch patch =
        patches_around(sheet.mesh, sheet.sheet, faces, sheet.is_fixed, 0).front();
    ASSERT_EQ(patch.vertices.size(), 24u);
    sheet.x.row(6) += Eigen::RowVector3d(0.5, 0.3, 0.0);  // folded, so that all terms count
    for (const double reach : {0.0, 0.1}) {
        PatchEnergy energy(sheet.mesh, sheet.planes, patch,
                           {.sides = [&](Index f) { return sheet.sheet.metric_sides(f); },
                            .plane_length = 0.02,
                            .reach = reach,
                            .shares = Values::Constant(24, 0.5)},
                           sheet.x);
        EXPECT_LT(energy.least_determinant(energy.start()), 0.0);
        PatchEnergy::Unknowns at = energy.start(), gradient, ignored;
        for (Index i = 0; i < at.size(); ++i) at[i] += 0.01 * ((7 * i) % 5 - 2);
        energy(at, 0.3, gradient, sheet.progress);
        const double step = 1e-6;
        for (Index i = 0; i < at.size(); ++i) {
            PatchEnergy::Unknowns more = at, less = at;
            more[i] += step;
            less[i] -= step;
            const double slope = (energy(more, 0.3, ignored, sheet.progress) -
                                  energy(less, 0.3, ignored, sheet.progress)) /
                                 (2.0 * step);
            EXPECT_NEAR(gradient[i], slope, 1e-5 * gradient.norm());
        }
    }
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

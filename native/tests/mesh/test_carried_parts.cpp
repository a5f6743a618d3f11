#include "mesh/carried_parts.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <chrono>
#include <string_view>
#include <vector>

#include "mesh_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/mesh/mesh_samples.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// A ball with two small ones just under its surface.
struct Face {
    Mesh mesh;
    std::vector<SurfacePoint> on_mesh;  ///< where samples of a target with one skin lie

    Face() {
        Cloud cloud = mesh_shapes::icosphere(4);
        for (const double side : {-0.3, 0.3}) {
            Cloud eye = mesh_shapes::icosphere(2);
            eye.positions *= 0.08;
            eye.positions.rowwise() += Eigen::RowVector3d(side, 0.0, 0.85);
            cloud = mesh_shapes::together(cloud, eye);
        }
        mesh = make_mesh(cloud);
        for (Index f = 0; f < mesh.triangles.rows(); ++f)
            if (part_of(f) == 0) on_mesh.push_back({f, Vector3(1, 0, 0), 0.0});
    }
    Index part_of(Index f) const { return mesh.parts[to_size(mesh.triangles(f, 0))]; }
    std::vector<Index> carried(std::vector<Index> target_parts, const WrapHolds& holds = {}) const {
        return parts_without_counterpart(mesh, target_parts, on_mesh, holds);
    }
    Positions places_of(Index part, const Positions& x) const {
        std::vector<Index> rows;
        for (Index p = 0; p < x.rows(); ++p)
            if (mesh.parts[to_size(p)] == part) rows.push_back(p);
        return gather(x, rows);
    }
};

TEST(CarriedParts, AreSmallAndHaveNothingOfTheirOwnOnTheTarget) {
    Face face;
    EXPECT_EQ(face.carried({0, 0, 0}), (std::vector<Index>{1, 2}));
    EXPECT_EQ(face.carried({0, 1, 0}), (std::vector<Index>{2}));  // one has an eye to go to
    const std::vector<WrapMark> marks{
        {face.mesh.triangles(face.mesh.triangles.rows() - 1, 0), Vector3::Zero()}};
    EXPECT_EQ(face.carried({0, 0, 0}, {.marks = marks}).size(), 1u);
    EXPECT_TRUE(
        face.carried({0, 0, 0}, {.marks = {}, .rigid = Values::Ones(face.mesh.positions.rows())})
            .empty());
    // The target's samples lie on them as on all of the mesh.
    face.on_mesh.clear();
    for (Index f = 0; f < face.mesh.triangles.rows(); ++f)
        face.on_mesh.push_back({f, Vector3(1, 0, 0), 0.0});
    EXPECT_TRUE(face.carried({0, 0, 0}).empty());
}

TEST(CarriedParts, LeaveTheRestAsItIs) {
    const Face face;
    std::vector<SurfacePoint> on_mesh;
    for (Index f = 0; f < face.mesh.triangles.rows(); ++f)
        on_mesh.push_back({f, Vector3(0.5, 0.5, 0.0), 0.0});
    const std::vector<SurfacePoint> before = on_mesh;
    Progress progress;
    const Mesh rest = without_parts(face.mesh, std::vector<Index>{1, 2}, on_mesh, progress);
    EXPECT_EQ(rest.positions, face.mesh.positions);
    EXPECT_EQ(rest.part_areas.size(), 1);
    for (std::size_t s = 0; s < on_mesh.size(); ++s) {
        ASSERT_LT(on_mesh[s].triangle, rest.triangles.rows());
        const Vector3 now = place_of(on_mesh[s], rest.triangles, rest.positions);
        const Vector3 then = place_of(before[s], face.mesh.triangles, face.mesh.positions);
        if (face.part_of(before[s].triangle) == 0) {
            EXPECT_EQ(now, then);
        }
        EXPECT_LT((now - then).norm(), 0.2);
    }
}

TEST(CarriedParts, GoWhereTheSurfaceAroundThemGoes) {
    const Face face;
    const std::vector<Index> parts{1, 2};
    std::vector<SurfacePoint> on_mesh;
    Progress progress;
    const Mesh rest = without_parts(face.mesh, parts, on_mesh, progress);
    Similarity move;
    move.scale = 1.4;
    move.rotation = Eigen::AngleAxisd(1.0, Vector3(1, 2, 3).normalized()).toRotationMatrix();
    move.translation = Vector3(0.3, -0.2, 0.1);
    const Positions truth = move.apply(face.mesh.positions);
    Positions x = truth;
    for (Index p = 0; p < x.rows(); ++p) {
        const Index part = face.mesh.parts[to_size(p)];
        if (part > 0) x.row(p).setZero();
        // Some of what is around them has gone elsewhere.
        if (part == 0 && p % 5 == 0) x.row(p).array() += 0.1;
    }
    const Positions start = x;
    carry_parts(face.mesh, rest, parts, x, progress);
    for (const Index part : parts) {
        const Positions ends = face.places_of(part, x);
        EXPECT_LT((ends - face.places_of(part, truth)).cwiseAbs().maxCoeff(), 0.01);
        const Positions own = face.places_of(part, face.mesh.positions);
        EXPECT_LT((fit_similarity(own, ends).apply(own) - ends).cwiseAbs().maxCoeff(), 1e-9);
    }
    EXPECT_EQ(face.places_of(0, x), face.places_of(0, start));
    const ThreadCount one(1);
    Positions again = start;
    carry_parts(face.mesh, rest, parts, again, progress);
    EXPECT_EQ(again, x);
}

TEST(CarriedParts, SinkIntoWhatHasNothingForThem) {
    const Face face;
    const Mesh skin = make_mesh(mesh_shapes::icosphere(4));
    // One ball half outside of the skin, the other one as it is, inside.
    Positions x = skin.unit.apply(face.mesh.unit.restore(face.mesh.positions));
    const Positions outside = face.places_of(1, x), inside = face.places_of(2, x);
    const Eigen::RowVector3d out = outside.colwise().mean().normalized();
    const double radius = skin.positions.rowwise().norm().minCoeff();
    for (Index p = 0; p < x.rows(); ++p)
        if (face.mesh.parts[to_size(p)] == 1) x.row(p) += 0.2 * radius * out;
    const Positions before = face.places_of(1, x);
    ASSERT_GT(before.rowwise().norm().maxCoeff(), 1.05 * radius);
    Progress progress;
    const std::vector<Index> parts{1, 2};
    const Positions before_all = x;
    Positions alone = x;
    sink_parts(face.mesh, parts, skin, x, progress);
    {
        const ThreadCount one(1);
        sink_parts(face.mesh, parts, skin, alone, progress);
        EXPECT_EQ(alone, x);
        // Asked whether to go on while the parts sink, too: the last time.
        const auto sink_until = [&](int calls) {
            int asked = 0;
            Progress counting([&](std::string_view, double) { return ++asked != calls; },
                              std::chrono::milliseconds(0));
            Positions again = before_all;
            sink_parts(face.mesh, parts, skin, again, counting);
            return asked;
        };
        const int calls = sink_until(0);
        EXPECT_THROW(sink_until(calls), Cancelled);
        int of_tree = 0;
        Progress counting([&](std::string_view, double) { return ++of_tree > 0; },
                          std::chrono::milliseconds(0));
        const TriangleTree tree(skin.positions, skin.triangles, counting);
        EXPECT_GT(calls, of_tree + 1);
    }
    const Positions after = face.places_of(1, x);
    EXPECT_LT(after.rowwise().norm().maxCoeff(), radius);
    EXPECT_GT(after.rowwise().norm().maxCoeff(), 0.97 * radius);
    EXPECT_LT(((after.rowwise() - after.row(0)) - (before.rowwise() - before.row(0)))
                  .cwiseAbs()
                  .maxCoeff(),
              1e-12);
    EXPECT_EQ(face.places_of(2, x), inside);
}

TEST(CarriedParts, KeepTheirShapeOnATargetOfOneSkin) {
    const Face face;
    const auto stretched = [](Positions x) {
        x.col(0) *= 1.2;
        return x;
    };
    Cloud skin = mesh_shapes::icosphere(is_watched() ? 3 : 4);
    skin.positions = stretched(skin.positions);
    const Mesh target = make_mesh(skin);
    Progress progress;
    const Index count = is_watched() ? 500 : 2000;
    const MeshSamples coarse = sample_mesh(target, {}, {.count = count}, progress);
    const MeshSamples fine = sample_mesh(target, {}, {.count = 5 * count, .even = false}, progress);
    WrapTarget onto;
    onto.mesh = &target;
    onto.coarse = {coarse.positions, coarse.normals};
    onto.coarse_parts = coarse.parts;
    onto.fine = {fine.positions, fine.normals};
    onto.fine_parts = fine.parts;
    onto.area = target.area();
    const TriangleTree tree(face.mesh.positions, face.mesh.triangles, progress);
    Positions inverse = target.unit.restore(coarse.positions);
    inverse.col(0) /= 1.2;
    inverse = face.mesh.unit.apply(inverse);
    for (Index s = 0; s < coarse.size(); ++s)
        onto.on_mesh.push_back(tree.closest(inverse.row(s).transpose()));
    const Positions start =
        target.unit.apply(stretched(face.mesh.unit.restore(face.mesh.positions)));
    const Positions x = wrap(face.mesh, start, onto, {}, {}, progress);
    for (const Index part : {1, 2}) {
        const Positions own = face.places_of(part, face.mesh.positions);
        const Positions ends = face.places_of(part, x);
        const Similarity fit = fit_similarity(own, ends);
        EXPECT_NEAR(fit.scale, 1.0, 0.2);
        EXPECT_LT((fit.apply(own) - ends).cwiseAbs().maxCoeff(), 1e-9);
    }
}

}  // namespace
}  // namespace pointmorph

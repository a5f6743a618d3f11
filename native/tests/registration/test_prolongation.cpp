#include "pointmorph/registration/prolongation.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <utility>

#include "joined_shapes.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

Positions shape_map(const Positions& p, const Matrix3& linear) {
    return p * linear.transpose();
}

struct Fixture {
    Positions positions = shapes::sphere(4000);
    Progress progress;
    CoarseShape shape =
        coarse_shape(KdTree<3>(positions), positions, {}, {800, {20}, {}}, progress);
};

TEST(Prolongation, AnAffineMapOfTheCoarsePointsIsOneOfAllPoints) {
    Fixture f;
    Matrix3 linear;
    linear << 1.0, 0.2, 0.0, -0.1, 0.8, 0.3, 0.0, 0.0, 1.5;
    DeformedCloud coarse;
    coarse.positions = shape_map(f.shape.positions, linear);
    coarse.linear.assign(to_size(f.shape.size()), linear);
    const OrientedPoints all = Prolongation(f.shape, f.positions, f.positions, f.progress)(
        f.shape, coarse, f.positions, f.positions, f.progress);
    EXPECT_LT((all.positions - shape_map(f.positions, linear)).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_LT((all.normals.rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-12);
}

/// Coarse points that go anywhere, and what follows them.
struct Scattered : Fixture {
    DeformedCloud coarse;
    Prolongation prolongation{shape, positions, positions, progress};

    Scattered() {
        coarse.positions = shape.positions + 0.1 * Positions::Random(shape.size(), 3);
        for (Index c = 0; c < shape.size(); ++c)
            coarse.linear.push_back(Matrix3::Identity() + 0.3 * Matrix3::Random());
    }
};

TEST(Prolongation, NormalsTurnAsTheLinearPartSays) {
    Scattered f;
    const OrientedPoints all =
        f.prolongation(f.shape, f.coarse, f.positions, f.positions, f.progress);
    for (Index i = 0; i < f.positions.rows(); ++i) {
        const Vector3 turned =
            (f.prolongation.linear(i, f.coarse) * f.positions.row(i).transpose()).normalized();
        ASSERT_LT((all.normals.row(i).transpose() - turned).norm(), 1e-12);
    }
}

TEST(Prolongation, SomePointsGoWhereAllTogetherDoAndOnBySimilarities) {
    Scattered f;
    const OrientedPoints all =
        f.prolongation(f.shape, f.coarse, f.positions, f.positions, f.progress);
    const Matrix3 turn = Eigen::AngleAxisd(1.0, Vector3(1, 2, 3).normalized()).toRotationMatrix();
    const Similarity first{3.0, turn, {1, 2, 3}}, second{0.01, turn, {-5, 0, 1}};
    CoarseMoves moves(f.shape, f.coarse), further = moves;
    further.then(first);
    further.then(second);
    const Similarity both = composed(second, first);
    for (const auto& [begin, end] : {std::pair{0, 1}, {1, 300}, {300, 300}, {3000, 4000}}) {
        OrientedPoints some{f.positions, f.positions}, on = some;
        f.prolongation.move(begin, end, moves, some);
        f.prolongation.move(begin, end, further, on);
        const auto rows = [&](const Positions& of) { return of.middleRows(begin, end - begin); };
        ASSERT_EQ(rows(some.positions), rows(all.positions));
        ASSERT_EQ(rows(some.normals), rows(all.normals));
        ASSERT_EQ(some.positions.bottomRows(4000 - end), f.positions.bottomRows(4000 - end));
        ASSERT_LT((rows(on.positions) - rows(both.apply(all.positions))).norm(), 1e-10);
        ASSERT_LT((rows(on.normals) - rows(both.rotated(all.normals))).norm(), 1e-10);
    }
}

TEST(Prolongation, WideRegistersGiveTheSameBits) {
    Scattered f;
    const CoarseMoves moves(f.shape, f.coarse);
    OrientedPoints wide{f.positions, f.positions}, narrow = wide;
    f.prolongation.move(0, 4000, moves, wide);
    f.prolongation.move(0, 4000, moves, narrow, false);
    EXPECT_EQ(wide.positions, narrow.positions);
    EXPECT_EQ(wide.normals, narrow.normals);
    EXPECT_GT((wide.positions - f.positions).rowwise().norm().maxCoeff(), 0.05);
}

TEST(Prolongation, PointsAtRestGoWhereTheyGoInPlace) {
    Scattered f;
    const CoarseMoves moves(f.shape, f.coarse);
    const FloatNormals normals = f.positions.cast<float>();
    const Positions offsets = 0.2 * Positions::Random(4000, 3);
    OrientedPoints moved{f.positions + 0.3 * offsets, normals.cast<double>()};
    f.prolongation.move(0, 4000, moves, moved);
    for (const bool wide : {true, false}) {
        std::vector<OrientedPoint> points(4000, {{-1, -1, -1}, {-1, -1, -1, -1}});
        f.prolongation.move(10, 900, moves, {f.positions, normals, offsets, 0.3}, points, wide);
        EXPECT_EQ(points[9].position[0], -1.0);
        EXPECT_EQ(points[900].position[0], -1.0);
        for (std::size_t i = 10; i < 900; ++i) {
            for (std::size_t d = 0; d < 3; ++d) {
                ASSERT_EQ(points[i].position[d], moved.positions(to_index(i), to_index(d)));
                ASSERT_EQ(points[i].normal[d],
                          static_cast<float>(moved.normals(to_index(i), to_index(d))));
            }
            ASSERT_EQ(points[i].normal[3], 0.0F);
        }
    }
}

TEST(Prolongation, WhereTurnsCancelANormalTurnsAsTheWhole) {
    Fixture f;
    DeformedCloud coarse;
    coarse.positions = f.shape.positions;
    coarse.linear.assign(to_size(f.shape.size()), Matrix3::Zero());
    CoarseMoves moves(f.shape, coarse);
    const Matrix3 turn = Eigen::AngleAxisd(2.0, Vector3::UnitX()).toRotationMatrix();
    moves.then({1e-9, turn, Vector3::Zero()});
    OrientedPoints points{f.positions, f.positions};
    const Prolongation prolongation(f.shape, f.positions, f.positions, f.progress);
    prolongation.move(0, 4000, moves, points);
    EXPECT_LT((points.normals - f.positions * turn.transpose()).cwiseAbs().maxCoeff(), 1e-12);
    const Positions still = Positions::Zero(4000, 3);
    const FloatNormals normals = f.positions.cast<float>();
    for (const bool wide : {true, false}) {
        std::vector<OrientedPoint> moved(4000);
        prolongation.move(0, 4000, moves, {f.positions, normals, still, 0.0}, moved, wide);
        for (Index i = 0; i < 4000; ++i)
            for (Index d = 0; d < 3; ++d)
                ASSERT_NEAR(moved[to_size(i)].normal[to_size(d)], points.normals(i, d), 1e-6);
    }
}

TEST(Prolongation, FollowsASmoothMapAndReproducesCoarsePoints) {
    Fixture f;
    // x ↦ (x + 0.3 z², y, z), whose derivative is known.
    const auto bend = [](const Eigen::RowVector3d& p) {
        return Eigen::RowVector3d(p[0] + 0.3 * p[2] * p[2], p[1], p[2]);
    };
    DeformedCloud coarse;
    coarse.positions.resize(f.shape.size(), 3);
    for (Index c = 0; c < f.shape.size(); ++c) {
        coarse.positions.row(c) = bend(f.shape.positions.row(c));
        Matrix3 linear = Matrix3::Identity();
        linear(0, 2) = 0.6 * f.shape.positions(c, 2);
        coarse.linear.push_back(linear);
    }
    const OrientedPoints all = Prolongation(f.shape, f.positions, f.positions, f.progress)(
        f.shape, coarse, f.positions, f.positions, f.progress);
    // Taylor's remainder at two coarse spacings.
    const double spacing = std::sqrt(4.0 * std::numbers::pi / 800);
    for (Index i = 0; i < f.positions.rows(); ++i)
        EXPECT_LT((all.positions.row(i) - bend(f.positions.row(i))).norm(),
                  0.3 * 4.0 * spacing * spacing);
    for (Index c = 0; c < f.shape.size(); ++c)
        EXPECT_LT(
            (all.positions.row(f.shape.cloud_rows[to_size(c)]) - coarse.positions.row(c)).norm(),
            0.01 * spacing);
}

TEST(Prolongation, ThinSheetsDoNotMix) {
    const shapes::TwoSheets sheets(30);
    const Positions& p = sheets.positions;
    const Normals& n = sheets.normals;
    Progress progress;
    const CoarseShape shape = coarse_shape(KdTree<3>(p), n, {}, {500, {20}, {}}, progress);
    DeformedCloud coarse;
    coarse.positions = shape.positions;
    coarse.positions.col(2) += 5.0 * shape.normals.col(2);
    coarse.linear.assign(to_size(shape.size()), Matrix3::Identity());
    const OrientedPoints all = Prolongation(shape, p, n, progress)(shape, coarse, p, n, progress);
    EXPECT_LT((all.positions.col(2) - p.col(2) - 5.0 * n.col(2)).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(Prolongation, OneCoarsePointCarriesAll) {
    const Positions p = Positions::Zero(6, 3);
    const Normals n = Normals::Constant(6, 3, 1.0 / std::sqrt(3.0));
    Progress progress;
    const CoarseShape shape = coarse_shape(KdTree<3>(p), n, {}, {100, {20}, {}}, progress);
    DeformedCloud coarse;
    coarse.positions = Positions::Constant(shape.size(), 3, 2.0);
    coarse.linear.assign(to_size(shape.size()), Matrix3::Identity());
    EXPECT_TRUE(Prolongation(shape, p, n, progress)(shape, coarse, p, n, progress)
                    .positions.isApprox(Positions::Constant(6, 3, 2.0)));
}

TEST(Example, Prolongation) {
    Fixture f;
    const CoarseShape& coarse = f.shape;
    const Positions &positions = f.positions, &normals = f.positions;
    const Matrix3 twice = 2.0 * Matrix3::Identity();
    DeformedCloud coarse_images;
    coarse_images.positions = shape_map(coarse.positions, twice);
    coarse_images.linear.assign(to_size(coarse.size()), twice);
    Progress progress;
    // --- example
    const Prolongation prolongation(coarse, positions, normals, progress);
    const OrientedPoints images = prolongation(coarse, coarse_images, positions, normals, progress);
    const Matrix3 derivative = prolongation.linear(7, coarse_images);
    // --- end of the example
    EXPECT_LT((images.positions - 2.0 * positions).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((derivative - twice).cwiseAbs().maxCoeff(), 1e-6);
}

}  // namespace
}  // namespace pointmorph

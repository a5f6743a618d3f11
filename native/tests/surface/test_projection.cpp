#include "pointmorph/surface/projection.hpp"

#include <gtest/gtest.h>

#include <numeric>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

Positions land(const Positions& images, const Positions& samples, const Normals& normals) {
    const KdTree<3> tree(samples);
    Progress progress;
    return project_onto_surface(images, nearest_rows(tree, images), tree, normals, progress);
}

TEST(Landing, IsTheSameWhereNeighborsAreKnown) {
    const Positions ball = shapes::sphere(2000);
    const Positions images = shapes::cube_noise(500) * 1.2;  // near the ball and far from it
    const KdTree<3> tree(ball);
    Progress progress;
    const auto anchors = nearest_rows(tree, images);
    const Positions searched = project_onto_surface(images, anchors, tree, ball, progress);
    for (const Index count : {15, 24, 8}) {  // of the last there are too few
        const Neighborhoods nearest = nearest_neighbors(tree, count, progress);
        const Positions known =
            project_onto_surface(images, anchors, tree, ball, progress, &nearest);
        EXPECT_LT((known - searched).cwiseAbs().maxCoeff(), 1e-12) << count;
    }
}

TEST(Landing, OnAPlaneIsItsProjection) {
    const Positions flat = shapes::grid(21);
    const Positions inside = shapes::sphere(300) * 0.6;
    const Positions result = land(inside, flat, shapes::upward(441));
    Positions expected = inside;
    expected.col(2).setZero();
    EXPECT_LT((result - expected).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(Landing, StopsAtTheEdgeOfAPatch) {
    const Positions flat = shapes::grid(21);  // −1 to 1
    Positions beyond(4, 3);
    beyond << 1.08, 0.33, 0.02, -1.05, -0.4, 0.0, 0.2, 1.2, -0.03, 1.1, 1.1, 0.0;
    const Positions result = land(beyond, flat, shapes::upward(441));
    Positions expected = beyond.cwiseMax(-1.0).cwiseMin(1.0);
    expected.col(2).setZero();
    EXPECT_LT((result - expected).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(Landing, ErrorOnASphereFallsWithTheSquareOfTheSpacing) {
    const Positions images = shapes::sphere(500, -1.0).rowwise().normalized() * 1.01;
    const auto error = [&](Index count) {
        const Positions ball = shapes::sphere(count);
        return (land(images, ball, ball).rowwise().norm().array() - 1.0).abs().maxCoeff();
    };
    const double coarse = error(1000), fine = error(16000);
    EXPECT_LT(coarse, 0.002);
    EXPECT_LT(fine, coarse / 8);  // 16 for the order 2, less what the uneven samples add
}

TEST(Landing, TheOtherSideOfAThinSheetDoesNotCount) {
    const Index count = 441;
    Positions sheet(2 * count, 3);
    Normals normals(2 * count, 3);
    sheet << shapes::grid(21), shapes::grid(21);
    sheet.bottomRows(count).col(2).setConstant(-0.02);  // a fifth of the spacing
    normals << shapes::upward(count), -shapes::upward(count);
    Positions image(1, 3);
    image << 0.03, 0.02, 0.001;
    const KdTree<3> tree(sheet);
    Progress progress;
    const Index above = 10 * 21 + 10;
    EXPECT_NEAR(
        project_onto_surface(image, std::vector<Index>{above}, tree, normals, progress)(0, 2), 0.0,
        1e-12);
    EXPECT_NEAR(project_onto_surface(image, std::vector<Index>{above + count}, tree, normals,
                                     progress)(0, 2),
                -0.02, 1e-12);
}

TEST(Landing, DegenerateSurfacesGiveFinitePlaces) {
    Positions images = shapes::sphere(20);
    for (const Positions& samples :
         {Positions(Positions::Zero(1, 3)), Positions(Positions::Zero(30, 3)),
          Positions(Values::LinSpaced(40, 0.0, 1.0) * Eigen::RowVector3d(1, 2, 3))}) {
        const Positions result = land(images, samples, shapes::upward(to_index(samples.rows())));
        EXPECT_TRUE(result.allFinite());
        const KdTree<3> tree(samples);
        for (Index i = 0; i < 20; ++i)  // no farther off than the samples reach
            EXPECT_LE(result.row(i).norm(), std::sqrt(14.0) + 1e-9);
    }
}

TEST(Landing, SameBitsForAnyNumberOfThreads) {
    const Positions ball = shapes::sphere(3000), images = shapes::sphere(5000) * 1.02;
    const auto with = [&](int count) {
        const ThreadCount threads(count);
        return land(images, ball, ball);
    };
    EXPECT_EQ(with(1), with(2));
}

TEST(Landing, CanBeCancelled) {
    const Positions ball = shapes::sphere(3000);
    const KdTree<3> tree(ball);
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(project_onto_surface(ball, nearest_rows(tree, ball), tree, ball, progress),
                 Cancelled);
}

TEST(Example, Projection) {
    const Positions target = shapes::sphere(2000), images = 1.05 * shapes::sphere(300);
    const Normals& target_normals = target;
    const std::vector<Index> partners = nearest_rows(KdTree<3>(target), images);
    Progress progress;
    // --- example
    const KdTree<3> target_tree(target);
    const Positions on_target =
        project_onto_surface(images, partners, target_tree, target_normals, progress);
    // --- end of the example
    EXPECT_LT((on_target.rowwise().norm().array() - 1.0).abs().maxCoeff(), 0.01);
}

}  // namespace
}  // namespace pointmorph

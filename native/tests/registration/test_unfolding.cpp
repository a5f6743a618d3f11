#include "registration/unfolding.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>
#include <string_view>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

/// A surface mapped onto itself, whose true images are its own points.
struct MappedSheet {
    Positions points;
    Normals normals;
    KdTree<3> tree;
    double spacing;

    MappedSheet(Positions its_points, Normals its_normals, double its_spacing)
        : points(std::move(its_points)),
          normals(std::move(its_normals)),
          tree(points),
          spacing(its_spacing) {}

    LandedImages truth() const {
        LandedImages images{points, std::vector<Index>(to_size(points.rows()))};
        std::iota(images.anchors.begin(), images.anchors.end(), 0);
        return images;
    }

    /// The truth, but that points within `radius` of `center` cross over to its other side.
    LandedImages folded(const Vector3& center, double radius) const {
        LandedImages images = truth();
        for (Eigen::Index i = 0; i < points.rows(); ++i) {
            const double ratio =
                (points.row(i).transpose() - center).squaredNorm() / (radius * radius);
            if (ratio >= 1.0) continue;
            const double turned = 1.0 - 2.0 * (1.0 - ratio);
            images.positions(i, 0) = center.x() + turned * (points(i, 0) - center.x());
        }
        return images;
    }

    std::vector<Index> unfold(LandedImages& images, std::vector<std::uint8_t> held = {},
                              const Neighborhoods* nearest = nullptr) const {
        held.resize(to_size(points.rows()), 0);
        Progress progress;
        return pointmorph::unfold(images, {tree, normals, nearest}, {tree, normals, nearest}, held,
                                  spacing, progress);
    }
};

MappedSheet plane_sheet() {
    Positions points = shapes::grid(41);  // −1 to 1
    const Positions noise = shapes::cube_noise(to_index(points.rows()));
    points.leftCols<2>() += 0.01 * noise.leftCols<2>();
    return {points, shapes::upward(to_index(points.rows())), 0.05};
}

MappedSheet ball_sheet() {
    const Positions points = shapes::sphere(2000);
    return {points, points, 0.08};
}

double farthest(const Positions& images, const Positions& truth) {
    return (images - truth).rowwise().norm().maxCoeff();
}

TEST(Unfolding, TakesAFoldOnAPlaneBackToTheTruth) {
    const MappedSheet sheet = plane_sheet();
    LandedImages images = sheet.folded({0.1, 0.05, 0.0}, 0.2);
    ASSERT_GT(farthest(images.positions, sheet.points), 1.5 * sheet.spacing);
    const LandedImages before = images;
    const std::vector<Index> moved = sheet.unfold(images);
    EXPECT_LT(farthest(images.positions, sheet.points), 0.5 * sheet.spacing);
    LandedImages again = images;
    EXPECT_TRUE(sheet.unfold(again).empty());  // nothing is folded any more
    EXPECT_TRUE(std::ranges::is_sorted(moved));
    // All else, the border included, keeps its bits.
    for (Index i = 0; i < sheet.tree.size(); ++i) {
        if (std::ranges::binary_search(moved, i)) continue;
        EXPECT_EQ(images.positions.row(i), before.positions.row(i));
        EXPECT_EQ(images.anchors[to_size(i)], before.anchors[to_size(i)]);
    }
    for (const Index i : moved) EXPECT_LT(sheet.points.row(i).cwiseAbs().maxCoeff(), 0.9);
}

TEST(Unfolding, TakesAFoldOnABallBackToTheTruth) {
    const MappedSheet sheet = ball_sheet();
    LandedImages images = sheet.folded({0.0, 0.0, 1.0}, 0.25);
    images.positions.rowwise().normalize();
    ASSERT_GT(farthest(images.positions, sheet.points), 1.5 * sheet.spacing);
    EXPECT_FALSE(sheet.unfold(images).empty());
    EXPECT_LT(farthest(images.positions, sheet.points), 0.6 * sheet.spacing);
    EXPECT_LT((images.positions.rowwise().norm().array() - 1.0).abs().maxCoeff(), 0.005);
}

TEST(Unfolding, LeavesWhatIsRightToTheBit) {
    for (const MappedSheet& sheet : {plane_sheet(), ball_sheet()}) {
        LandedImages images = sheet.truth();
        EXPECT_TRUE(sheet.unfold(images).empty());
        EXPECT_EQ(images.positions, sheet.points);
    }
}

TEST(Unfolding, LeavesAMirrorImage) {
    const MappedSheet sheet = plane_sheet();
    LandedImages images = sheet.truth();
    images.positions.col(0) *= -1.0;
    const Positions before = images.positions;
    EXPECT_TRUE(sheet.unfold(images).empty());
    EXPECT_EQ(images.positions, before);
}

TEST(Unfolding, HeldPointsStay) {
    const MappedSheet sheet = plane_sheet();
    LandedImages images = sheet.folded({0.1, 0.05, 0.0}, 0.2);
    const Positions before = images.positions;
    std::vector<std::uint8_t> held(to_size(sheet.tree.size()), 0);
    for (Index i = 0; i < sheet.tree.size(); i += 7) held[to_size(i)] = 1;
    for (const Index i : sheet.unfold(images, held)) EXPECT_FALSE(held[to_size(i)]);
    for (Index i = 0; i < sheet.tree.size(); i += 7)
        EXPECT_EQ(images.positions.row(i), before.row(i));
}

TEST(Unfolding, IsTheSameForAnyThreadsAndKnownNeighbors) {
    const MappedSheet sheet = ball_sheet();
    Progress progress;
    const Neighborhoods nearest = nearest_neighbors(sheet.tree, 16, progress);
    LandedImages expected = sheet.folded({0.0, 0.0, 1.0}, 0.25);
    const std::vector<Index> moved = sheet.unfold(expected, {}, &nearest);
    ASSERT_FALSE(moved.empty());
    for (const int count : {1, 3})
        for (const Neighborhoods* known : {&nearest, static_cast<const Neighborhoods*>(nullptr)}) {
            const ThreadCount threads(count);
            LandedImages images = sheet.folded({0.0, 0.0, 1.0}, 0.25);
            EXPECT_EQ(sheet.unfold(images, {}, known), moved);
            EXPECT_LT(farthest(images.positions, expected.positions), known ? 1e-300 : 1e-12);
            EXPECT_EQ(images.anchors, expected.anchors);
        }
}

TEST(Unfolding, Stops) {
    const MappedSheet sheet = plane_sheet();
    LandedImages images = sheet.folded({0.1, 0.05, 0.0}, 0.2);
    Progress stopping([](std::string_view, double) { return false; }, std::chrono::milliseconds(0));
    const std::vector<std::uint8_t> held(to_size(sheet.tree.size()), 0);
    EXPECT_THROW(unfold(images, {sheet.tree, sheet.normals}, {sheet.tree, sheet.normals}, held,
                        sheet.spacing, stopping),
                 Cancelled);
}

TEST(Unfolding, FewOrCoincidentPointsStay) {
    for (const Index count : {1, 10, 30}) {
        const MappedSheet sheet(Positions::Zero(count, 3),
                                Normals::Constant(count, 3, std::sqrt(1.0 / 3.0)), 1.0);
        LandedImages images = sheet.truth();
        EXPECT_TRUE(sheet.unfold(images).empty());
        EXPECT_EQ(images.positions, sheet.points);
    }
}

}  // namespace
}  // namespace pointmorph

#include "surface/delaunay_star.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

#include "pointmorph/cloud/neighborhoods.hpp"
#include "shaken_shapes.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

/// A point and six around it, one apart; then further ones, ascending by distance.
Positions hexagon(Index further) {
    Positions p = Positions::Zero(7 + further, 3);
    for (Index k = 0; k < 6; ++k)
        p.row(1 + k) << std::cos(std::numbers::pi / 3 * k), std::sin(std::numbers::pi / 3 * k), 0;
    for (Index k = 0; k < further; ++k) p.row(7 + k) << 2.0 + k, 0.3, 0.0;
    return p;
}

std::vector<Index> others(Index count) {
    std::vector<Index> rows(to_size(count - 1));
    std::iota(rows.begin(), rows.end(), 1);
    return rows;
}

TEST(DelaunayStar, OfAHexagonHasItsCornersInOrderAndItsDiscs) {
    const Positions p = hexagon(5);
    const Normals n = shapes::up(to_index(p.rows()));
    StarBuilder builder(p, n);
    EXPECT_TRUE(builder.build(0, others(to_index(p.rows()))));
    const auto spokes = builder.spokes();
    ASSERT_EQ(spokes.size(), 6u);
    for (std::size_t k = 0; k < 6; ++k) {
        EXPECT_NEAR(spokes[k].radius, 1.0 / std::sqrt(3.0), 1e-9);
        const Index next = spokes[(k + 1) % 6].neighbor;
        EXPECT_EQ(next, spokes[k].neighbor % 6 + 1);  // anticlockwise
    }
    EXPECT_NEAR(builder.spacing(), 1.0, 1e-12);
    EXPECT_NEAR(builder.largest_radius(), 1.0 / std::sqrt(3.0), 1e-9);
}

TEST(DelaunayStar, SurroundedPointsHaveNoLargeDisc) {
    // Never where the star says otherwise; and nearly always where its discs are far smaller.
    Positions p = shapes::torus(6000, 0.4);
    for (Index i = 0; i < 6000; ++i)  // a hole
        if ((p.row(i) - p.row(17)).norm() < 0.2) p.row(i) = p.row(17);
    Normals n = p;  // from the middle of the tube
    for (Index i = 0; i < 6000; ++i) {
        Eigen::RowVector3d middle = p.row(i);
        middle.z() = 0.0;
        n.row(i) = (p.row(i) - middle.normalized()).normalized();
    }
    Progress progress;
    const KdTree<3> tree(p);
    const Neighborhoods nearest = nearest_neighbors(tree, 16, progress);
    StarBuilder builder(p, n);
    Index shown = 0, small = 0;
    for (const double factor : {0.9, 1.5, 2.0})
        for (Index i = 0; i < 6000; ++i) {
            const bool is_surrounded = builder.is_surrounded(i, nearest[i], factor);
            builder.build(i, nearest[i]);
            const double radius = builder.largest_radius() / std::max(builder.spacing(), 1e-9);
            EXPECT_FALSE(is_surrounded && radius > factor) << i;
            if (factor < 2.0 || radius > 1.2) continue;
            ++small;
            shown += is_surrounded;
        }
    EXPECT_GT(small, 4000);
    EXPECT_GT(shown, 0.95 * small);
}

TEST(DelaunayStar, IsOpenOnTheHull) {
    Positions p = hexagon(0);
    p.row(1) = p.row(4);  // a gap where it was: the middle is inside still
    const Normals n = shapes::up(7);
    StarBuilder builder(p, n);
    const std::vector<Index> half{2, 3, 5, 6};
    builder.build(0, half);
    EXPECT_EQ(builder.spokes().size(), 4u);
    const std::vector<Index> above{2, 3};
    EXPECT_FALSE(builder.build(0, above));  // others could still change it
    EXPECT_TRUE(
        std::ranges::any_of(builder.spokes(), [](const Spoke& s) { return std::isinf(s.radius); }));
    EXPECT_TRUE(std::isinf(builder.largest_radius()));
    const std::vector<Index> none;
    EXPECT_TRUE(builder.build(0, none));
    EXPECT_EQ(builder.spacing(), 0.0);
}

TEST(DelaunayStar, TheOtherSideOfAThinPartDoesntCount) {
    Positions p = hexagon(6);
    for (Index k = 0; k < 6; ++k) p.row(7 + k) = 0.5 * p.row(1 + k);
    Normals n = shapes::up(13);
    n.bottomRows(6) *= -1.0;
    StarBuilder builder(p, n);
    std::vector<Index> rows = others(13);
    std::ranges::rotate(rows, rows.begin() + 6);  // the nearer ones first
    builder.build(0, rows);
    for (const Spoke& spoke : builder.spokes()) EXPECT_LE(spoke.neighbor, 6);
    EXPECT_NEAR(builder.spacing(), 1.0, 1e-12);
}

TEST(DelaunayStar, FartherPointsAreAddedAsTheyAreFound) {
    const Positions p = shapes::grid(9);
    const Normals n = shapes::up(81);
    std::vector<Index> rows = others(81);
    const Index middle = 40;
    rows.push_back(0);
    std::erase(rows, middle);
    std::ranges::stable_sort(rows, {},
                             [&](Index i) { return (p.row(i) - p.row(middle)).squaredNorm(); });
    StarBuilder at_once(p, n), in_parts(p, n);
    at_once.build(middle, rows);
    const std::span<const Index> all(rows);
    if (!in_parts.build(middle, all.first(4))) in_parts.extend(all.subspan(4));
    const auto a = at_once.spokes(), b = in_parts.spokes();
    ASSERT_EQ(a.size(), b.size());
    ASSERT_EQ(a.size(), 4u);
    EXPECT_NEAR(at_once.largest_radius(), in_parts.largest_radius(), 1e-12);
    EXPECT_NEAR(at_once.largest_radius(), std::sqrt(0.5) * 0.25, 1e-9);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/cloud/subset.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <numbers>
#include <string_view>

#include "joined_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

TEST(Subset, AreaOfASphere) {
    const Positions p = shapes::sphere(4000);
    EXPECT_NEAR(estimated_area(KdTree<3>(p)), 4.0 * std::numbers::pi, 0.1 * 4.0 * std::numbers::pi);
}

TEST(Subset, AreaOfCoincidentPointsIsPositive) {
    Positions p = Positions::Zero(200, 3);
    p.row(0) << 1, 0, 0;
    EXPECT_GT(estimated_area(KdTree<3>(p)), 0.0);
}

/// All rows but the first `required` lie apart, and all points near one of them.
void expect_spread(const Positions& p, const Subset& subset, std::size_t required) {
    const Positions drawn = gather(p, subset.rows);
    const KdTree<3> tree(drawn);
    std::vector<Index> near(2);
    std::vector<double> squared(2);
    for (std::size_t a = required; a < subset.rows.size(); ++a) {
        const auto row = static_cast<Eigen::Index>(a);
        tree.nearest(drawn.row(row).data(), near, squared);
        EXPECT_GE(std::sqrt(squared[1]), subset.radius);
    }
    for (Index i = 0; i < p.rows(); ++i) {
        tree.nearest(p.row(i).data(), near, squared);
        EXPECT_LE(std::sqrt(squared[0]), subset.radius);
    }
}

TEST(Subset, KeepsItsDistanceAndCoversTheCloud) {
    const Positions p = shapes::sphere(5000);
    Progress progress;
    const std::vector<Index> required{7, 8, 4000};
    const Subset subset = poisson_disk_subset(KdTree<3>(p), p, required, 400, progress);
    EXPECT_NEAR(static_cast<double>(subset.rows.size()), 400.0, 40.0);
    EXPECT_TRUE(std::equal(required.begin(), required.end(), subset.rows.begin()));
    expect_spread(p, subset, required.size());
}

TEST(Subset, IsTheSameWhereNeighborsAreKnown) {
    for (const Positions& p : {shapes::sphere(5000), shapes::cube_noise(3000)}) {
        Progress progress;
        const KdTree<3> tree(p);
        const Normals n = p.rowwise().normalized();
        const Neighborhoods nearest = nearest_neighbors(tree, 16, progress);
        EXPECT_DOUBLE_EQ(estimated_area(p, nearest), estimated_area(tree));
        for (const Index count : {100, 1000, 2500, 9000})
            EXPECT_EQ(poisson_disk_subset(tree, n, {}, count, progress, &nearest).rows,
                      poisson_disk_subset(tree, n, {}, count, progress).rows);
    }
}

TEST(Subset, OfAnEvenGridTakesACountAboutAsCloseAsAny) {
    const Positions p = shapes::grid(80);
    const KdTree<3> tree(p);
    Progress progress;
    std::map<Index, double> drawn;  // wanted, got
    for (Index count = 500; count <= 6000; count += 250) {
        const Subset subset =
            poisson_disk_subset(tree, shapes::upward(p.rows()), {}, count, progress);
        drawn[count] = static_cast<double>(subset.rows.size());
        expect_spread(p, subset, 0);
    }
    for (const auto& [count, got] : drawn)
        for (const auto& [other, possible] : drawn)
            EXPECT_LE(std::abs(std::log(got / count)), std::abs(std::log(possible / count)) + 0.2)
                << count << ": " << got << " instead of " << possible;
}

/// What is told is what a search would find, and it is told of most points.
void expect_nearest(const Positions& p, const Normals& n, std::span<const Index> required,
                    double least) {
    Progress progress;
    const KdTree<3> tree(p);
    const SubsetCells cells = poisson_disk_cells(tree, n, required, 300, progress);
    const Subset subset = poisson_disk_subset(tree, n, required, 300, progress);
    EXPECT_EQ(cells.subset.rows, subset.rows);
    EXPECT_EQ(cells.subset.radius, subset.radius);
    const Positions drawn = gather(p, subset.rows);
    const Normals normals = gather(n, subset.rows);
    const KdTree<3> drawn_tree(drawn);
    ASSERT_EQ(cells.nearest.size(), to_size(Index(p.rows())));
    Index told = 0;
    for (Index i = 0; i < p.rows(); ++i) {
        if (cells.nearest[to_size(i)] < 0) continue;
        ++told;
        EXPECT_EQ(cells.nearest[to_size(i)],
                  nearest_on_sheet(drawn_tree, normals, p.row(i), n.row(i), 4));
    }
    EXPECT_GE(told, least * static_cast<double>(p.rows()));
}

TEST(Subset, TellsWhichOfItsPointsIsNearest) {
    const Positions sphere = shapes::sphere(5000), noise = shapes::cube_noise(3000);
    expect_nearest(sphere, sphere, std::vector<Index>{7, 8, 4000}, 0.99);
    expect_nearest(noise, noise.rowwise().normalized(), {}, 0.3);
    const shapes::TwoSheets sheets(40);
    expect_nearest(sheets.positions, sheets.normals, {}, 0.0);
    Positions twice(2000, 3);
    twice << sphere.topRows(1000), sphere.topRows(1000);
    expect_nearest(twice, twice, std::vector<Index>{5, 1005}, 0.5);
}

TEST(Subset, BothSidesOfAThinSheetGetTheirOwn) {
    const shapes::TwoSheets sheets(40);
    const Positions &top = sheets.top, &p = sheets.positions;
    const Normals& n = sheets.normals;
    Progress progress;
    const Subset subset = poisson_disk_subset(KdTree<3>(p), n, {}, 200, progress);
    const auto above = std::ranges::count_if(subset.rows, [&](Index i) { return i < top.rows(); });
    EXPECT_NEAR(static_cast<double>(above) / static_cast<double>(subset.rows.size()), 0.5, 0.05);
}

TEST(Subset, ASmallCloudIsItsOwnSubsetWithoutDuplicates) {
    Positions p(60, 3);
    p << shapes::cube_noise(30), shapes::cube_noise(30);
    const Normals n = Normals::Constant(60, 3, 1.0 / std::sqrt(3.0));
    Progress progress;
    const Subset subset = poisson_disk_subset(KdTree<3>(p), n, {}, 100, progress);
    EXPECT_EQ(subset.rows.size(), 30u);
    std::vector<char> seen(30, 0);
    for (const Index i : subset.rows) seen[to_size(i % 30)] += 1;
    EXPECT_EQ(std::ranges::count(seen, 1), 30);
}

TEST(Subset, CoincidentRequiredRowsAllStay) {
    const Positions p = Positions::Zero(50, 3);
    const Normals n = Normals::Constant(50, 3, 1.0 / std::sqrt(3.0));
    Progress progress;
    const std::vector<Index> required{3, 5};
    EXPECT_EQ(poisson_disk_subset(KdTree<3>(p), n, required, 10, progress).rows, required);
}

TEST(Subset, OfManyRequiredRowsCanBeCancelled) {
    const Positions p = shapes::sphere(2000);
    std::vector<Index> all(2000);
    std::ranges::generate(all, [next = Index{0}]() mutable { return next++; });
    for (const int most : {1, 5, 50}) {
        int asked = 0;
        Progress progress([&](std::string_view, double) { return ++asked < most; },
                          std::chrono::milliseconds(0));
        EXPECT_THROW(poisson_disk_subset(KdTree<3>(p), p, all, 100, progress), Cancelled);
        EXPECT_EQ(asked, most);
    }
}

TEST(Example, Subset) {
    const Positions positions = shapes::sphere(4000);
    const Normals& normals = positions;
    const std::vector<Index> features{17, 3};
    Progress progress;
    // --- example
    const KdTree<3> tree(positions);
    const Subset subset = poisson_disk_subset(tree, normals, features, 300, progress);
    const Positions coarse = gather(positions, subset.rows);
    // --- end of the example
    EXPECT_NEAR(static_cast<double>(coarse.rows()), 300.0, 30.0);
    EXPECT_EQ(coarse.row(0), positions.row(17));
    EXPECT_EQ(coarse.row(1), positions.row(3));
}

}  // namespace
}  // namespace pointmorph

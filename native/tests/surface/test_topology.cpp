#include "pointmorph/surface/topology.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <numeric>
#include <random>
#include <string_view>
#include <vector>

#include "joined_shapes.hpp"
#include "pointmorph/cloud/covariance.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

Topology topology_of(const Positions& positions, std::vector<Index> parts = {},
                     Progress&& last = Progress()) {
    Progress progress;
    const KdTree<3> tree(positions);
    const auto nearest = nearest_neighbors(tree, 16, progress);
    Normals normals = covariance_analysis(positions, nearest, progress).normals;
    orient_normals(positions, nearest, normals, progress);
    const auto loops = find_boundary_loops(positions, normals, nearest, {}, progress);
    return find_topology({positions, normals, nearest}, loops, {parts}, {}, last);
}

using shapes::together;

Positions shaken(Positions positions, double by) {
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal(0.0, by);
    for (Eigen::Index i = 0; i < positions.size(); ++i) positions.data()[i] += normal(random);
    return positions;
}

TEST(Topology, CountsHandlesOfAnalyticShapes) {
    EXPECT_EQ(in_words(topology_of(shapes::sphere(4000))), "a closed surface");
    EXPECT_EQ(in_words(topology_of(shapes::torus(6000, 0.4))),
              "a closed surface with 1 hole through it");
    EXPECT_EQ(in_words(topology_of(shapes::double_torus(6000))),
              "a closed surface with 2 holes through it");
    EXPECT_EQ(in_words(topology_of(shapes::grid(60))), "an open surface");
    EXPECT_EQ(in_words(topology_of(shapes::sphere(3000, 0.2))), "an open surface");
}

TEST(Topology, StaysTheSameWithNoise) {
    SKIP_WHERE_WATCHED();
    for (const double share : {0.1, 0.25}) {  // of the spacing
        const double spacing = std::sqrt(4 * std::numbers::pi / 4000);
        EXPECT_EQ(in_words(topology_of(shaken(shapes::sphere(4000), share * spacing))),
                  "a closed surface");
        const double torus = 4 * std::numbers::pi * std::numbers::pi * 0.4;
        EXPECT_EQ(in_words(topology_of(
                      shaken(shapes::torus(6000, 0.4), share * std::sqrt(torus / 6000)))),
                  "a closed surface with 1 hole through it");
    }
}

TEST(Topology, CountsHolesAndTellsThemFromRims) {
    const auto without = [](const Positions& all, auto&& is_cut) {
        std::vector<Eigen::Index> kept;
        for (Eigen::Index i = 0; i < all.rows(); ++i)
            if (!is_cut(all.row(i))) kept.push_back(i);
        return Positions(all(kept, Eigen::all));
    };
    EXPECT_EQ(in_words(topology_of(without(shapes::sphere(6000),
                                           [](const auto& p) { return std::abs(p.x()) > 0.97; }))),
              "a surface with 2 openings");
    EXPECT_EQ(in_words(topology_of(without(shapes::sphere(6000),
                                           [](const auto& p) { return std::abs(p.z()) > 0.5; }))),
              "an open surface with 2 openings");
    Positions torus(90 * 40, 3);  // even, for its holes to be seen
    for (Index i = 0; i < torus.rows(); ++i) {
        const double a = 2 * std::numbers::pi * (i / 40) / 90.0;
        const double b = 2 * std::numbers::pi * (i % 40 + 0.5 * (i / 40 % 2)) / 40.0;
        torus.row(i) << (1 + 0.4 * std::cos(b)) * std::cos(a),
            (1 + 0.4 * std::cos(b)) * std::sin(a), 0.4 * std::sin(b);
    }
    EXPECT_EQ(in_words(topology_of(without(torus, [](const auto& p) { return p.x() > 1.33; }))),
              "a surface with 1 opening and 1 hole through it");
}

TEST(Topology, TellsPiecesApartAndSpecksFromThem) {
    const Index count = is_watched() ? 1500 : 4000;
    const Positions ball = shapes::sphere(count);
    const Positions eye = (shapes::sphere(400) * 0.1).rowwise() + Eigen::RowVector3d(1.3, 0, 0);
    const Positions other = eye.rowwise() + Eigen::RowVector3d(0, 0.4, 0);
    const Positions speck = (shapes::sphere(5) * 0.01).rowwise() + Eigen::RowVector3d(0, 0, 3);
    const Positions all = together({eye, ball, speck, other});
    const Topology topology = topology_of(all);
    EXPECT_EQ(in_words(topology), "3 closed surfaces and 1 speck");
    EXPECT_EQ(topology.components[0].points, count);
    EXPECT_EQ(topology.labels.front(), topology.labels[399]);
    EXPECT_EQ(topology.labels[400], 0);
    EXPECT_EQ(topology.strays, 1);
}

TEST(Topology, SaysHowManyPiecesItHasLookedAt) {
    Positions two = together({shapes::sphere(3000), shapes::sphere(2000)});
    two.bottomRows(2000).col(0).array() += 4.0;
    std::vector<double> said;
    topology_of(two, {},
                Progress(
                    [&](std::string_view, double fraction) {
                        said.push_back(fraction);
                        return true;
                    },
                    std::chrono::milliseconds(0)));
    ASSERT_FALSE(said.empty());
    EXPECT_NE(std::ranges::find(said, 0.5), said.end());
    EXPECT_EQ(said.back(), 1.0);
}

TEST(Topology, TakesScatteredPointsForStrays) {
    const Positions ball = shapes::sphere(4000), dust = shapes::cube_noise(60) * 1.8;
    const Topology topology = topology_of(together({dust, ball}));
    ASSERT_EQ(topology.main().size(), 1u) << in_words(topology);
    EXPECT_EQ(topology.components[0].genus, std::optional<Index>(0));
    EXPECT_GE(topology.strays, 1);
    EXPECT_EQ(std::count(topology.labels.begin() + 60, topology.labels.end(), 0), 4000);
}

TEST(Topology, TakesTheWordOfFaces) {
    // Two balls that touch: one piece to the eye, two by their faces.
    const Positions ball = shapes::sphere(2000);
    const Positions all = together({ball, ball.rowwise() + Eigen::RowVector3d(2.0, 0, 0)});
    std::vector<Index> parts(4000, 7);
    std::fill_n(parts.begin(), 2000, 3);
    const Topology topology = topology_of(all, parts);
    EXPECT_EQ(in_words(topology), "2 closed surfaces");
    EXPECT_NE(topology.labels.front(), topology.labels.back());
}

TEST(Topology, CountsCoincidentPointsOnce) {
    const Positions once = shapes::torus(5000, 0.4);
    const Positions thrice = together({once, once, once});
    Progress progress;
    const auto nearest = nearest_neighbors(KdTree<3>(once), 16, progress);
    Normals normals = covariance_analysis(once, nearest, progress).normals;
    orient_normals(once, nearest, normals, progress);
    const auto all_nearest = nearest_neighbors(KdTree<3>(thrice), 64, progress);
    const Normals all_normals = together({normals, normals, normals});
    const Topology topology =
        find_topology({thrice, all_normals, all_nearest}, {}, {}, {}, progress);
    EXPECT_EQ(in_words(topology), "a closed surface with 1 hole through it");
    EXPECT_EQ(topology.components[0].points, 15000);
}

TEST(Topology, SaysUnknownWherePointsAreTooFew) {
    const Topology few = topology_of(shapes::sphere(60));
    ASSERT_EQ(few.main().size(), 1u);
    EXPECT_FALSE(few.components[0].genus);
    EXPECT_EQ(in_words(few), "a closed surface, perhaps with holes through it");
}

TEST(Topology, SpeaksOfTwoShapesAtOnce) {
    const auto of = [](std::optional<Index> genus, Index borders = 0, bool open = false) {
        return Topology{{}, {{100, borders, open, genus}}, 0};
    };
    EXPECT_EQ(in_words(of(0), of(0)), "closed surfaces");
    EXPECT_EQ(in_words(of(1), of(0)),
              "a closed surface with 1 hole through it, to a closed surface");
    EXPECT_EQ(in_words(of({}), of({})), "closed surfaces, perhaps with holes through them");
    EXPECT_EQ(in_words(of(2, 1), of(2, 1)), "surfaces with 1 opening and 2 holes through each");
    EXPECT_EQ(in_words(of(0, 1, true), of(0, 1, true)), "open surfaces");
    EXPECT_EQ(in_words(of(0, 3, true), of(0)),
              "an open surface with 3 openings, to a closed surface");
    const Topology eyes{{}, {{100, 0, false, 0}, {9, 0, false, 0}, {9, 0, false, 0}}, 0};
    EXPECT_EQ(in_words(eyes, eyes), "on both sides 3 closed surfaces");
}

TEST(Example, Topology) {
    const Positions positions = shapes::torus(6000, 0.4);
    Progress progress;
    const Neighborhoods nearest = nearest_neighbors(KdTree<3>(positions), 16, progress);
    Normals normals = covariance_analysis(positions, nearest, progress).normals;
    orient_normals(positions, nearest, normals, progress);
    // --- example
    const auto loops = find_boundary_loops(positions, normals, nearest, {}, progress);
    const Topology topology = find_topology({positions, normals, nearest}, loops, {}, {}, progress);
    const bool has_a_handle = topology.main().front().genus == 1;
    const std::string words = in_words(topology);
    // --- end of the example
    EXPECT_TRUE(has_a_handle);
    EXPECT_EQ(words, "a closed surface with 1 hole through it");
}

}  // namespace
}  // namespace pointmorph

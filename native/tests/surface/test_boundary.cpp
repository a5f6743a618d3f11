#include "pointmorph/surface/boundary.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <set>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/covariance.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "real_meshes.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

Neighborhoods nearest_of(const Positions& p, Index k = 16) {
    Progress progress;
    return nearest_neighbors(KdTree<3>(p), k, progress);
}

std::vector<BoundaryLoop> loops_of(const Positions& p, const Normals& normals,
                                   const BoundaryOptions& options = {}) {
    Progress progress;
    return find_boundary_loops(p, normals, nearest_of(p), options, progress);
}

/// A uniform sample of the square [−1, 1]².
Positions square(Index count, unsigned seed = 3) {
    Positions p = shapes::cube_noise(count, seed);
    p.col(2).setZero();
    return p;
}

/// Even points of the disc with radius 1 around the origin.
Positions disc(Index count) {
    Positions p(count, 3);
    for (Index i = 0; i < count; ++i) {
        const double r = std::sqrt((i + 0.5) / count),
                     a = std::numbers::pi * (3.0 - std::sqrt(5.0)) * i;
        p.row(i) << r * std::cos(a), r * std::sin(a), 0.0;
    }
    return p;
}

template <class Keep>
Positions kept(const Positions& p, Keep&& keep) {
    std::vector<Index> rows;
    for (Index i = 0; i < p.rows(); ++i)
        if (keep(Vector3(p.row(i)))) rows.push_back(i);
    return gather(p, rows);
}

/// Signed area that the loop spans in the plane z = 0.
double area(const Positions& p, const BoundaryLoop& loop) {
    double sum = 0.0;
    for (std::size_t k = 0; k < loop.size(); ++k) {
        const Index i = loop[k], j = loop[(k + 1) % loop.size()];
        sum += p(i, 0) * p(j, 1) - p(j, 0) * p(i, 1);
    }
    return 0.5 * sum;
}

void expect_simple(const BoundaryLoop& loop) {
    EXPECT_EQ(std::set<Index>(loop.begin(), loop.end()).size(), loop.size());
    EXPECT_EQ(loop.front(), *std::ranges::min_element(loop));
}

TEST(Boundary, BorderOfAGridInOrder) {
    const Positions p = shapes::grid(30);
    const auto loops = loops_of(p, shapes::upward(900));
    ASSERT_EQ(loops.size(), 1u);
    EXPECT_EQ(loops[0], shapes::grid_border(30));
}

TEST(Boundary, RunsTheOtherWayWithTheNormalsTurned) {
    const Positions p = shapes::grid(30);
    const auto loops = loops_of(p, -shapes::upward(900));
    ASSERT_EQ(loops.size(), 1u);
    BoundaryLoop border = shapes::grid_border(30);
    std::reverse(border.begin() + 1, border.end());
    EXPECT_EQ(loops[0], border);
}

TEST(Boundary, RimOfAHemisphere) {
    constexpr Index kCount = 5000;
    const Positions p = shapes::sphere(kCount, 0.0);
    const double spacing = std::sqrt(2.0 * std::numbers::pi / kCount);
    const auto loops = loops_of(p, p);
    ASSERT_EQ(loops.size(), 1u);
    expect_simple(loops[0]);
    // Once round, anticlockwise, on the rim.
    double turned = 0.0;
    for (std::size_t k = 0; k < loops[0].size(); ++k) {
        const Index i = loops[0][k], j = loops[0][(k + 1) % loops[0].size()];
        EXPECT_LT(p(i, 2), 1.5 * spacing);
        turned += std::atan2(p(i, 0) * p(j, 1) - p(i, 1) * p(j, 0),
                             p(i, 0) * p(j, 0) + p(i, 1) * p(j, 1));
    }
    EXPECT_NEAR(turned, 2.0 * std::numbers::pi, 1e-9);
    EXPECT_NEAR(loop_length(p, loops[0]), 2.0 * std::numbers::pi, 0.15 * std::numbers::pi);
}

TEST(Boundary, RandomSamples) {
    constexpr Index kCount = 20000;
    const double spacing = 2.0 / std::sqrt(kCount);
    const Positions p = square(kCount);
    const auto loops = loops_of(p, shapes::upward(kCount));
    ASSERT_EQ(loops.size(), 1u);
    expect_simple(loops[0]);
    for (const Index i : loops[0])
        EXPECT_GT(p.row(i).cwiseAbs().maxCoeff(), 1.0 - 5.0 * spacing) << p.row(i);
    EXPECT_NEAR(area(p, loops[0]), 4.0, 8.0 * spacing);
    EXPECT_NEAR(loop_length(p, loops[0]), 8.0, 0.8);
}

TEST(Boundary, NoiseAlongTheNormalAndInThePlane) {
    constexpr Index kCount = 8000;
    Positions p = disc(kCount);
    const double spacing = std::sqrt(std::numbers::pi / kCount);
    p += 0.3 * spacing * shapes::cube_noise(kCount, 5);
    const auto loops = loops_of(p, shapes::upward(kCount));
    ASSERT_EQ(loops.size(), 1u);
    for (const Index i : loops[0]) EXPECT_GT(p.row(i).head<2>().norm(), 1.0 - 3.0 * spacing);
    EXPECT_NEAR(area(p, loops[0]), std::numbers::pi, 4.0 * spacing);
    EXPECT_NEAR(loop_length(p, loops[0]), 2.0 * std::numbers::pi, 0.2 * std::numbers::pi);
}

TEST(Boundary, HolesRunClockwise) {
    const Positions p = kept(
        disc(6000), [](const Vector3& x) { return (x - Vector3(0.3, 0.0, 0.0)).norm() > 0.4; });
    const auto loops = loops_of(p, shapes::upward(to_index(p.rows())));
    ASSERT_EQ(loops.size(), 2u);
    EXPECT_NEAR(area(p, loops[0]), std::numbers::pi, 0.1);
    EXPECT_NEAR(area(p, loops[1]), -0.16 * std::numbers::pi, 0.03);
    EXPECT_NEAR(loop_length(p, loops[0]), 2.0 * std::numbers::pi, 0.15 * std::numbers::pi);
    EXPECT_NEAR(loop_length(p, loops[1]), 0.8 * std::numbers::pi, 0.08 * std::numbers::pi);
}

TEST(Boundary, SmallGapsInTheSamplingAreNoHoles) {
    constexpr Index kCount = 6000;
    const double spacing = std::sqrt(std::numbers::pi / kCount);
    const auto holes_with_radius = [&](double radius) {
        const Positions p = kept(disc(kCount), [&](const Vector3& x) {
            return (x - Vector3(0.3, 0.1, 0.0)).norm() > radius * spacing;
        });
        return loops_of(p, shapes::upward(to_index(p.rows()))).size() - 1;
    };
    EXPECT_EQ(holes_with_radius(1.2), 0u);
    EXPECT_EQ(holes_with_radius(4.0), 1u);
}

TEST(Boundary, OptionsSayHowLargeAHoleIs) {
    constexpr Index kCount = 6000;
    const double spacing = std::sqrt(std::numbers::pi / kCount);
    const Positions p = kept(
        disc(kCount), [&](const Vector3& x) { return x.norm() > 5.0 * spacing || x.norm() == 0; });
    const Normals up = shapes::upward(to_index(p.rows()));
    EXPECT_EQ(loops_of(p, up).size(), 2u);
    EXPECT_EQ(loops_of(p, up, {.opening = 8.0}).size(), 1u);
    EXPECT_EQ(loops_of(p, up, {.min_loop = 60.0}).size(), 1u);
}

TEST(Boundary, NoneOnClosedSurfaces) {
    EXPECT_TRUE(loops_of(shapes::sphere(4000), shapes::sphere(4000)).empty());
    // Uniform random points of the sphere.
    const Positions ball = kept(shapes::cube_noise(20000),
                                [](const Vector3& x) { return x.norm() < 1.0 && x.norm() > 0.1; });
    const Positions random = ball.rowwise().normalized();
    EXPECT_TRUE(loops_of(random, random).empty());

    const Positions torus = shapes::torus(10000, 0.4);
    Normals normals(torus.rows(), 3);
    for (Index i = 0; i < torus.rows(); ++i) {
        const Vector3 x = torus.row(i);
        const Vector3 ring = Vector3(x[0], x[1], 0.0).normalized();
        normals.row(i) = (x - ring).normalized();
    }
    EXPECT_TRUE(loops_of(torus, normals).empty());
}

TEST(Boundary, NoneOnAThinClosedSheet) {
    // An ellipsoid much thinner than the samples are apart, near the rim and in the middle.
    constexpr Index kCount = 6000;
    const double spacing = std::sqrt(2.0 * std::numbers::pi / kCount);
    Positions p = shapes::sphere(kCount);
    Normals normals = p;
    p.col(2) *= 0.5 * spacing;
    normals.col(2) /= 0.5 * spacing;
    normals.rowwise().normalize();
    EXPECT_TRUE(loops_of(p, normals).empty());
}

TEST(Boundary, TheOtherSideOfAThinSheetDoesNotHideAHole) {
    // Two discs half a spacing apart, facing away from one another. The upper one has a hole.
    constexpr Index kCount = 3000;
    const double spacing = std::sqrt(std::numbers::pi / kCount);
    Positions upper = kept(disc(kCount), [](const Vector3& x) { return x.norm() > 0.3; });
    const Positions lower = disc(kCount);
    upper.col(2).setConstant(0.5 * spacing);
    Positions p(upper.rows() + lower.rows(), 3);
    p << upper, lower;
    Normals normals(p.rows(), 3);
    normals << shapes::upward(to_index(upper.rows())), -shapes::upward(kCount);
    const auto loops = loops_of(p, normals);
    ASSERT_EQ(loops.size(), 1u);  // both rims together close the sheet
    for (const Index i : loops[0]) {
        EXPECT_LT(i, upper.rows());
        EXPECT_NEAR(p.row(i).head<2>().norm(), 0.3, 1.5 * spacing);
    }
    EXPECT_NEAR(loop_length(p, loops[0]), 0.6 * std::numbers::pi, 0.1 * std::numbers::pi);
}

TEST(Boundary, SpacingThatJumps) {
    // Points four times as close on the left as on the right.
    std::vector<Vector3> points;
    for (Index u = 0; u <= 40; ++u)
        for (Index v = 0; v <= 40; ++v) points.emplace_back(u / 40.0 - 1.0, v / 40.0, 0.0);
    for (Index u = 1; u <= 10; ++u)
        for (Index v = 0; v <= 10; ++v) points.emplace_back(u / 10.0, v / 10.0, 0.0);
    Positions p(points.size(), 3);
    for (Index i = 0; i < p.rows(); ++i) p.row(i) = points[to_size(i)];
    std::set<Index> border;
    for (Index i = 0; i < p.rows(); ++i)
        if (std::abs(p(i, 0)) == 1.0 || p(i, 1) == 0.0 || p(i, 1) == 1.0) border.insert(i);
    const auto loops = loops_of(p, shapes::upward(to_index(p.rows())));
    ASSERT_EQ(loops.size(), 1u);
    EXPECT_EQ(std::set<Index>(loops[0].begin(), loops[0].end()), border);
    EXPECT_NEAR(loop_length(p, loops[0]), 6.0, 1e-12);
}

TEST(Boundary, SamplesInRows) {
    // Four times as far from row to row as within.
    Positions p = shapes::grid(40);
    p.col(0) *= 4.0;
    const auto loops = loops_of(p, shapes::upward(1600));
    ASSERT_EQ(loops.size(), 1u);
    EXPECT_EQ(loops[0], shapes::grid_border(40));
}

/// Random points of the sphere below a height.
Positions ball_below(double highest) {
    const Positions p = kept(shapes::cube_noise(60000),
                             [](const Vector3& x) { return x.norm() < 1.0 && x.norm() > 0.1; })
                            .rowwise()
                            .normalized();
    return kept(p, [&](const Vector3& x) { return x[2] < highest; });
}

TEST(Boundary, FlatGapsOfUnevenCloudsAreSurface) {
    // Where points are missing on a cap, that can be a flat place with few vertices; where they end
    // at the equator, it can't. One side has a fourth of the points of the other.
    const auto loops_below = [](double highest) {
        int count = 0;
        const Positions p = kept(ball_below(highest),
                                 [&](const Vector3& x) { return x[0] < 0.0 || ++count % 4 == 0; });
        return loops_of(p, p);
    };
    EXPECT_TRUE(loops_below(0.95).empty());
    const auto loops = loops_below(0.0);
    ASSERT_EQ(loops.size(), 1u);
    EXPECT_GT(loops[0].size(), 100u);
    // Evenly spaced, the gap is a hole.
    const Positions even =
        kept(shapes::sphere(20000), [](const Vector3& x) { return x[2] < 0.95; });
    ASSERT_EQ(loops_of(even, even).size(), 1u);
}

TEST(Boundary, FlatGapsOfRandomSamplesAreHoles) {
    for (const double highest : {0.95, 0.8}) {
        const Positions p = ball_below(highest);
        const auto loops = loops_of(p, p);
        ASSERT_EQ(loops.size(), 1u) << highest;
        const double spacing = std::sqrt(4.0 * std::numbers::pi / static_cast<double>(p.rows()));
        for (const Index i : loops[0]) EXPECT_GT(p(i, 2), highest - 5.0 * spacing);
        const double rim = 2.0 * std::numbers::pi * std::sqrt(1.0 - highest * highest);
        EXPECT_NEAR(loop_length(p, loops[0]), rim, 0.25 * rim);
    }
    // What independent samples leave open by chance is no hole.
    for (unsigned seed = 0; seed < 8; ++seed) {
        const Positions p = kept(shapes::cube_noise(8000, seed),
                                 [](const Vector3& x) { return x.norm() < 1.0 && x.norm() > 0.1; })
                                .rowwise()
                                .normalized();
        EXPECT_TRUE(loops_of(p, p).empty()) << seed;
    }
}

TEST(Boundary, HolesOfAFewSpacingsInRandomSamples) {
    // An empty cap that would hold 45 points is no chance, however ragged its rim is.
    int found = 0;
    constexpr unsigned kSeeds = 16;
    for (unsigned seed = 0; seed < kSeeds; ++seed) {
        const Positions ball =
            kept(shapes::cube_noise(8000, 100 + seed),
                 [](const Vector3& x) { return x.norm() < 1.0 && x.norm() > 0.1; })
                .rowwise()
                .normalized();
        const double lowest = 1.0 - 2.0 * 45.0 / static_cast<double>(ball.rows());
        const Positions p = kept(ball, [&](const Vector3& x) { return x[2] < lowest; });
        const auto loops = loops_of(p, p);
        EXPECT_LE(loops.size(), 1u) << seed;
        for (const BoundaryLoop& loop : loops)
            for (const Index i : loop) EXPECT_GT(p(i, 2), lowest - 0.1) << seed;
        found += loops.empty() ? 0 : 1;
    }
    EXPECT_GE(found, 15);
}

TEST(Boundary, DoesNotDependOnMotionScaleOrOrder) {
    const Positions p = square(4000);
    const Normals up = shapes::upward(4000);
    const auto expected = loops_of(p, up);
    ASSERT_EQ(expected.size(), 1u);

    for (const double scale : {1e-7, 1.0, 1e9}) {
        const Matrix3 rotation = shapes::rotation(7);
        const Positions moved =
            ((scale * p) * rotation.transpose()).rowwise() + scale * Eigen::RowVector3d(3, -2, 5);
        EXPECT_EQ(loops_of(moved, up * rotation.transpose()), expected) << scale;
    }

    const auto order = shapes::permutation(4000, 9);
    const auto loops = loops_of(gather(p, order), up);
    ASSERT_EQ(loops.size(), 1u);
    BoundaryLoop back;
    for (const Index i : loops[0]) back.push_back(order[to_size(i)]);
    std::ranges::rotate(back, std::ranges::min_element(back));
    EXPECT_EQ(back, expected[0]);
}

TEST(Boundary, SameForAnyNumberOfThreads) {
    const Positions p = square(8000);
    const Neighborhoods nearest = nearest_of(p);
    std::vector<std::vector<BoundaryLoop>> results;
    for (const int threads : {1, 2, 5}) {
        const ThreadCount limit(threads);
        Progress progress;
        results.push_back(find_boundary_loops(p, shapes::upward(8000), nearest, {}, progress));
    }
    EXPECT_EQ(results[0], results[1]);
    EXPECT_EQ(results[0], results[2]);
}

TEST(Boundary, DegenerateClouds) {
    for (const Index count : {0, 1, 2, 3, 20}) {
        const Normals up = shapes::upward(count);
        EXPECT_TRUE(loops_of(Positions::Zero(count, 3), up).empty()) << "coincident " << count;
        Positions line = Positions::Zero(count, 3);
        for (Index i = 0; i < count; ++i) line(i, 0) = i;
        EXPECT_TRUE(loops_of(line, up).empty()) << "line " << count;
        Positions pole = line;
        pole.col(0).swap(pole.col(2));
        EXPECT_TRUE(loops_of(pole, up).empty()) << "along the normal " << count;
    }
    // Fewer points than neighbors that are asked for.
    EXPECT_LE(loops_of(shapes::grid(3), shapes::upward(9), {.min_loop = 4.0}).size(), 1u);
}

TEST(Boundary, PointsThatCoincide) {
    const Positions once = shapes::grid(30);
    Positions p(2 * once.rows(), 3);
    p << once, once;
    const auto loops = loops_of(p, shapes::upward(to_index(p.rows())));
    ASSERT_EQ(loops.size(), 1u);
    EXPECT_EQ(loops[0], shapes::grid_border(30));
}

TEST(Boundary, CanBeCancelled) {
    const Positions p = square(5000);
    const Neighborhoods nearest = nearest_of(p);
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(find_boundary_loops(p, shapes::upward(5000), nearest, {}, progress), Cancelled);
}

TEST(Boundary, GivenLoopsAreTurnedAnticlockwise) {
    const Positions p = shapes::grid(12);
    const Neighborhoods nearest = nearest_of(p, 8);
    const BoundaryLoop border = shapes::grid_border(12);
    EXPECT_EQ(oriented_loop(p, shapes::upward(144), nearest, border, "cloth"), border);
    BoundaryLoop reversed = border;
    std::reverse(reversed.begin() + 1, reversed.end());
    EXPECT_EQ(oriented_loop(p, shapes::upward(144), nearest, reversed, "cloth"), border);
    EXPECT_EQ(oriented_loop(p, -shapes::upward(144), nearest, border, "cloth"), reversed);
}

TEST(Boundary, GivenLoopsAreChecked) {
    const Positions p = shapes::grid(12);
    const Neighborhoods nearest = nearest_of(p, 8);
    const auto check = [&](BoundaryLoop loop) {
        return oriented_loop(p, shapes::upward(144), nearest, std::move(loop), "cloth");
    };
    for (const BoundaryLoop& loop :
         {BoundaryLoop{}, {0, 1}, {0, 1, 144}, {0, -1, 5}, {0, 1, 2, 1}}) {
        try {
            check(loop);
            ADD_FAILURE() << "accepted a loop of " << loop.size();
        } catch (const FeatureError& error) {
            EXPECT_EQ(error.subject(), "boundary of cloth");
            EXPECT_FALSE(error.advice().empty());
        }
    }
}

TEST(Boundary, LengthOfAClosedPolygon) {
    Positions p(4, 3);
    p << 0, 0, 0, 3, 0, 0, 3, 4, 0, 9, 9, 9;
    EXPECT_DOUBLE_EQ(loop_length(p, BoundaryLoop{0, 1, 2}), 12.0);
    EXPECT_DOUBLE_EQ(loop_length(p, BoundaryLoop{}), 0.0);
}

/// How the loops of a mesh's vertices compare with the mesh's own boundary.
struct Agreement {
    double precision;  ///< share of loop points that are boundary vertices
    double recall;     ///< share of boundary vertices that are on a loop
    double length;     ///< of all loops, over that of all boundary edges
    std::size_t loops;
};

Agreement agreement(const real_meshes::Mesh& mesh, const Normals& normals) {
    const auto loops = loops_of(mesh.positions, normals);
    double found = 0.0, right = 0.0, length = 0.0, true_length = 0.0;
    for (const auto& loop : loops) {
        length += loop_length(mesh.positions, loop);
        for (const Index i : loop) {
            found += 1.0;
            right += mesh.boundary.contains(i) ? 1.0 : 0.0;
        }
    }
    for (const auto& [vertex, edge] : mesh.boundary) true_length += edge;
    return {right / found, right / static_cast<double>(mesh.boundary.size()), length / true_length,
            loops.size()};
}

Normals estimated_normals(const Positions& p) {
    Progress progress;
    const Neighborhoods nearest = nearest_of(p);
    Normals normals = covariance_analysis(p, nearest, progress).normals;
    orient_normals(p, nearest, normals, progress);
    return normals;
}

TEST(BoundaryOfRealMeshes, IsThatOfTheFaces) {
    SKIP_WHERE_WATCHED();
    struct Case {
        const char* name;
        std::size_t loops;
        double precision, recall, length;
    };
    // The first is cropped along a saw-tooth line, whose narrow notches no cloud shows.
    for (const Case& expected : {Case{"nefertiti_demosthenes/source.ply", 1, 0.95, 0.85, 0.08},
                                 Case{"nefertiti_demosthenes/target.ply", 1, 0.98, 0.98, 0.02},
                                 Case{"face_nefertiti/source.ply", 1, 1.0, 1.0, 1e-9},
                                 Case{"extras/demosthenes_bust.ply", 1, 0.98, 0.94, 0.03},
                                 Case{"extras/plane_holes.ply", 27, 0.98, 0.98, 0.02}}) {
        const auto mesh = real_meshes::read(expected.name);
        if (!mesh)
            GTEST_SKIP() << real_meshes::folder() / expected.name << " is not there: not measured.";
        for (const bool estimated : {false, true}) {
            SCOPED_TRACE(std::string(expected.name) + (estimated ? ", normals estimated" : ""));
            const auto [precision, recall, length, loops] =
                agreement(*mesh, estimated ? estimated_normals(mesh->positions) : mesh->normals);
            EXPECT_EQ(loops, expected.loops);
            EXPECT_GE(precision, expected.precision);
            EXPECT_GE(recall, expected.recall);
            EXPECT_NEAR(length, 1.0, expected.length);
        }
    }
}

TEST(BoundaryOfRealMeshes, NoneWhereFacesCloseThem) {
    SKIP_WHERE_WATCHED();
    for (const char* name :
         {"koala_spot/source.ply", "koala_spot/target.ply", "man_woman/source.ply",
          "man_woman/target.ply", "torus_kitten/source.ply", "torus_kitten/target.ply"}) {
        const auto mesh = real_meshes::read(name);
        if (!mesh) GTEST_SKIP() << real_meshes::folder() / name << " is not there: not measured.";
        ASSERT_TRUE(mesh->boundary.empty());
        EXPECT_TRUE(loops_of(mesh->positions, mesh->normals).empty()) << name;
        EXPECT_TRUE(loops_of(mesh->positions, estimated_normals(mesh->positions)).empty())
            << name << ", normals estimated";
    }
}

TEST(Example, Boundary) {
    const Positions positions = disc(1000);
    const Normals normals = shapes::upward(1000);
    const Neighborhoods nearest = nearest_of(positions);
    Progress progress;
    // --- example
    const auto loops = find_boundary_loops(positions, normals, nearest, {.opening = 2.0}, progress);
    const bool is_closed = loops.empty();
    const double length = is_closed ? 0.0 : loop_length(positions, loops.front());
    // --- end of the example
    EXPECT_FALSE(is_closed);
    EXPECT_NEAR(length, 2.0 * std::numbers::pi, 0.5);
}

}  // namespace
}  // namespace pointmorph

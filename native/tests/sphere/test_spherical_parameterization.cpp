#include "pointmorph/sphere/spherical_parameterization.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <numbers>
#include <string>
#include <utility>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/covariance.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// A cloud with what the stage needs of it.
struct Prepared {
    Positions positions;
    Normals normals;
    Neighborhoods nearest;

    explicit Prepared(Positions given) : positions(std::move(given)) {
        Progress progress;
        const KdTree<3> tree(positions);
        nearest = nearest_neighbors(tree, 16, progress);
        normals = covariance_analysis(positions, nearest, progress).normals;
        orient_normals(positions, nearest, normals, progress);
    }

    SphericalMesh mesh(Index nodes, std::span<const Index> required = {}) const {
        Progress progress;
        SphericalOptions options;
        options.nodes = nodes;
        return spherical_mesh({positions, normals, nearest}, required, options, progress);
    }

    std::vector<PlaceInMesh> places_in(const SphericalMesh& mesh, Progress& progress) const {
        const auto count = to_index(positions.rows());
        std::vector<PlaceInMesh> places(to_size(count), {-1, Vector3::Zero()});
        MeshPlaces(mesh).find(positions, normals, 0, count, places, progress);
        return places;
    }
};

/// A ball with three limbs, one of them long.
Positions limbed(Index count) {
    return shapes::Urchin(
               count,
               {1.6 * Vector3::UnitX(), Vector3::UnitY(), Vector3(-0.5, 0.2, -1.0).normalized()}, 5)
        .positions;
}

double area(const Eigen::RowVector3d& a, const Eigen::RowVector3d& b, const Eigen::RowVector3d& c) {
    return 0.5 * (b - a).cross(c - a).norm();
}

void expect_closed(const SphericalMesh& mesh) {
    EXPECT_EQ(to_index(mesh.triangles.size()), 2 * mesh.size() - 4);
    std::map<std::pair<Index, Index>, int> edges;
    for (const auto& [a, b, c] : mesh.triangles)
        for (const auto& e : {std::pair{a, b}, {b, c}, {c, a}}) ++edges[e];
    EXPECT_EQ(edges.size(), 3 * mesh.triangles.size());
    for (const auto& [edge, times] : edges) {
        EXPECT_EQ(times, 1);
        EXPECT_EQ(edges.count({edge.second, edge.first}), 1u);
    }
}

TEST(SphericalParameterization, ASphereIsItselfButForATurn) {
    const Prepared ball(shapes::sphere(4000));
    const SphericalMesh mesh = ball.mesh(500);
    expect_closed(mesh);
    EXPECT_EQ(turned_over(mesh.triangles, mesh.images), 0.0);
    const Matrix3 covariance = mesh.positions.transpose() * mesh.images;
    const Positions turned = mesh.images * best_rotation(covariance).rotation.transpose();
    const double spacing = std::sqrt(4.0 * std::numbers::pi / mesh.size());
    EXPECT_LT(std::sqrt((turned - mesh.positions).rowwise().squaredNorm().mean()), spacing);
}

TEST(SphericalParameterization, LimbsKeepTheirShareOfTheSphere) {
    const Prepared shape(limbed(6000));
    const SphericalMesh mesh = shape.mesh(800);
    expect_closed(mesh);
    EXPECT_EQ(turned_over(mesh.triangles, mesh.images), 0.0);
    EXPECT_LT((mesh.images.rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-12);
    double least = 1.0, limb = 0.0, limb_image = 0.0, all = 0.0, all_image = 0.0;
    for (const auto& [a, b, c] : mesh.triangles) {
        const double here =
            area(mesh.positions.row(a), mesh.positions.row(b), mesh.positions.row(c));
        const double there = area(mesh.images.row(a), mesh.images.row(b), mesh.images.row(c));
        least = std::min(least, there);
        all += here;
        all_image += there;
        if (mesh.positions(a, 0) < 0.8) continue;
        limb += here;
        limb_image += there;
    }
    // A conformal map would leave the end of the long limb a thousandth of its share.
    EXPECT_GT(limb, 0.0);
    EXPECT_GT(limb_image / all_image, 0.4 * limb / all);
    EXPECT_GT(least, 0.02 * all_image / static_cast<double>(mesh.triangles.size()));
}

TEST(SphericalParameterization, TrianglesFollowTheSurface) {
    SKIP_WHERE_WATCHED();
    const Prepared shape(limbed(6000));
    const SphericalMesh mesh = shape.mesh(800);
    double wrong = 0.0, all = 0.0;
    for (const auto& [a, b, c] : mesh.triangles) {
        const Eigen::RowVector3d across =
            Eigen::RowVector3d(mesh.positions.row(b) - mesh.positions.row(a))
                .cross(mesh.positions.row(c) - mesh.positions.row(a));
        all += across.norm();
        if (across.dot(mesh.normals.row(a)) < 0.0) wrong += across.norm();
    }
    EXPECT_LT(wrong, 0.02 * all);
}

TEST(SphericalParameterization, PointsLieBetweenTheCornersAroundThem) {
    const Prepared shape(limbed(5000));
    const std::vector<Index> required{17, 4000, 123};
    const SphericalMesh mesh = shape.mesh(600, required);
    for (std::size_t k = 0; k < required.size(); ++k) EXPECT_EQ(mesh.rows[k], required[k]);
    Progress progress;
    const Positions images = onto_sphere(mesh, shape.positions, shape.normals, progress);
    EXPECT_LT((images.rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-12);
    for (Index v = 0; v < mesh.size(); ++v)
        EXPECT_EQ(images.row(mesh.rows[to_size(v)]), mesh.images.row(v));
    // Close on the shape is close on the sphere: a few of the nodes' spacings at the most.
    double farthest = 0.0;
    for (Index i = 0; i < 5000; ++i)
        for (const Index j : shape.nearest[i].first(4))
            farthest = std::max(farthest, (images.row(i) - images.row(j)).norm());
    EXPECT_LT(farthest, 4.0 * std::sqrt(4.0 * std::numbers::pi / mesh.size()));
}

TEST(SphericalParameterization, SizeAndThreadsDoNotMatter) {
    SKIP_WHERE_WATCHED();
    const Prepared shape(limbed(2500)), large(4.0 * limbed(2500));
    SphericalMesh one, three;
    {
        const ThreadCount threads(1);
        one = shape.mesh(400);
    }
    {
        const ThreadCount threads(3);
        three = shape.mesh(400);
    }
    EXPECT_EQ(one.images, three.images);
    EXPECT_EQ(one.triangles, three.triangles);
    const SphericalMesh same = large.mesh(400);
    EXPECT_EQ(one.triangles, same.triangles);
    EXPECT_LT((one.images - same.images).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(SphericalParameterization, WhatIsNoSphereIsRefused) {
    EXPECT_THROW(Prepared(shapes::torus(5000, 0.4)).mesh(600), TopologyError);

    Prepared inward(shapes::sphere(1000));
    inward.normals = -inward.normals;
    EXPECT_THROW(inward.mesh(300), TopologyError);

    Positions two(2000, 3);
    two << shapes::sphere(1000), shapes::sphere(1000).rowwise() + Eigen::RowVector3d(5, 0, 0);
    EXPECT_THROW(Prepared(two).mesh(300), TopologyError);

    EXPECT_THROW(Prepared(shapes::sphere(20)).mesh(300), CloudError);
}

TEST(SphericalParameterization, SmallPartsGoWithWhatIsNearest) {
    Positions ball_with_button(2060, 3);
    ball_with_button << shapes::sphere(2000),
        (0.05 * shapes::sphere(60)).rowwise() + Eigen::RowVector3d(1.5, 0, 0);
    const Prepared shape(ball_with_button);
    const SphericalMesh mesh = shape.mesh(300);
    EXPECT_EQ(mesh.loose, 60);
    Progress progress;
    const Positions images = onto_sphere(mesh, shape.positions, shape.normals, progress);
    EXPECT_TRUE(images.allFinite());
    const std::vector<Index> on_button{2010};
    EXPECT_THROW(shape.mesh(300, on_button), FeatureError);
}

TEST(SphericalParameterization, PlacesInTheMeshOutlastAMoveOfItsImages) {
    const Prepared shape(limbed(is_watched() ? 1200 : 3000));
    SphericalMesh mesh = shape.mesh(300);
    Progress progress;
    const auto places = shape.places_in(mesh, progress);
    for (const auto& [triangle, shares] : places) {
        ASSERT_GE(triangle, 0);
        EXPECT_LT(to_size(triangle), mesh.triangles.size());
        EXPECT_GT(shares.minCoeff(), -1e-12);
        EXPECT_NEAR(shares.sum(), 1.0, 1e-12);
    }
    mesh.images = mesh.images * Eigen::AngleAxisd(0.7, Vector3(1, 2, 3).normalized()).matrix();
    const Positions images = onto_sphere(mesh, places);
    EXPECT_EQ(images, onto_sphere(mesh, shape.positions, shape.normals, progress));
    for (Index v = 0; v < mesh.size(); ++v)
        EXPECT_EQ(images.row(mesh.rows[to_size(v)]), mesh.images.row(v));
}

TEST(SphericalParameterization, PlacesAreTheSameInParts) {
    const Index count = is_watched() ? 1200 : 3000;
    const Prepared shape(limbed(count));
    const SphericalMesh mesh = shape.mesh(300);
    Progress progress;
    const auto all = shape.places_in(mesh, progress);
    const MeshPlaces finder(mesh);
    constexpr Index kUntouched = -7;
    std::vector<PlaceInMesh> parts(all.size(), {kUntouched, Vector3::Zero()});
    for (const auto& [begin, end] : {std::pair<Index, Index>(700, count), {0, 700}, {700, 700}}) {
        finder.find(shape.positions, shape.normals, begin, end, parts, progress);
        EXPECT_EQ(parts.front().triangle == kUntouched, begin == 700 && end == count);
    }
    for (std::size_t i = 0; i < all.size(); ++i) {
        EXPECT_EQ(parts[i].triangle, all[i].triangle);
        EXPECT_EQ(parts[i].shares, all[i].shares);
    }
}

TEST(SphericalParameterization, PointsThatCoincideAreNoObstacle) {
    const Index count = is_watched() ? 600 : 1500;
    const Positions once = limbed(count);
    Positions twice(2 * count, 3);
    twice << once, once;
    const SphericalMesh mesh = Prepared(twice).mesh(300);
    expect_closed(mesh);
    EXPECT_EQ(turned_over(mesh.triangles, mesh.images), 0.0);
}

TEST(SphericalParameterization, CanBeCancelled) {
    const Prepared shape(limbed(is_watched() ? 1200 : 3000));
    int calls = 0;
    Progress progress([&](std::string_view, double) { return ++calls < 3; },
                      std::chrono::milliseconds(0));
    progress.enter("spherical parameterization");
    EXPECT_THROW(spherical_mesh({shape.positions, shape.normals, shape.nearest}, {}, {}, progress),
                 Cancelled);
}

TEST(Example, SphericalParameterization) {
    const Prepared shape(limbed(4000));
    const Positions& positions = shape.positions;
    const Normals& normals = shape.normals;
    const Neighborhoods& nearest = shape.nearest;
    const std::vector<Index> features{17, 3};
    Progress progress;
    // --- example
    const SphericalMesh mesh =
        spherical_mesh({positions, normals, nearest}, features, {.nodes = 500}, progress);
    const Positions sphere = onto_sphere(mesh, positions, normals, progress);  // unit vectors

    // The same in two steps. Places in the mesh stay when alignment moves its nodes on the sphere.
    const auto count = to_index(positions.rows());
    std::vector<PlaceInMesh> places(to_size(count));
    MeshPlaces(mesh).find(positions, normals, 0, count, places, progress);
    const Positions the_same = onto_sphere(mesh, places);
    // --- end of the example
    EXPECT_EQ(mesh.rows.front(), 17);
    EXPECT_EQ(the_same, sphere);
    EXPECT_EQ(turned_over(mesh.triangles, mesh.images), 0.0);
    EXPECT_LT((sphere.rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-9);
}

}  // namespace
}  // namespace pointmorph

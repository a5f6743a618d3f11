#include "pointmorph/sphere/spherical_alignment.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/surface/transfer.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

const std::vector<Vector3> kLimbs{1.2 * Vector3::UnitX(), 0.8 * Vector3::UnitY(),
                                  -1.0 * Vector3::UnitX(),
                                  0.5 * Vector3(0.3, -1.0, 0.6).normalized()};

/// A ball with four limbs of different length, whose ends are the first nodes of the mesh.
struct Limbed {
    Positions positions;
    Normals normals;
    SphericalMesh mesh;

    Limbed(Index count, unsigned seed, const Matrix3& turn = Matrix3::Identity()) {
        const shapes::Urchin urchin(count, kLimbs, seed);
        positions = urchin.positions * turn.transpose();
        normals = urchin.normals * turn.transpose();
        std::vector<Index> ends;
        for (const Vector3& limb : kLimbs) {
            const Vector3 end = turn * (limb + 0.5 * limb.normalized());
            Index nearest = 0;
            (positions.rowwise() - end.transpose()).rowwise().squaredNorm().minCoeff(&nearest);
            ends.push_back(nearest);
        }
        Progress progress;
        const KdTree<3> tree(positions);
        SphericalOptions options;
        options.nodes = is_watched() ? 200 : 500;
        mesh = spherical_mesh({positions, normals, nearest_neighbors(tree, 16, progress)}, ends,
                              options, progress);
    }
};

/// So many points, or half of them where every access is watched.
Index watched_size(Index count) {
    return is_watched() ? count / 2 : count;
}

std::vector<IndexPair> first_nodes(Index count) {
    std::vector<IndexPair> pairs;
    for (Index k = 0; k < count; ++k) pairs.push_back({k, k});
    return pairs;
}

/// Mean distance from where source points go to where they should, at `turn` of themselves.
double misfit(const Limbed& source, const Limbed& target, const Matrix3& turn) {
    Progress progress;
    const KdTree<3>::Points from =
        onto_sphere(source.mesh, source.positions, source.normals, progress);
    const KdTree<3>::Points to =
        onto_sphere(target.mesh, target.positions, target.normals, progress);
    const Positions images =
        transfer<3>(KdTree<3>(to), target.positions, from, TransferOptions{}, progress);
    return (images - source.positions * turn.transpose()).rowwise().norm().mean();
}

void expect_valid(const SphericalMesh& mesh) {
    EXPECT_TRUE(mesh.images.allFinite());
    EXPECT_EQ(turned_over(mesh.triangles, mesh.images), 0.0);
    EXPECT_LT((mesh.images.rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-12);
}

TEST(SphericalAlignment, FeaturesMeetToTheBitAndTheSameShapeFitsItself) {
    const Matrix3 turn = shapes::rotation(7);
    Limbed source(watched_size(4000), 1), target(watched_size(3500), 2, turn);
    Progress progress;
    const auto features = first_nodes(4);
    const SphericalAlignment result =
        align_on_sphere(source.mesh, target.mesh, features, {}, progress);
    EXPECT_FALSE(result.searched);
    for (const auto& [s, t] : features)
        EXPECT_EQ(source.mesh.images.row(s), target.mesh.images.row(t));
    expect_valid(source.mesh);
    expect_valid(target.mesh);
    // The nodes are some 0.1 apart.
    EXPECT_LT(misfit(source, target, turn), 0.1);
}

TEST(SphericalAlignment, EveningOutBringsPlacesNearerToWhereTheyBelong) {
    SKIP_WHERE_WATCHED();
    const auto after = [](Index rounds) {
        Limbed source(4000, 1), target(3500, 2);
        SphericalAlignmentOptions options;
        options.descent_rounds = rounds;
        options.extremities = 0;
        Progress progress;
        align_on_sphere(source.mesh, target.mesh, first_nodes(3), options, progress);
        return misfit(source, target, Matrix3::Identity());
    };
    EXPECT_LT(after(12), 0.8 * after(0));
}

TEST(SphericalAlignment, WithoutFeaturesTheTurnIsFound) {
    const Matrix3 turn = shapes::rotation(11);
    for (const Index marked : {0, 1}) {
        if (marked > 0 && is_watched()) break;  // found in the same way
        Limbed source(watched_size(3000), 1), target(watched_size(3000), 2, turn);
        Progress progress;
        const SphericalAlignment result =
            align_on_sphere(source.mesh, target.mesh, first_nodes(marked), {}, progress);
        EXPECT_TRUE(result.searched);
        expect_valid(source.mesh);
        expect_valid(target.mesh);
        EXPECT_LT(misfit(source, target, turn), 0.15) << marked << " marked";
    }
}

TEST(SphericalAlignment, WorkBesideIsDoneOnceAndChangesNothing) {
    const Limbed source(watched_size(2000), 1), target(watched_size(2000), 2);
    const auto images_with = [&](const WorkBeside& beside, int threads) {
        const ThreadCount limit(threads);
        SphericalMesh s = source.mesh, t = target.mesh;
        Progress progress;
        align_on_sphere(s, t, first_nodes(3), {.descent_rounds = 2}, progress, beside);
        return s.images;
    };
    const Positions alone = images_with({}, 1);
    for (const int threads : {1, 2, 4}) {
        std::array<std::atomic<int>, 3> done{};
        WorkBeside beside;
        for (std::atomic<int>& its : done) beside.push_back([&its](Progress&) { ++its; });
        EXPECT_EQ(images_with(beside, threads), alone);
        for (const std::atomic<int>& its : done) EXPECT_EQ(its, 1);
    }
    const WorkBeside failing{[](Progress&) { throw ConvergenceError("a", "b", "c", "d"); }};
    EXPECT_THROW(images_with(failing, 2), ConvergenceError);
}

TEST(SphericalAlignment, ExchangedFeaturesNeverFold) {
    Limbed source(2500, 1), target(2500, 2);
    const std::vector<IndexPair> exchanged{{0, 1}, {1, 0}, {2, 2}, {3, 3}};
    SphericalAlignmentOptions options;
    options.descent_rounds = 1;
    Progress progress;
    try {
        align_on_sphere(source.mesh, target.mesh, exchanged, options, progress);
        for (const auto& [s, t] : exchanged)
            EXPECT_EQ(source.mesh.images.row(s), target.mesh.images.row(t));
    } catch (const ConvergenceError&) {
    }
    expect_valid(source.mesh);
    expect_valid(target.mesh);
}

TEST(SphericalAlignment, PlacesAreFoundWhereverTheSearchStarts) {
    const Limbed shape(2000, 3);
    SphereLocator locator(shape.mesh.triangles, -shape.mesh.images);
    locator.move_to(shape.mesh.images);
    std::mt19937_64 random(4);
    std::normal_distribution<double> normal;
    const auto triangles = to_index(shape.mesh.triangles.size());
    for (int k = 0; k < 300; ++k) {
        const Vector3 place = Vector3(normal(random), normal(random), normal(random)).normalized();
        const auto start = to_index(random() % static_cast<std::uint64_t>(triangles));
        const auto [triangle, shares] = locator.find(place, start);
        EXPECT_GE(shares.minCoeff(), 0.0);
        EXPECT_NEAR(shares.sum(), 1.0, 1e-12);
        Vector3 there = Vector3::Zero();
        for (std::size_t c = 0; c < 3; ++c)
            there += shares[to_index(c)] *
                     shape.mesh.images.row(shape.mesh.triangles[to_size(triangle)][c]).transpose();
        EXPECT_LT((there.normalized() - place).norm(), 1e-9);
    }
}

TEST(SphericalAlignment, CanBeCancelled) {
    Limbed source(watched_size(2000), 1), target(watched_size(2000), 2);
    int calls = 0;
    Progress progress([&](std::string_view, double) { return ++calls < 3; },
                      std::chrono::milliseconds(0));
    progress.enter("spherical alignment");
    EXPECT_THROW(align_on_sphere(source.mesh, target.mesh, first_nodes(3), {}, progress),
                 Cancelled);
}

TEST(Example, SphericalAlignment) {
    SKIP_WHERE_WATCHED();
    Limbed one(4000, 1), other(3500, 2);
    SphericalMesh &source = one.mesh, &target = other.mesh;
    const Positions& positions = one.positions;
    const Normals& normals = one.normals;
    const auto features = first_nodes(4);
    Progress progress;
    // --- example
    const SphericalAlignment done =
        align_on_sphere(source, target, features, {.rotations = 2000}, progress);
    const Positions on_sphere = onto_sphere(source, positions, normals, progress);
    // --- end of the example
    EXPECT_FALSE(done.searched);  // four features say how to rotate it
    for (const auto& [s, t] : features) EXPECT_EQ(source.images.row(s), target.images.row(t));
    EXPECT_LT((on_sphere.rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-9);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/mesh/mesh_samples.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "mesh_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

MeshSamples sampled(const Mesh& mesh, Index count, const std::vector<Index>& kept = {}) {
    Progress progress;
    return sample_mesh(mesh, kept, {.count = count}, progress);
}

Values nearest_distances(const Positions& p) {
    const KdTree<3> tree(p);
    Values distances(p.rows());
    std::vector<Index> found(2);
    std::vector<double> squared(2);
    for (Index i = 0; i < p.rows(); ++i) {
        tree.nearest(p.row(i).data(), found, squared);
        distances[i] = std::sqrt(squared[1]);
    }
    return distances;
}

TEST(MeshSamples, LieEvenlyHoweverTheVerticesLie) {
    const Matrix3 small = 0.4 * Matrix3::Identity();
    const Mesh mesh = make_mesh(
        mesh_shapes::together(mesh_shapes::icosphere(1),
                              mesh_shapes::moved(mesh_shapes::icosphere(4), small, {3, 0, 0})));
    const MeshSamples samples = sampled(mesh, 4000);
    const double spacing = std::sqrt(mesh.area() / 4000);
    const Values distances = nearest_distances(samples.positions);
    EXPECT_GT(distances.minCoeff(), 0.5 * spacing);
    EXPECT_LT(distances.maxCoeff(), 1.6 * spacing);
    for (Index i = 0; i < samples.size(); ++i) {
        const Index f = samples.triangles[to_size(i)];
        EXPECT_NEAR(samples.weights.row(i).sum(), 1.0, 1e-12);
        EXPECT_GE(samples.weights.row(i).minCoeff(), 0.0);
        EXPECT_EQ(samples.parts[to_size(i)], mesh.parts[to_size(mesh.triangles(f, 0))]);
    }
    EXPECT_LT((samples.mixed(mesh, mesh.positions) - samples.positions).norm(), 1e-12);
}

TEST(MeshSamples, HaveSmoothNormalsButAtCreases) {
    const Mesh ball = make_mesh(mesh_shapes::icosphere(2));
    const MeshSamples round = sampled(ball, 1000);
    for (Index i = 0; i < round.size(); ++i)
        EXPECT_LT((round.normals.row(i) - round.positions.row(i).normalized()).norm(), 0.05);
    const Mesh box = make_mesh(mesh_shapes::cube());
    const MeshSamples sharp = sampled(box, 1000);
    for (Index i = 0; i < sharp.size(); ++i) {
        if (sharp.weights.row(i).minCoeff() == 0.0) continue;  // on an edge
        EXPECT_NEAR(sharp.normals.row(i).cwiseAbs().maxCoeff(), 1.0, 1e-12);
    }
}

TEST(MeshSamples, OfABeamThinnerThanTheirDistanceMostLieOnFaces) {
    Cloud beam = mesh_shapes::cube();
    beam.positions.col(0) *= 100.0;
    const Mesh mesh = make_mesh(beam);
    const MeshSamples samples = sampled(mesh, 200);  // 2 apart, as wide as the beam
    EXPECT_EQ(samples.size(), 200);
    Index on_faces = 0;
    for (Index i = 0; i < samples.size(); ++i) {
        const Eigen::Array3d normal = samples.normals.row(i).transpose().array().abs();
        on_faces += normal.maxCoeff() > 0.99 ? 1 : 0;
    }
    EXPECT_GT(on_faces, 120);
    EXPECT_LT(on_faces, 190);
}

/// Normals on different faces are perpendicular or oppose each other: only samples in between tell
/// that the faces meet.
TEST(MeshSamples, JoinFacesAlongSharpEdges) {
    const Mesh box = make_mesh(mesh_shapes::cube());
    const std::vector<Index> kept{7};
    const MeshSamples samples = sampled(box, 1500, kept);
    const double spacing = std::sqrt(box.area() / 1500);
    const double edge = box.positions.maxCoeff();
    const Vector3 corner = samples.normals.row(samples.kept[0]).transpose();
    EXPECT_NEAR(corner.cwiseAbs().minCoeff(), std::sqrt(1.0 / 3.0), 1e-9);
    Index along = 0;
    for (Index i = 0; i < samples.size(); ++i) {
        const Eigen::Array3d at = samples.positions.row(i).transpose().array() / edge;
        if ((at.abs() > 1.0 - 1e-9).count() != 2) continue;
        ++along;
        for (Index k = 0; k < 3; ++k) {
            const bool is_across = std::abs(at[k]) > 1.0 - 1e-9;
            EXPECT_NEAR(samples.normals(i, k),
                        is_across ? std::copysign(std::sqrt(0.5), at[k]) : 0.0, 1e-9);
        }
    }
    EXPECT_NEAR(along * spacing, 12 * 2.0 * edge, 12 * 2.0 * spacing);
}

TEST(MeshSamples, KeepPlacesInTheirOrder) {
    const Mesh mesh = make_mesh(mesh_shapes::icosphere(2));
    const std::vector<Index> kept{100, 3, 77};
    const MeshSamples samples = sampled(mesh, 500, kept);
    EXPECT_EQ(samples.size(), 500);
    for (std::size_t k = 0; k < kept.size(); ++k)
        EXPECT_EQ(samples.positions.row(samples.kept[k]), mesh.positions.row(kept[k]));
}

TEST(MeshSamples, FollowBordersInOrder) {
    const Mesh mesh = make_mesh(mesh_shapes::grid(2));
    const std::vector<Index> kept{0};  // a corner
    const MeshSamples samples = sampled(mesh, 900, kept);
    const double spacing = std::sqrt(mesh.area() / 900);
    ASSERT_GT(samples.border.size(), 110u);
    EXPECT_EQ(std::ranges::count(samples.border, samples.kept[0]), 1);
    const double edge = mesh.positions.col(0).maxCoeff();
    for (std::size_t k = 0; k < samples.border.size(); ++k) {
        const auto at = samples.positions.row(samples.border[k]);
        const auto next = samples.positions.row(samples.border[(k + 1) % samples.border.size()]);
        EXPECT_NEAR(at.cwiseAbs().maxCoeff(), edge, 1e-12);
        EXPECT_LT((next - at).norm(), 1.01 * spacing);
    }
}

TEST(MeshSamples, TakeABorderOfWhichVeryManyPlacesAreKept) {
    // Each looked for among all, these would take half a minute.
    const Index steps = is_watched() ? 30000 : 300000;
    Cloud cloud;
    cloud.positions.resize(steps + 1, 3);
    cloud.positions.row(steps).setZero();
    for (Index k = 0; k < steps; ++k) {
        const double angle = 2.0 * std::numbers::pi * k / steps;
        cloud.positions.row(k) << std::cos(angle), std::sin(angle), 0.0;
        mesh_shapes::add_face(cloud.faces, {steps, k, (k + 1) % steps});
    }
    const Mesh disk = make_mesh(cloud);
    std::vector<Index> kept;
    for (const Index place : disk.borders.at(0)) kept.push_back(place);
    std::ranges::reverse(kept);
    kept.push_back(kept.front());  // also asked for twice: the first one counts
    Progress progress;
    const MeshSamples samples =
        sample_mesh(disk, kept, {.count = steps + 10, .even = false}, progress);
    ASSERT_EQ(samples.border.size(), to_size(steps));
    for (std::size_t k = 0; k < samples.border.size(); ++k)
        ASSERT_EQ(samples.border[k], samples.kept[to_size(steps) - 1 - k]);
}

/// Triangles that meet at one vertex.
Cloud blades(Index count) {
    Cloud cloud;
    cloud.positions.resize(2 * count + 1, 3);
    cloud.positions.row(2 * count).setZero();
    for (Index k = 0; k < count; ++k) {
        const double angle = std::numbers::pi * k / count;
        cloud.positions.row(2 * k) << std::cos(angle), std::sin(angle), 0.0;
        cloud.positions.row(2 * k + 1) << std::cos(angle), std::sin(angle), 0.01;
        mesh_shapes::add_face(cloud.faces, {2 * count, 2 * k, 2 * k + 1});
    }
    return cloud;
}

TEST(MeshSamples, AreNotMostlyAlongBorders) {
    // A ball and a loose triangle: as far apart as the area says, there would be 20,000 along it.
    const Cloud ball = mesh_shapes::icosphere(3);
    Cloud sliver;
    sliver.positions.resize(3, 3);
    sliver.positions << 2, 0, 0, 3, 0, 0, 2.5, 1e-6, 0;
    mesh_shapes::add_face(sliver.faces, {0, 1, 2});
    const MeshSamples both = sampled(make_mesh(mesh_shapes::together(ball, sliver)), 3000);
    EXPECT_LT(std::ranges::count(both.parts, 1), 2000);
    EXPECT_GT(std::ranges::count(both.parts, 1), 60);
    // Many blades at one vertex: 200,000.
    EXPECT_LT(sampled(make_mesh(blades(4000)), 3000).size(), 60000);
    // As many as ever on what is only thin.
    const Mesh strip =
        make_mesh(mesh_shapes::moved(mesh_shapes::grid(8), Vector3(1, 0.02, 1).asDiagonal(), {}));
    const double spacing = std::sqrt(strip.area() / 200);
    const double border = border_length(strip) * std::sqrt(strip.area());
    EXPECT_NEAR(static_cast<double>(sampled(strip, 200).border.size()), border / spacing, 2.0);
}

TEST(MeshSamples, GiveSmallPartsEnough) {
    const Mesh mesh = make_mesh(mesh_shapes::together(
        mesh_shapes::icosphere(2),
        mesh_shapes::moved(mesh_shapes::icosphere(2), 0.02 * Matrix3::Identity(), {2, 0, 0})));
    const MeshSamples samples = sampled(mesh, 5000);
    EXPECT_EQ(std::ranges::count(samples.parts, 1), 64);
}

TEST(MeshSamples, AreAsManyAsTheMeshHasDetailFor) {
    EXPECT_EQ(sample_count(make_mesh(mesh_shapes::cube())), 3000);
    EXPECT_EQ(sample_count(make_mesh(mesh_shapes::icosphere(3))), 8 * 642);
    EXPECT_EQ(sample_count(make_mesh(mesh_shapes::icosphere(4))), 12000);
    Mesh large;
    large.positions.resize(100000, 3);
    EXPECT_EQ(sample_count(large), 25000);
    large.positions.resize(1000000, 3);
    EXPECT_EQ(sample_count(large), 50000);
}

TEST(MeshSamples, AreTheSameForAnyNumberOfThreads) {
    const Mesh mesh = make_mesh(mesh_shapes::cylinder(17));
    const MeshSamples all = sampled(mesh, 3000);
    const ThreadCount one(1);
    EXPECT_EQ(sampled(mesh, 3000).positions, all.positions);
}

TEST(MeshSamples, CanBeCancelled) {
    const Mesh mesh = make_mesh(mesh_shapes::cube());
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(sample_mesh(mesh, {}, {}, progress), Cancelled);
}

TEST(Example, MeshSamples) {
    const Mesh mesh = make_mesh(mesh_shapes::icosphere(2));
    const std::vector<Index> marked_places{5, 40};
    const Positions images_of_places = 2.0 * mesh.positions;
    Progress progress;
    // --- example
    const MeshSamples samples = sample_mesh(mesh, marked_places, {.count = 1000}, progress);
    const Index nose = samples.kept[0];
    const Positions images = samples.mixed(mesh, images_of_places);
    // --- end of the example
    EXPECT_EQ(samples.positions.row(nose), mesh.positions.row(5));
    EXPECT_LT((images - 2.0 * samples.positions).cwiseAbs().maxCoeff(), 1e-12);
}

}  // namespace
}  // namespace pointmorph

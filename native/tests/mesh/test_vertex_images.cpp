#include "pointmorph/mesh/vertex_images.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "mesh_shapes.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/mesh/mesh_samples.hpp"

namespace pointmorph {
namespace {

struct Sampled {
    Mesh mesh;
    MeshSamples samples;
    VertexImages carried;

    explicit Sampled(const Cloud& cloud, const std::vector<Index>& kept = {}, Index count = 3000)
        : mesh(make_mesh(cloud)),
          samples(taken(mesh, kept, count)),
          carried(made(mesh, samples, count)) {}

    static MeshSamples taken(const Mesh& mesh, const std::vector<Index>& kept, Index count) {
        Progress progress;
        return sample_mesh(mesh, kept, {.count = count}, progress);
    }
    static VertexImages made(const Mesh& mesh, const MeshSamples& samples, Index count) {
        Progress progress;
        return {{mesh.positions, mesh.place_normals, mesh.parts},
                {samples.positions, samples.normals, samples.parts},
                std::sqrt(mesh.area() / count),
                progress};
    }

    template <class Map>
    double largest_error(Map&& map) const {
        Positions images(samples.positions.rows(), 3), expected(mesh.positions.rows(), 3);
        for (Index i = 0; i < images.rows(); ++i)
            images.row(i) = map(Vector3(samples.positions.row(i).transpose())).transpose();
        for (Index v = 0; v < expected.rows(); ++v)
            expected.row(v) = map(Vector3(mesh.positions.row(v).transpose())).transpose();
        Progress progress;
        return (carried.positions(images, progress) - expected).rowwise().norm().maxCoeff();
    }
};

TEST(VertexImages, AreExactForSimilarities) {
    const Matrix3 linear =
        2.5 * Eigen::AngleAxisd(2.0, Vector3(1, 2, 3).normalized()).toRotationMatrix();
    const auto map = [&](const Vector3& p) -> Vector3 { return linear * p + Vector3(4, 5, 6); };
    for (const Cloud& cloud : {mesh_shapes::cube(), mesh_shapes::cylinder(12),
                               mesh_shapes::icosphere(2), mesh_shapes::grid(3)})
        EXPECT_LT(Sampled(cloud).largest_error(map), 1e-12) << cloud.name;
}

TEST(VertexImages, FollowBendsToAFractionOfASpacing) {
    const auto map = [](const Vector3& p) -> Vector3 {
        return {p[0] + 0.3 * std::sin(2.0 * p[1]), p[1] + 0.2 * p[2] * p[2], p[2] * 1.5};
    };
    for (const Cloud& cloud : {mesh_shapes::cube(), mesh_shapes::icosphere(3)}) {
        const Sampled sampled(cloud);
        EXPECT_LT(sampled.largest_error(map), 0.1 * std::sqrt(sampled.mesh.area() / 3000))
            << cloud.name;
    }
}

TEST(VertexImages, PartBothSidesOfAThinSheet) {
    Cloud upper = mesh_shapes::grid(20);
    Cloud sheet = mesh_shapes::together(
        upper, mesh_shapes::moved(mesh_shapes::reversed(upper, [](Index) { return true; }),
                                  Matrix3::Identity(), {0, 0, -1e-4}));
    const Sampled sampled(sheet);
    const double middle =
        0.5 * (sampled.mesh.positions.col(2).maxCoeff() + sampled.mesh.positions.col(2).minCoeff());
    const auto apart = [&](const Vector3& p) -> Vector3 {
        return p + Vector3(p[2] > middle ? 1.0 : -1.0, 0, 0);
    };
    EXPECT_LT(sampled.largest_error(apart), 1e-9);
}

TEST(VertexImages, KeepToTheirPart) {
    // Two sheets that face the same way and almost touch.
    const Cloud both = mesh_shapes::together(
        mesh_shapes::grid(20),
        mesh_shapes::moved(mesh_shapes::grid(20), Matrix3::Identity(), {0.0, 0.0, 1e-3}));
    const Sampled sampled(both);
    Positions images = sampled.samples.positions, expected = sampled.mesh.positions;
    for (Index i = 0; i < images.rows(); ++i)
        images(i, 0) += 5.0 * sampled.samples.parts[to_size(i)];
    for (Index v = 0; v < expected.rows(); ++v)
        expected(v, 0) += 5.0 * sampled.mesh.parts[to_size(v)];
    Progress progress;
    EXPECT_LT((sampled.carried.positions(images, progress) - expected).rowwise().norm().maxCoeff(),
              1e-9);
}

TEST(VertexImages, OfASampledVertexAreTheSamplesOwn) {
    const Mesh mesh = make_mesh(mesh_shapes::cube());
    const Sampled sampled(mesh_shapes::cube(), {5});
    Positions images = sampled.samples.positions;
    images.row(sampled.samples.kept[0]) << 7, 8, 9;
    Progress progress;
    EXPECT_EQ(sampled.carried.positions(images, progress).row(5), Eigen::RowVector3d(7, 8, 9));
    EXPECT_EQ(sampled.carried.values(images, progress).row(5), Eigen::RowVector3d(7, 8, 9));
}

TEST(VertexImages, CarryAnyValues) {
    const Sampled sampled(mesh_shapes::icosphere(3));
    SampleValues values(sampled.samples.size(), 2);
    values << sampled.samples.positions.col(0), sampled.samples.positions.col(1).array() + 3.0;
    Progress progress;
    const SampleValues carried = sampled.carried.values(values, progress);
    EXPECT_LT((carried.col(0) - sampled.mesh.positions.col(0)).cwiseAbs().maxCoeff(), 5e-3);
    EXPECT_LT(
        (carried.col(1).array() - 3.0 - sampled.mesh.positions.col(1).array()).abs().maxCoeff(),
        5e-3);
}

TEST(VertexImages, TakeFewSamples) {
    const Mesh mesh = make_mesh(mesh_shapes::cube());
    Progress progress;
    const Positions one = mesh.positions.topRows(1), normal = mesh.place_normals.topRows(1);
    const VertexImages carried({mesh.positions, mesh.place_normals}, {one, normal}, 0.1, progress);
    EXPECT_TRUE(carried.positions(Positions::Ones(1, 3), progress).isApproxToConstant(1.0));
}

TEST(VertexImages, AreTheSameForAnyNumberOfThreads) {
    const Cloud cloud = mesh_shapes::icosphere(4);
    const auto carried = [&] {
        const Sampled sampled(cloud);
        Progress progress;
        return sampled.carried.positions(sampled.samples.positions, progress);
    };
    const Positions all = carried();
    const ThreadCount one(1);
    EXPECT_EQ(carried(), all);
}

TEST(Example, VertexImages) {
    const Mesh mesh = make_mesh(mesh_shapes::icosphere(2));
    const Positions &places = mesh.positions, &normals = mesh.place_normals;
    const MeshSamples taken = Sampled::taken(mesh, {}, 1000);
    const Positions& samples = taken.positions;
    const Normals& sample_normals = taken.normals;
    const Positions sample_images = 2.0 * samples;
    const double spacing = std::sqrt(mesh.area() / 1000);
    Progress progress;
    // --- example
    const VertexImages carried({places, normals}, {samples, sample_normals}, spacing, progress);
    const Positions images = carried.positions(sample_images, progress);
    // --- end of the example
    EXPECT_LT((images - 2.0 * places).cwiseAbs().maxCoeff(), 1e-12);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/mesh/subdivision.hpp"

#include <gtest/gtest.h>

#include "mesh/mesh_edges.hpp"
#include "mesh_shapes.hpp"

namespace pointmorph {
namespace {

double longest_edge(const Mesh& mesh) {
    const MeshEdges edges(mesh.triangles);
    double longest = 0.0;
    for (Index e = 0; e < edges.size(); ++e) {
        const auto from = mesh.positions.row(start_of(mesh.triangles, edges[e].front()));
        const auto to = mesh.positions.row(end_of(mesh.triangles, edges[e].front()));
        longest = std::max(longest, (to - from).norm());
    }
    return longest;
}

TEST(Subdivision, HalvesLongEdgesAndOpensNoGaps) {
    for (const Cloud& cloud : {mesh_shapes::cube(), mesh_shapes::cylinder(30)}) {
        const Mesh mesh = make_mesh(cloud);
        const Mesh finer = subdivided(mesh, {.longest = 0.1}).mesh;
        EXPECT_LE(longest_edge(finer), 0.1 * std::sqrt(mesh.area()));
        EXPECT_NEAR(finer.area(), mesh.area(), 1e-12);
        EXPECT_TRUE(finer.borders.empty()) << cloud.name;
        EXPECT_EQ(finer.positions.topRows(mesh.positions.rows()), mesh.positions);
        EXPECT_EQ(finer.places, mesh.places);
        const MeshEdges edges(finer.triangles);
        for (Index e = 0; e < edges.size(); ++e) EXPECT_EQ(edges[e].size(), 2u);
    }
}

TEST(Subdivision, FollowsBorders) {
    const Mesh finer = subdivided(make_mesh(mesh_shapes::grid(2)), {.longest = 0.2}).mesh;
    ASSERT_EQ(finer.borders.size(), 1u);
    EXPECT_GT(finer.borders[0].size(), 16u);
}

TEST(Subdivision, LeavesWhatIsFineAndEndsInTime) {
    const Mesh mesh = make_mesh(mesh_shapes::icosphere(3));
    EXPECT_FALSE(has_long_edges(mesh, {.longest = 1.0}));
    EXPECT_TRUE(has_long_edges(mesh, {.longest = 0.01}));
    EXPECT_FALSE(has_long_edges(mesh, {.longest = 0.01, .most_places = 2000}));
    EXPECT_EQ(subdivided(mesh, {.longest = 1.0}).mesh.triangles, mesh.triangles);
    EXPECT_LE(subdivided(mesh, {.longest = 1e-6, .most_places = 5000}).mesh.positions.rows(), 5000);
}

TEST(Subdivision, CarriesValues) {
    const Mesh mesh = make_mesh(mesh_shapes::grid(3));
    const Subdivision finer = subdivided(mesh, {.longest = 0.1});
    EXPECT_EQ(finer.ends.size(), to_size(finer.mesh.positions.rows() - mesh.positions.rows()));
    EXPECT_EQ(extended(mesh.positions, finer.ends), finer.mesh.positions);
}

TEST(Example, Subdivision) {
    const Mesh mesh = make_mesh(mesh_shapes::cube());
    // --- example
    const Subdivision finer = subdivided(mesh, {.longest = 0.1});
    const Positions places = extended(mesh.positions, finer.ends);
    // --- end of the example
    EXPECT_LE(longest_edge(finer.mesh), 0.1 * std::sqrt(mesh.area()));
    EXPECT_EQ(places, finer.mesh.positions);
}

}  // namespace
}  // namespace pointmorph

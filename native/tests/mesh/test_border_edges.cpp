#include "mesh/border_edges.hpp"

#include <gtest/gtest.h>

#include "mesh_shapes.hpp"

namespace pointmorph {
namespace {

TEST(BorderEdges, HoldWhatLiesOnABorderAndNothingElse) {
    const Mesh mesh = make_mesh(mesh_shapes::grid(4));
    const BorderEdges borders(mesh);
    ASSERT_FALSE(borders.empty());
    Progress progress;
    const TriangleTree tree(mesh.positions, mesh.triangles, progress);
    const double end = mesh.positions.col(0).maxCoeff(), quarter = 0.5 * end;
    // Beyond a side and a corner, on them, above the middle of faces, edges and vertices inside.
    const auto is_held = [&](double x, double y, double z) {
        return borders.hold(tree.closest(Vector3(x, y, z)));
    };
    EXPECT_TRUE(is_held(2.0 * end, 0.3 * end, 0.1));
    EXPECT_TRUE(is_held(2.0 * end, 2.0 * end, -0.1));
    EXPECT_TRUE(is_held(end, 0.3 * end, 0.0));
    EXPECT_TRUE(is_held(end, end, 0.0));
    EXPECT_FALSE(is_held(0.9 * end, 0.3 * end, 0.2));
    EXPECT_FALSE(is_held(quarter, 0.3 * end, 0.2));
    EXPECT_FALSE(is_held(quarter, quarter, 0.2));
}

TEST(BorderEdges, AreNoneOfAClosedMesh) {
    const Mesh mesh = make_mesh(mesh_shapes::cube());
    EXPECT_TRUE(BorderEdges(mesh).empty());
}

}  // namespace
}  // namespace pointmorph

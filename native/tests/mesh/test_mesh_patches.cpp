#include "mesh/mesh_patches.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

#include "mesh/creases.hpp"
#include "mesh_shapes.hpp"
#include "processor_time.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// A mesh with its sheet; its places go up and down.
struct Pleated {
    Mesh mesh;
    Progress progress;
    ElasticSheet sheet;
    Positions x;

    explicit Pleated(const Cloud& cloud)
        : mesh(make_mesh(cloud)),
          sheet(mesh.positions, mesh.triangles, progress),
          x(mesh.positions) {
        for (Index p = 0; p < x.rows(); ++p) x(p, 2) += p % 2 == 0 ? 0.5 : -0.5;
    }
    std::vector<char> none() const { return std::vector<char>(to_size(x.rows()), 0); }
};

std::vector<Index> every(Index step, const Mesh& mesh) {
    std::vector<Index> faces;
    for (Index f = 0; f < mesh.triangles.rows(); f += step) faces.push_back(f);
    return faces;
}

TEST(MeshPatches, AreWhatLiesAround) {
    const Pleated ball(mesh_shapes::icosphere(3));
    std::vector<char> is_fixed = ball.none();
    for (std::size_t v = 0; v < is_fixed.size(); v += 5) is_fixed[v] = 1;
    const std::vector<Index> faces{3, 4, 200, 201, 777, 1100};
    for (const int rings : {0, 1, 2, 4}) {
        std::set<Index> inside(faces.begin(), faces.end());
        const auto shares_a_corner = [&](Index f, Index g) {
            for (const Index v : ball.mesh.triangles.row(f))
                if ((ball.mesh.triangles.row(g).array() == v).any()) return true;
            return false;
        };
        for (int ring = 0; ring < rings; ++ring) {
            const std::set<Index> before = inside;
            for (Index f = 0; f < ball.mesh.triangles.rows(); ++f)
                if (std::ranges::any_of(before, [&](Index g) { return shares_a_corner(f, g); }))
                    inside.insert(f);
        }
        std::set<Index> vertices;
        for (Index v = 0; v < ball.x.rows(); ++v)
            if (!is_fixed[to_size(v)] && std::ranges::all_of(ball.sheet.around(v), [&](Index c) {
                    return inside.contains(c / 3);
                }))
                vertices.insert(v);
        std::set<Index> found_faces, found_vertices;
        for (const MeshPatch& patch :
             patches_around(ball.mesh, ball.sheet, faces, is_fixed, rings)) {
            EXPECT_TRUE(std::ranges::is_sorted(patch.faces));
            EXPECT_TRUE(std::ranges::is_sorted(patch.vertices));
            for (const Index f : patch.faces) EXPECT_TRUE(found_faces.insert(f).second);
            for (const Index v : patch.vertices) EXPECT_TRUE(found_vertices.insert(v).second);
        }
        EXPECT_EQ(found_faces, inside);
        EXPECT_EQ(found_vertices, vertices);
    }
}

TEST(MeshPatches, TakeNoLongerWhereAllFacesMeetAtAVertex) {
    SKIP_WHERE_WATCHED();
    const Pleated fan_of_many(mesh_shapes::fan(20000)), grid(mesh_shapes::grid(100));
    const auto time = [](const Pleated& of) {
        const std::vector<Index> faces = every(2, of.mesh);
        return processor_time(
            [&] { EXPECT_FALSE(patches_around(of.mesh, of.sheet, faces, of.none(), 2).empty()); });
    };
    // With all faces around a vertex asked for each of these, it is some thousand times as long.
    EXPECT_LT(time(fan_of_many), 20.0 * time(grid));
}

TEST(Creases, TakeNoLongerWhereAllFacesMeetAtAVertex) {
    SKIP_WHERE_WATCHED();
    Pleated fan_of_many(mesh_shapes::fan(20000)), grid(mesh_shapes::grid(100));
    const auto time_to_find = [](Pleated& of) {
        return processor_time(
            [&] { EXPECT_FALSE(creased_faces(of.mesh, of.sheet, of.x, of.progress).empty()); });
    };
    EXPECT_LT(time_to_find(fan_of_many), 20.0 * time_to_find(grid));
    const auto time_to_take_back = [](Pleated& of) {
        return processor_time([&] {
            Positions x = of.x;
            take_back_creases(of.mesh, of.sheet, of.mesh.positions, {}, x, of.progress);
            EXPECT_NE(x, of.x);
        });
    };
    EXPECT_LT(time_to_take_back(fan_of_many), 20.0 * time_to_take_back(grid));
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/morph/denser_mesh.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <string>
#include <string_view>
#include <vector>

#include "mesh/mesh_edges.hpp"
#include "mesh_shapes.hpp"
#include "morph/morphs.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/mesh/closest_point.hpp"
#include "pointmorph/morph/morph.hpp"
#include "registration/watched_options.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

Morph morph_of(Cloud source, Cloud target, std::vector<Feature> features = {},
               const MorphOptions& options = {}) {
    Progress progress;
    MorphInput input{
        .source = std::move(source), .target = std::move(target), .features = std::move(features)};
    return {std::move(input), options, progress};
}

/// Four corners of a cube, on a ball: so the pose, which takes longest, needn't be searched for.
std::vector<Feature> marked_corners(const Cloud& cube, const Cloud& ball) {
    std::vector<Feature> corners;
    for (const Index row : {0, 2, 5, 7}) {
        const auto corner = cube.positions.row(row);
        const Index partner = row_near(ball, corner.x(), corner.y(), corner.z());
        corners.push_back(point_feature(std::to_string(row), row, partner));
    }
    return corners;
}

/// Positions of all vertices on their own model.
Positions at_rest(const DenserMesh& mesh, const Positions& given) {
    Positions rest(mesh.positions.rows(), 3);
    rest.topRows(given.rows()) = given;
    for (std::size_t k = 0; k < mesh.ends.size(); ++k) {
        const auto& [a, b] = mesh.ends[k];
        const auto row = given.rows() + static_cast<Eigen::Index>(k);
        EXPECT_LT(std::max(a, b), row);
        rest.row(row) = 0.5 * (rest.row(a) + rest.row(b));
    }
    return rest;
}

double area(const Positions& x, const Triangles& faces) {
    double sum = 0.0;
    for (Index f = 0; f < faces.rows(); ++f) {
        const Vector3 u = (x.row(faces(f, 1)) - x.row(faces(f, 0))).transpose();
        const Vector3 v = (x.row(faces(f, 2)) - x.row(faces(f, 0))).transpose();
        sum += 0.5 * u.cross(v).norm();
    }
    return sum;
}

TEST(DenserMesh, ACubeBecomesABallWithoutGaps) {
    SKIP_WHERE_WATCHED();
    const Cloud cube = mesh_shapes::cube();
    const Morph morph = morph_of(cube, mesh_shapes::icosphere(4));
    Progress progress;
    constexpr double kTolerance = 0.004;
    const DenserMesh mesh = morph.denser(true, {.tolerance = kTolerance}, progress);
    EXPECT_GT(mesh.positions.rows(), 100);
    EXPECT_LT(mesh.positions.rows(), 5000);
    const MeshEdges edges(mesh.faces);
    for (Index e = 0; e < edges.size(); ++e) ASSERT_EQ(edges[e].size(), 2u);
    EXPECT_NEAR(area(at_rest(mesh, cube.positions), mesh.faces), 24.0, 1e-9);
    // Nearly all faces are as near to the ball as was asked for.
    const double root = std::sqrt(4.0 * std::numbers::pi);
    Index off = 0;
    for (Index f = 0; f < mesh.faces.rows(); ++f) {
        const Eigen::RowVector3d middle =
            (mesh.positions.row(mesh.faces(f, 0)) + mesh.positions.row(mesh.faces(f, 1)) +
             mesh.positions.row(mesh.faces(f, 2))) /
            3.0;
        off += std::abs(middle.norm() - 1.0) > kTolerance * root + 0.003;
        EXPECT_LT(mesh.polygons[to_size(f)], cube.faces.size());
    }
    EXPECT_LE(off, mesh.faces.rows() / 50);
}

TEST(DenserMesh, SaysHowFarItIs) {
    SKIP_WHERE_WATCHED();
    const Cloud cube = mesh_shapes::cube(), ball = mesh_shapes::icosphere(3);
    const Morph morph = morph_of(cube, ball, marked_corners(cube, ball));
    std::vector<double> said;
    Progress progress(
        [&](std::string_view, double fraction) {
            said.push_back(fraction);
            return true;
        },
        std::chrono::milliseconds(0));
    morph.denser(true, {.tolerance = 0.01}, progress);
    ASSERT_FALSE(said.empty());
    const auto between = [](double fraction) { return fraction > 0.1 && fraction < 0.9; };
    EXPECT_GT(2 * std::ranges::count_if(said, between), std::ssize(said));
}

TEST(DenserMesh, GrowsOnlyWhereItHasTo) {
    SKIP_WHERE_WATCHED();
    const auto bump = [](double x, double y) {
        return 0.5 * std::exp(-30.0 * ((x - 0.5) * (x - 0.5) + (y - 0.5) * (y - 0.5)));
    };
    const Cloud source = mesh_shapes::grid(12), target = mesh_shapes::terrain(80, bump);
    const Morph morph = morph_of(
        source, target,
        {point_feature("a", 0, 0), point_feature("b", 12, 80), point_feature("c", 13 * 12, 81 * 80),
         point_feature("d", 13 * 13 - 1, 81 * 81 - 1)});
    Progress progress;
    const DenserMesh mesh = morph.denser(true, {}, progress);
    const Positions rest = at_rest(mesh, source.positions);
    Index near = 0, far = 0;
    for (Eigen::Index v = source.size(); v < rest.rows(); ++v)
        ((rest.row(v) - Eigen::RowVector3d(0.5, 0.5, 0.0)).norm() < 0.7 ? near : far) += 1;
    EXPECT_GT(near, 20);
    EXPECT_LT(far, near / 4);
    EXPECT_EQ(mesh.positions.row(0), target.positions.row(0));
    EXPECT_NEAR(area(rest, mesh.faces), 4.0, 1e-9);
}

/// The mean distance of the target's vertices from the faces.
double missed(const DenserMesh& mesh, const Cloud& target) {
    Progress progress;
    const TriangleTree tree(mesh.positions, mesh.faces, progress);
    double sum = 0.0;
    for (Eigen::Index v = 0; v < target.positions.rows(); ++v)
        sum += std::sqrt(tree.closest(target.positions.row(v).transpose()).squared_distance);
    return sum / static_cast<double>(target.positions.rows());
}

TEST(DenserMesh, GrowsInProportionToWhatItShows) {
    SKIP_WHERE_WATCHED();
    // Sharp edges, which no halving meets: they mustn't be cut to dust.
    const Cloud block = mesh_shapes::moved(
        mesh_shapes::cube(),
        Vector3(1.0, 1.3, 0.4).asDiagonal() *
            Eigen::AngleAxisd(0.4, Vector3(1, 2, 3).normalized()).toRotationMatrix(),
        Vector3::Zero());
    Progress progress;
    double last = 1.0;
    for (const int levels : {1, 2, 3}) {
        const Cloud ball = mesh_shapes::icosphere(levels);
        const Morph morph = morph_of(ball, block);
        const DenserMesh mesh = morph.denser(true, {}, progress);
        EXPECT_GT(mesh.positions.rows(), ball.size());
        EXPECT_LE(mesh.positions.rows(), ball.size() + 500);
        const double left = missed(mesh, block);
        EXPECT_LT(left, 0.06);
        EXPECT_LT(left, last + 0.015);
        last = left;
    }
}

TEST(DenserMesh, SeamsStayClosed) {
    const Cloud cube = mesh_shapes::split(mesh_shapes::cube());
    const Cloud ball = mesh_shapes::icosphere(is_watched() ? 2 : 3);
    MorphOptions options;
    options.refinement = lighter_where_watched();
    const Morph morph = morph_of(cube, ball, marked_corners(cube, ball), options);
    Progress progress;
    const DenserMesh mesh = morph.denser(true, {.tolerance = 0.05, .rounds = 1}, progress);
    const Positions rest = at_rest(mesh, cube.positions);
    ASSERT_FALSE(mesh.ends.empty());
    // Vertices at one place end at one place.
    Index shared = 0;
    for (Eigen::Index v = cube.size(); v < rest.rows(); ++v)
        for (Eigen::Index w = 0; w < v; ++w) {
            if (rest.row(v) != rest.row(w)) continue;
            ++shared;
            ASSERT_EQ(mesh.positions.row(v), mesh.positions.row(w));
        }
    EXPECT_GT(shared, 0);
}

TEST(DenserMesh, IsTheMeshItselfWhereThatFits) {
    SKIP_WHERE_WATCHED();
    const Cloud ball = mesh_shapes::icosphere(3);
    const Morph morph = morph_of(ball, ball);
    Progress progress;
    const DenserMesh mesh = morph.denser(false, {.tolerance = 0.01}, progress);
    EXPECT_TRUE(mesh.ends.empty());
    EXPECT_EQ(mesh.faces.rows(), ball.faces.size());
    EXPECT_LT((mesh.positions - ball.positions).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(DenserMesh, TakesNoBareClouds) {
    SKIP_WHERE_WATCHED();
    Cloud bare = mesh_shapes::icosphere(3);
    bare.faces = {};
    const Morph morph = morph_of(mesh_shapes::icosphere(3), bare);
    Progress progress;
    EXPECT_THROW(morph.denser(false, {}, progress), CloudError);
}

TEST(Example, DenserMesh) {
    SKIP_WHERE_WATCHED();
    const Cloud cube = mesh_shapes::cube(), ball = mesh_shapes::icosphere(3);
    const Morph morph = morph_of(cube, ball, marked_corners(cube, ball));
    Progress progress;
    // --- example
    const DenserMesh mesh = morph.denser(true, {.tolerance = 0.02}, progress);  // of the source
    const auto [a, b] = mesh.ends.front();  // the first new vertex is halfway of these
    const Vector3 place = mesh.positions.row(0).transpose();  // of the first one, on the target
    // --- end of the example
    EXPECT_EQ(mesh.positions.rows(), cube.size() + to_index(mesh.ends.size()));
    EXPECT_LT(mesh.positions.rows(), 1000);
    EXPECT_NE(a, b);
    EXPECT_LT(std::max(a, b), cube.size());
    EXPECT_NEAR(place.norm(), 1.0, 1e-6);
}

}  // namespace
}  // namespace pointmorph

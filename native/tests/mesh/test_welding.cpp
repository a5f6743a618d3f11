#include "mesh/welding.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "mesh/mesh_edges.hpp"
#include "mesh_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

Cloud shifted(Cloud cloud, const Vector3& by) {
    return mesh_shapes::moved(std::move(cloud), Matrix3::Identity(), by);
}

/// Only the faces whose middle passes.
template <class Which>
Cloud some_of(const Cloud& cloud, Which&& which) {
    Cloud result = cloud;
    result.faces = {};
    for (Index f = 0; f < cloud.faces.size(); ++f) {
        Vector3 middle = Vector3::Zero();
        for (const Index corner : cloud.faces[f])
            middle += cloud.positions.row(corner).transpose() /
                      static_cast<double>(cloud.faces[f].size());
        if (which(middle))
            mesh_shapes::add_face(result.faces, {cloud.faces[f].begin(), cloud.faces[f].end()});
    }
    return result;
}

Index most_faces_at_an_edge(const Mesh& mesh) {
    const MeshEdges edges(mesh.triangles);
    std::size_t most = 0;
    for (Index e = 0; e < edges.size(); ++e) most = std::max(most, edges[e].size());
    return to_index(most);
}

/// That of the spot where each vertex lies, whatever is connected.
void expect_at_home(const Mesh& mesh, const Cloud& cloud) {
    const Positions there = mesh.unit.restore(gather(mesh.positions, mesh.places));
    EXPECT_LT((there - cloud.positions).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(Welding, CubesThatTouchStayTwoWhateverTheirVertices) {
    // At a corner, along an edge, and with a whole face.
    for (const Vector3& by : {Vector3(2, 2, 2), Vector3(2, 2, 0), Vector3(2, 0, 0)}) {
        const Cloud both =
            mesh_shapes::together(mesh_shapes::cube(), shifted(mesh_shapes::cube(), by));
        const Cloud inside_out =
            mesh_shapes::moved(both, Vector3(-1, 1, 1).asDiagonal(), Vector3::Zero());
        for (const Cloud& cloud :
             {both, mesh_shapes::split(both), mesh_shapes::split(inside_out)}) {
            const Mesh mesh = make_mesh(cloud);
            EXPECT_EQ(mesh.positions.rows(), 16);
            EXPECT_EQ(mesh.part_areas.size(), 2);
            EXPECT_TRUE(mesh.borders.empty());
            EXPECT_EQ(most_faces_at_an_edge(mesh), 2);
            expect_at_home(mesh, cloud);
        }
    }
}

TEST(Welding, AnEyeThatTouchesItsSocketStaysAPart) {
    // A head with a hole, and a lens that has one vertex of the hole's border.
    const Cloud head =
        some_of(mesh_shapes::icosphere(3), [](const Vector3& p) { return p.z() < 0.9; });
    const Mesh alone = make_mesh(head);
    ASSERT_EQ(alone.borders.size(), 1u);
    const Vector3 touch = alone.unit.restore(alone.positions).row(alone.borders[0][0]).transpose();
    Cloud eye = shifted(mesh_shapes::grid(4), touch - Vector3(-1, -1, 0));
    eye.positions.row(0) = touch.transpose();
    const Cloud both = mesh_shapes::together(head, eye);
    for (const Cloud& cloud : {both, mesh_shapes::split(both)}) {
        const Mesh mesh = make_mesh(cloud);
        EXPECT_EQ(mesh.part_areas.size(), 2);
        EXPECT_EQ(mesh.borders.size(), 2u);
        expect_at_home(mesh, cloud);
    }
}

TEST(Welding, ClosesSeamsOfHalvesAndTiles) {
    const auto up = [](const Vector3& p) { return p.z() > 0.0; };
    const auto down = [&](const Vector3& p) { return !up(p); };
    const Cloud ball = mesh_shapes::icosphere(3);
    const Mesh halves = make_mesh(mesh_shapes::together(some_of(ball, up), some_of(ball, down)));
    EXPECT_EQ(halves.part_areas.size(), 1);
    EXPECT_TRUE(halves.borders.empty());
    const Mesh tiles = make_mesh(
        mesh_shapes::together(mesh_shapes::grid(4), shifted(mesh_shapes::grid(4), {2, 0, 0})));
    EXPECT_EQ(tiles.part_areas.size(), 1);
    EXPECT_EQ(tiles.borders.size(), 1u);
    EXPECT_EQ(tiles.positions.rows(), 9 * 5);
}

/// Each coordinate by up to `most` beside where it was.
Cloud rounded(Cloud cloud, double most) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> beside(-most, most);
    cloud.positions = cloud.positions.unaryExpr([&](double x) { return x + beside(random); });
    return cloud;
}

TEST(Welding, ClosesSeamsThatDifferByRounding) {
    const Cloud cloud = rounded(mesh_shapes::split(mesh_shapes::icosphere(3)), 2e-6);
    const Mesh mesh = make_mesh(cloud);
    EXPECT_EQ(mesh.positions.rows(), 642);
    EXPECT_EQ(mesh.part_areas.size(), 1);
    EXPECT_TRUE(mesh.borders.empty());
    const Positions there = mesh.unit.restore(gather(mesh.positions, mesh.places));
    EXPECT_LT((there - cloud.positions).cwiseAbs().maxCoeff(), 4.1e-6);
}

TEST(Welding, KeepsWhatIsFartherApartThanByRounding) {
    // Sheets that end beside each other and above each other, and boxes that all but touch.
    for (const Vector3& by : {Vector3(2.001, 0, 0), Vector3(0, 0, 0.001)})
        EXPECT_EQ(make_mesh(mesh_shapes::together(mesh_shapes::grid(4),
                                                  shifted(mesh_shapes::grid(4), by)))
                      .part_areas.size(),
                  2);
    const Cloud boxes =
        mesh_shapes::together(mesh_shapes::cube(), shifted(mesh_shapes::cube(), {2 + 1e-6, 0, 0}));
    EXPECT_EQ(make_mesh(boxes).part_areas.size(), 2);
    EXPECT_EQ(make_mesh(boxes).positions.rows(), 16);
}

TEST(Welding, KeepsTheSmallestFaces) {
    // Their edges are as short as rounding elsewhere, and the sheet ends along them.
    Cloud strip = mesh_shapes::grid(4);
    strip.positions.col(0) *= 1e-5;
    const Mesh mesh = make_mesh(mesh_shapes::together(mesh_shapes::icosphere(1), strip));
    EXPECT_EQ(mesh.positions.rows(), 42 + 25);
    EXPECT_EQ(mesh.part_areas.size(), 2);
}

TEST(Welding, KeepsStripsThatAreThinnerThanRounding) {
    Cloud strip = mesh_shapes::grid(20);
    strip.positions.col(0) *= 3e-6;
    EXPECT_EQ(make_mesh(strip).positions.rows(), 21 * 21);
}

TEST(Welding, WeldsSplitFacesThatDontAgree) {
    const Cloud cloud = mesh_shapes::split(
        mesh_shapes::reversed(mesh_shapes::icosphere(2), [](Index f) { return f % 3 == 0; }));
    const Mesh mesh = make_mesh(cloud);
    EXPECT_EQ(mesh.part_areas.size(), 1);
    EXPECT_EQ(mesh.positions.rows(), 162);
    EXPECT_TRUE(mesh.borders.empty());
}

TEST(Welding, PartsSheetsThatMeetAlongALineOfThree) {
    const Matrix3 upright = Eigen::AngleAxisd(0.5 * EIGEN_PI, Vector3::UnitY()).toRotationMatrix();
    Cloud wall = mesh_shapes::moved(mesh_shapes::grid(3), upright, {1, 0, 1});
    wall.positions = wall.positions.unaryExpr(  // the same spots to the bit
        [](double x) { return std::round(3.0 * x) / 3.0; });
    Cloud floor =
        mesh_shapes::together(mesh_shapes::grid(3), shifted(mesh_shapes::grid(3), {2, 0, 0}));
    floor.positions = floor.positions.unaryExpr([](double x) { return std::round(3.0 * x) / 3.0; });
    EXPECT_EQ(make_mesh(floor).part_areas.size(), 1);
    const Mesh mesh = make_mesh(mesh_shapes::together(floor, wall));
    EXPECT_EQ(most_faces_at_an_edge(mesh), 2);
    EXPECT_EQ(mesh.part_areas.size(), 3);
}

/// Triangles around one edge, none with a vertex of another; `along` of them run the same way.
Cloud book(Index pages, Index along) {
    Cloud cloud;
    cloud.positions.resize(3 * pages, 3);
    for (Index k = 0; k < pages; ++k) {
        const double angle = 2.0 * std::numbers::pi * k / pages;
        cloud.positions.row(3 * k) << 0.0, 0.0, k < along ? 0.0 : 1.0;
        cloud.positions.row(3 * k + 1) << 0.0, 0.0, k < along ? 1.0 : 0.0;
        cloud.positions.row(3 * k + 2) << std::cos(angle), std::sin(angle), 0.5;
        mesh_shapes::add_face(cloud.faces, {3 * k, 3 * k + 1, 3 * k + 2});
    }
    return cloud;
}

TEST(Welding, TakesAnEdgeWithVeryManyTriangles) {
    // Counted or compared one with another, these would take minutes.
    const Index pages = is_watched() ? 20000 : 200000;
    EXPECT_EQ(make_mesh(book(pages, pages / 2 - 1)).part_areas.size(), pages);
}

/// A triangle at the axis of a book, one way or the other.
struct Page {
    double angle;
    bool is_along;
};
Cloud book(std::span<const Page> pages) {
    Cloud cloud = book(to_index(pages.size()), 0);
    for (Index k = 0; k < to_index(pages.size()); ++k) {
        const auto [angle, is_along] = pages[to_size(k)];
        cloud.positions(3 * k, 2) = is_along ? 0.0 : 1.0;
        cloud.positions(3 * k + 1, 2) = is_along ? 1.0 : 0.0;
        const double width = 1.0 + static_cast<double>(k) / static_cast<double>(pages.size());
        cloud.positions.row(3 * k + 2) << width * std::cos(angle), width * std::sin(angle), 0.5;
    }
    return cloud;
}

/// The page behind each of those that run along, found by comparing all; nothing where they can't
/// all be paired.
std::vector<std::pair<Index, Index>> pairs_of(std::span<const Page> pages, bool inward) {
    std::vector<std::pair<Index, Index>> pairs;
    std::vector<char> is_taken(pages.size(), 0);
    for (std::size_t i = 0; i < pages.size(); ++i) {
        if (!pages[i].is_along) continue;
        std::pair<double, std::size_t> best(7.0, 0);
        for (std::size_t j = 0; j < pages.size(); ++j) {
            if (pages[j].is_along) continue;
            constexpr double kAll = 2.0 * std::numbers::pi;
            const double way = (pages[j].angle - pages[i].angle) * (inward ? 1.0 : -1.0);
            const double ahead = way - kAll * std::floor(way / kAll), apart = kAll - ahead;
            const double least = std::min(ahead, apart);
            best = std::min(best, std::pair(least < 1e-6 ? kAll - least : ahead, j));
        }
        if (std::exchange(is_taken[best.second], 1)) return {};
        pairs.emplace_back(to_index(i), to_index(best.second));
    }
    return pairs;
}

TEST(Welding, PairsEachPageWithTheNextThatRunsTheOtherWay) {
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> number(0.0, 1.0);
    Index paired = 0;
    for (int trial = 0; trial < 300; ++trial) {
        const std::size_t count = 4 + 2 * static_cast<std::size_t>(trial % 4);
        std::vector<Page> pages;
        for (std::size_t k = 0; k < count; ++k)
            pages.push_back({2.0 * std::numbers::pi * number(random), k % 2 == 0});
        if (trial % 3 > 0) {  // in turn
            std::vector<double> angles;
            for (const Page& page : pages) angles.push_back(page.angle);
            std::ranges::sort(angles);
            for (std::size_t k = 0; k < count; ++k) pages[k].angle = angles[k];
            // Two that lie on each other have nothing between them.
            if (trial % 3 == 2) pages[1].angle = pages[0].angle;
        }
        std::ranges::shuffle(pages, random);
        // The first tells which way is along.
        std::iter_swap(pages.begin(), std::ranges::find(pages, true, &Page::is_along));
        const Cloud cloud = book(pages);
        const Positions x = normalization(cloud.positions).apply(cloud.positions);
        double volume = 0.0;
        for (Eigen::Index k = 0; k < x.rows(); k += 3)
            volume += x.row(k).dot(x.row(k + 1).cross(x.row(k + 2)));
        const auto pairs = pairs_of(pages, volume < 0.0);
        paired += pairs.empty() ? 0 : 1;
        const Mesh mesh = make_mesh(cloud);
        EXPECT_EQ(mesh.part_areas.size(), to_index(pages.size() - pairs.size())) << trial;
        for (const auto& [one, other] : pairs)
            for (Index k = 0; k < 2; ++k)
                EXPECT_EQ(mesh.places[to_size(3 * one + k)],
                          mesh.places[to_size(3 * other + 1 - k)])
                    << trial;
    }
    EXPECT_GT(paired, 100);
}

TEST(Welding, TakesAnEdgeWhoseManyTrianglesRunInTurn) {
    // Each compared with every other, these would take minutes.
    const Index count = is_watched() ? 20000 : 200000;
    std::vector<Page> pages;
    for (Index k = 0; k < count; ++k)
        pages.push_back({2.0 * std::numbers::pi * k / count, k % 2 == 0});
    EXPECT_EQ(make_mesh(book(pages)).part_areas.size(), count / 2);
}

TEST(Welding, CanBeCancelledAtAnEdge) {
    const Cloud cloud = book(4000, 2000);
    Mesh mesh;
    mesh.unit = normalization(cloud.positions);
    weld(cloud.positions, mesh);
    mesh.vertices.resize(4000, 3);
    for (Index c = 0; c < mesh.vertices.size(); ++c) mesh.vertices(c / 3, c % 3) = c;
    mesh.triangles =
        mesh.vertices.unaryExpr([&](Index vertex) { return mesh.places[to_size(vertex)]; });
    Progress cancel([](std::string_view, double) { return false; });
    EXPECT_THROW(part_what_touches(cloud.faces, MeshEdges(mesh.triangles), mesh, cancel),
                 Cancelled);
}

TEST(Welding, KeepsWhatAVertexOfItsOwnJoins) {
    Cloud both =
        mesh_shapes::together(mesh_shapes::cube(), shifted(mesh_shapes::cube(), {2, 2, 2}));
    std::ranges::replace(both.faces.corners, 8, 7);  // the corner that they share
    const Mesh mesh = make_mesh(both);
    EXPECT_EQ(mesh.part_areas.size(), 1);
    EXPECT_EQ(mesh.places[7], mesh.places[8]);  // without faces
}

TEST(Welding, ChangesNothingWhereNothingTouches) {
    Mesh mesh;
    const Cloud cloud = mesh_shapes::split(mesh_shapes::icosphere(1));
    mesh.unit = normalization(cloud.positions);
    weld(cloud.positions, mesh);
    const Mesh whole = make_mesh(cloud);
    EXPECT_EQ(mesh.places, whole.places);
    EXPECT_EQ(mesh.positions, whole.positions);
}

}  // namespace
}  // namespace pointmorph

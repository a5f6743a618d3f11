#include "registration/crossed_limbs.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/registration/pose.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// A rod with round ends.
struct Rod {
    Vector3 from, to;
    double radius;

    Vector3 nearest(const Vector3& place) const {
        const Vector3 along = to - from;
        const double share = (place - from).dot(along) / along.squaredNorm();
        return from + std::clamp(share, 0.0, 1.0) * along;
    }
    double area() const { return 2.0 * EIGEN_PI * radius * ((to - from).norm() + 2.0 * radius); }
};

/// The surface of rods that run into each other, and the rod of each point.
struct Figure {
    std::vector<Rod> rods;
    Positions positions;
    Normals normals;
    std::vector<int> rod;

    Figure(std::vector<Rod> of, Index count, unsigned seed) : rods(std::move(of)) {
        std::mt19937 random(seed);
        std::normal_distribution<double> normal;
        std::uniform_real_distribution<double> uniform(0.0, 1.0);
        double all = 0.0;
        for (const Rod& its : rods) all += its.area();
        positions.resize(count, 3);
        normals.resize(count, 3);
        while (to_index(rod.size()) < count) {
            double left = all * uniform(random);
            std::size_t k = 0;
            while (k + 1 < rods.size() && left > rods[k].area()) left -= rods[k++].area();
            const Rod& its = rods[k];
            const Vector3 along = (its.to - its.from).normalized();
            Vector3 out = Vector3(normal(random), normal(random), normal(random)).normalized(), at;
            if (left < 4.0 * EIGEN_PI * its.radius * its.radius) {
                at = out.dot(along) < 0.0 ? its.from : its.to;
            } else {
                out = (out - out.dot(along) * along).normalized();
                at = its.from + uniform(random) * (its.to - its.from);
            }
            const Vector3 place = at + its.radius * out;
            if (std::ranges::any_of(rods, [&](const Rod& other) {
                    return (place - other.nearest(place)).norm() < other.radius - 1e-9;
                }))
                continue;
            positions.row(to_index(rod.size())) = place.transpose();
            normals.row(to_index(rod.size())) = out.transpose();
            rod.push_back(static_cast<int>(k));
        }
    }
};

constexpr double kThin = 0.1;

/// A trunk with a neck and two legs.
std::vector<Rod> trunk_with(const Vector3& hind_foot, const Vector3& fore_foot) {
    return {{{-1.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, 0.3},
            {{-0.9, 0.0, 0.0}, hind_foot, kThin},
            {{0.9, 0.0, 0.0}, fore_foot, kThin},
            {{1.0, 0.0, 0.0}, {1.6, 0.0, 0.8}, 0.15}};
}
const Vector3 kHind(0.5, 0.0, -1.7), kFore(-0.5, 0.0, -1.7);

/// Its surface as a graph, and centers where crossings are looked for.
struct Surface {
    SurfaceGraph graph;
    std::vector<Index> centers;
    double unit;

    explicit Surface(const Positions& positions, const Normals& normals) {
        Progress progress;
        const KdTree<3> tree(positions);
        graph = surface_graph(tree, normals, {}, progress);
        centers = poisson_disk_subset(tree, normals, {}, 250, progress).rows;
        unit = std::sqrt(estimated_area(tree));
    }
    SurfaceGraph cut(const Positions& positions) const {
        return without_crossings(positions, unit, graph, centers);
    }
};

bool hangs_together(const SurfaceGraph& graph) {
    return GeodesicSearch(graph).from(0).size() == to_size(graph.size());
}

double between(const SurfaceGraph& graph, Index from, Index to) {
    GeodesicSearch search(graph);
    for (const auto& [row, distance] : search.from(from))
        if (row == to) return distance;
    return 1e300;
}

TEST(CrossedLimbs, AreNotJoinedWhereTheyCross) {
    for (const unsigned seed : {1u, 2u, 3u}) {
        const Figure figure(trunk_with(kHind, kFore), 5000, seed);
        const Surface surface(figure.positions, figure.normals);
        const SurfaceGraph cut = surface.cut(figure.positions);
        const Index foot = shapes::nearest_row(figure.positions, kHind),
                    fore_foot = shapes::nearest_row(figure.positions, kFore),
                    hip = shapes::nearest_row(figure.positions, {-0.77, 0.1, -0.3});
        EXPECT_LT(between(surface.graph, foot, fore_foot), 2.0);  // through the crossing
        // Up one leg, along the trunk and down the other.
        EXPECT_GT(between(cut, foot, fore_foot), 4.0);
        EXPECT_LT(between(cut, foot, fore_foot), 7.0);
        const double leg = (kHind - Vector3(-0.77, 0.0, -0.3)).norm();
        EXPECT_NEAR(between(cut, foot, hip), leg, 0.15 * leg);
        EXPECT_TRUE(hangs_together(cut));
    }
}

TEST(CrossedLimbs, LoseNothingElsewhere) {
    const Figure figure(trunk_with(kHind, kFore), 5000, 4);
    const Surface surface(figure.positions, figure.normals);
    const SurfaceGraph cut = surface.cut(figure.positions);
    const Vector3 crossing(0.0, 0.0, -1.093);
    std::size_t dropped = 0;
    for (Index i = 0; i < cut.size(); ++i) {
        const auto of = [&](const SurfaceGraph& graph) {
            return std::vector<Index>(graph.neighbors.begin() + graph.offsets[to_size(i)],
                                      graph.neighbors.begin() + graph.offsets[to_size(i) + 1]);
        };
        const std::vector<Index> before = of(surface.graph), after = of(cut);
        ASSERT_TRUE(std::ranges::includes(before, after));
        for (const Index j : before) {
            if (std::ranges::binary_search(after, j)) continue;
            ++dropped;
            EXPECT_LT((figure.positions.row(j).transpose() - crossing).norm(), 0.16 * surface.unit);
        }
    }
    EXPECT_GT(dropped, 100u);
    EXPECT_TRUE(hangs_together(cut));
}

TEST(CrossedLimbs, AreToldAtAnyScaleAndTurnedAnyWay) {
    const Figure figure(trunk_with(kHind, kFore), 5000, 5);
    const Matrix3 turn = 7.0 * shapes::rotation(3);
    const Positions positions = figure.positions * turn.transpose();
    const Normals normals = figure.normals * (turn / 7.0).transpose();
    const Surface surface(figure.positions, figure.normals);
    const SurfaceGraph cut = surface.cut(figure.positions);
    Surface other = surface;
    other.unit *= 7.0;
    EXPECT_EQ(other.cut(positions).neighbors, cut.neighbors);
    EXPECT_LT(cut.neighbors.size(), surface.graph.neighbors.size());
}

TEST(CrossedLimbs, GoOnWhereAnotherEnds) {
    // The hind foot stands on the fore leg.
    const Figure figure(trunk_with({0.5, 0.0, -0.98}, {0.4, 0.0, -1.7}), 5000, 6);
    const Surface surface(figure.positions, figure.normals);
    const SurfaceGraph cut = surface.cut(figure.positions);
    const Index foot = shapes::nearest_row(figure.positions, {0.4, 0.0, -1.7}),
                hip = shapes::nearest_row(figure.positions, {0.8, 0.1, -0.3}),
                other = shapes::nearest_row(figure.positions, {-0.3, 0.1, -0.42});
    EXPECT_LT(between(surface.graph, foot, other), 2.0);
    EXPECT_GT(between(cut, foot, other), 2.6);
    EXPECT_LT(between(cut, foot, other), 5.0);
    EXPECT_NEAR(between(cut, foot, hip), 1.45, 0.25);
    EXPECT_TRUE(hangs_together(cut));
}

TEST(CrossedLimbs, ArentWhatBelongsTogether) {
    const std::vector<std::vector<Rod>> figures{
        trunk_with({-1.0, 0.0, -1.7}, {0.9, 0.0, -1.7}),  // legs apart
        {{{-1.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, 0.1},        // a cross
         {{0.0, 0.0, -1.0}, {0.0, 0.0, 1.0}, 0.1}},
        {{{-1.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, 0.1},  // a frame
         {{1.0, 0.0, 0.0}, {1.0, 0.0, 1.0}, 0.1},
         {{1.0, 0.0, 1.0}, {-1.0, 0.0, 1.0}, 0.1},
         {{-1.0, 0.0, 1.0}, {-1.0, 0.0, 0.0}, 0.1},
         {{0.0, 0.0, 0.0}, {0.0, 0.0, 1.0}, 0.1}}};
    for (const std::vector<Rod>& rods : figures) {
        const Figure figure(rods, 5000, 7);
        const Surface surface(figure.positions, figure.normals);
        EXPECT_EQ(surface.cut(figure.positions).neighbors, surface.graph.neighbors);
    }
    const Positions torus = shapes::torus(4000, 0.2);
    Progress progress;
    const Normals normals = [&] {
        Normals n = torus;
        for (Index i = 0; i < n.rows(); ++i) {
            const Vector3 p = torus.row(i).transpose();
            const Vector3 ring = Vector3(p[0], p[1], 0.0).normalized();
            n.row(i) = (p - ring).normalized().transpose();
        }
        return n;
    }();
    const Surface surface(torus, normals);
    EXPECT_EQ(surface.cut(torus).neighbors, surface.graph.neighbors);
}

TEST(CrossedLimbs, HoldTogetherWhatHangsOnNothingElse) {
    // Two rods that cross, with a ball at an end of each.
    const Figure figure({{{-1.0, 0.0, 0.0}, {0.6, 0.0, -1.0}, kThin},
                         {{1.0, 0.0, 0.0}, {-0.6, 0.0, -1.0}, kThin},
                         {{-1.0, 0.0, 0.0}, {-1.01, 0.0, 0.0}, 0.4},
                         {{1.0, 0.0, 0.0}, {1.01, 0.0, 0.0}, 0.4}},
                        5000, 10);
    const Surface surface(figure.positions, figure.normals);
    EXPECT_EQ(surface.cut(figure.positions).neighbors, surface.graph.neighbors);
}

TEST(CrossedLimbs, KeepTheirFeetInAMap) {
    SKIP_WHERE_WATCHED();
    const Figure crossed(trunk_with(kHind, kFore), 6000, 8),
        apart(trunk_with({-1.0, 0.0, -1.9}, {0.9, 0.0, -1.9}), 6000, 9);
    Progress progress;
    const auto coarse = [&](const Figure& figure) {
        const double unit = 1.0 / std::sqrt(estimated_area(KdTree<3>(figure.positions)));
        const Positions positions = unit * figure.positions;
        return coarse_shape(KdTree<3>(positions), figure.normals, {}, {}, progress);
    };
    const CoarseShape source = coarse(crossed), target = coarse(apart);
    const Pose pose = find_pose({source, target}, {}, {}, progress);
    const Positions images = images_at_rest(pose.best);
    const KdTree<3> tree(target.positions);
    Index right = 0, all = 0;
    for (Index i = 0; i < source.size(); ++i) {
        const int leg = crossed.rod[to_size(source.cloud_rows[to_size(i)])];
        const bool is_shank = crossed.positions(source.cloud_rows[to_size(i)], 2) < -1.3;
        if (!is_shank) continue;
        const Index there = nearest_rows(tree, Positions(images.row(i))).front();
        ++all;
        right += apart.rod[to_size(target.cloud_rows[to_size(there)])] == leg;
    }
    EXPECT_GT(all, 200);
    EXPECT_GT(static_cast<double>(right), 0.98 * static_cast<double>(all));
}

}  // namespace
}  // namespace pointmorph

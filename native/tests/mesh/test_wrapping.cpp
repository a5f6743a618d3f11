#include "pointmorph/mesh/wrapping.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <random>
#include <string_view>
#include <utility>
#include <vector>

#include "mesh/creases.hpp"
#include "mesh/elastic_sheet.hpp"
#include "mesh/mending.hpp"
#include "mesh/mesh_edges.hpp"
#include "mesh_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/mesh/mesh_samples.hpp"
#include "shaken_shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// How often the balls are subdivided: a ball of each fineness has four times the last one's faces.
int fineness() {
    return is_watched() ? 3 : 4;
}

/// A target with its samples, and an inverse map that is right where `inverse` is.
template <class Inverse>
WrapTarget target_of(const Mesh& target, const Mesh& source, Inverse&& inverse) {
    Progress progress;
    const Index count = is_watched() ? 800 : 3000;
    const MeshSamples coarse = sample_mesh(target, {}, {.count = count}, progress);
    const MeshSamples fine =
        sample_mesh(target, {}, {.count = 10 * count, .even = false}, progress);
    WrapTarget result;
    result.mesh = &target;
    result.coarse = {coarse.positions, coarse.normals};
    result.coarse_parts = coarse.parts;
    result.fine = {fine.positions, fine.normals};
    result.fine_parts = fine.parts;
    result.area = target.area();
    const TriangleTree tree(source.positions, source.triangles, progress);
    for (Index s = 0; s < coarse.size(); ++s)
        result.on_mesh.push_back(
            tree.closest(Vector3(inverse(Vector3(coarse.positions.row(s).transpose())))));
    return result;
}

/// Smooth noise of about this size.
Positions shaken(const Positions& places, double size, unsigned seed) {
    return shapes::waved(places, size / 3.0, seed, 6, 2.5);
}

/// Faces that lie against the surface of `target` there, both with as many triangles.
Index turned_over(const Mesh& mesh, const Positions& x, const Mesh& target) {
    Progress progress;
    const TriangleTree tree(target.positions, target.triangles, progress);
    Index count = 0;
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
        const auto corner = [&](Index k) -> Vector3 {
            return x.row(mesh.triangles(f, k)).transpose();
        };
        const Vector3 normal = (corner(1) - corner(0)).cross(corner(2) - corner(0));
        const SurfacePoint at = tree.closest((corner(0) + corner(1) + corner(2)) / 3.0);
        count += normal.dot(target.normals.row(at.triangle).transpose()) < 0.0;
    }
    return count;
}

double mean_distance(const Positions& a, const Positions& b) {
    return (a - b).rowwise().norm().mean();
}

/// The distance that so large a share of the rows don't exceed.
double distance_of(double share, const Positions& a, const Positions& b) {
    Values distances = (a - b).rowwise().norm();
    std::ranges::sort(distances);
    return distances[static_cast<Eigen::Index>(share * static_cast<double>(distances.size() - 1))];
}

Cloud bumpy() {
    Cloud cloud = mesh_shapes::icosphere(fineness());
    for (Index v = 0; v < cloud.size(); ++v) {
        const auto p = cloud.positions.row(v);
        cloud.positions.row(v) *= 1.0 + 0.15 * std::sin(3.0 * p[0] + 1.0) * std::cos(2.0 * p[1]);
    }
    return cloud;
}

Vector3 bent(const Vector3& p) {
    const double angle = 0.6 * p[2];
    const Matrix3 turn = Eigen::AngleAxisd(angle, Vector3::UnitX()).toRotationMatrix();
    return turn * Vector3(1.3 * p[0], p[1], 1.1 * p[2]) + Vector3(0.1 * p[1] * p[1], 0, 0);
}

struct Bent {
    Mesh source, target;
    Positions truth;  ///< where the places of the source belong
    WrapTarget onto;

    Bent() : source(make_mesh(bumpy())), target(make_mesh(bent_cloud())) {
        truth = target.positions;
        onto = target_of(target, source, [&](const Vector3& p) {
            // the source's place of the nearest place of the target
            Index nearest = 0;
            (target.positions.rowwise() - p.transpose()).rowwise().squaredNorm().minCoeff(&nearest);
            return Vector3(source.positions.row(nearest).transpose());
        });
    }

    static Cloud bent_cloud() {
        Cloud cloud = bumpy();
        for (Index v = 0; v < cloud.size(); ++v)
            cloud.positions.row(v) = bent(cloud.positions.row(v).transpose()).transpose();
        return cloud;
    }
    double spacing() const {
        return std::sqrt(target.area() / static_cast<double>(target.positions.rows()));
    }
};

TEST(Wrapping, LeavesWhatFitsAlready) {
    const Bent bent;
    Progress progress;
    EXPECT_EQ(wrap(bent.source, bent.truth, bent.onto, {}, {}, progress), bent.truth);
}

TEST(Wrapping, FindsAKnownDeformationBack) {
    SKIP_WHERE_WATCHED();
    const Bent bent;
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal(0.0, 0.1 * bent.spacing());
    const Positions start =
        bent.truth + Positions::NullaryExpr(bent.truth.rows(), 3, [&] { return normal(random); });
    Progress progress;
    const Positions found = wrap(bent.source, start, bent.onto, {}, {}, progress);
    // Along the surface a vertex is held by the evenness of the sheet alone, whose stretch is
    // averaged: it slides as far where it starts at its place. Across, the surface holds it.
    const double spacing = bent.spacing();
    EXPECT_LT(mean_distance(found, bent.truth), 0.2 * spacing);
    EXPECT_LT(distance_of(0.95, found, bent.truth), 0.45 * spacing);
    EXPECT_LT(distance_of(1.0, found, bent.truth), 0.7 * spacing);
    const Values across =
        (found - bent.truth).cwiseProduct(bent.target.place_normals).rowwise().sum().cwiseAbs();
    EXPECT_LT(across.maxCoeff(), 0.06 * spacing);
}

TEST(Wrapping, TurnsNoFaceOver) {
    SKIP_WHERE_WATCHED();
    const Bent bent;
    for (const unsigned seed : {1u, 2u, 3u}) {
        const Positions start = shaken(bent.truth, 0.08, seed);
        Progress progress;
        const Positions found = wrap(bent.source, start, bent.onto, {}, {}, progress);
        EXPECT_EQ(turned_over(bent.source, found, bent.target), 0) << seed;
        EXPECT_LE(turned_over(bent.source, found, bent.target),
                  turned_over(bent.source, start, bent.target));
    }
}

TEST(Wrapping, MeetsMarksToTheBit) {
    const Bent bent;
    Progress progress;
    const WrapMark mark{17, bent.target.positions.row(17).transpose()};
    const Positions start = shaken(bent.truth, 0.05, 4);
    const Positions found =
        wrap(bent.source, start, bent.onto, {{&mark, 1}}, {.first_length = 0.02}, progress);
    EXPECT_EQ(found.row(17), bent.target.positions.row(17));
    EXPECT_TRUE(found.allFinite());
}

TEST(Wrapping, TurnsScalesAndMovesWithTheTarget) {
    const Bent bent;
    const Matrix3 turn = Eigen::AngleAxisd(1.0, Vector3(1, 1, 0).normalized()).toRotationMatrix();
    const auto moved = [&](const Positions& p) -> Positions {
        return (p * (3.0 * turn).transpose()).rowwise() + Eigen::RowVector3d(5, 6, 7);
    };
    WrapTarget there = bent.onto;
    there.mesh = nullptr;
    there.coarse.positions = moved(bent.onto.coarse.positions);
    there.fine.positions = moved(bent.onto.fine.positions);
    there.coarse.normals = bent.onto.coarse.normals * turn.transpose();
    there.fine.normals = bent.onto.fine.normals * turn.transpose();
    there.area *= 9.0;
    const Positions start = shaken(bent.truth, 0.03, 5);
    Progress progress;
    const WrapOptions options{.first_length = 0.02};
    const Positions found = wrap(bent.source, moved(start), there, {}, options, progress);
    EXPECT_TRUE(found.allFinite());
    if (is_watched()) return;
    const Positions here = wrap(bent.source, start, bent.onto, {}, options, progress);
    EXPECT_LT(mean_distance(found, moved(here)), 0.02 * bent.spacing());
}

TEST(Wrapping, IsTheSameForAnyNumberOfThreads) {
    SKIP_WHERE_WATCHED();
    const Bent bent;
    const Positions start = shaken(bent.truth, 0.05, 6);
    const auto wrapped = [&] {
        Progress progress;
        return wrap(bent.source, start, bent.onto, {}, {.first_length = 0.05}, progress);
    };
    const Positions all = wrapped();
    const ThreadCount one(1);
    EXPECT_EQ(wrapped(), all);
}

TEST(Wrapping, KeepsLoosePlacesAndTakesMeshesWithoutTriangles) {
    Cloud cloud = bumpy();
    cloud.positions.conservativeResize(cloud.size() + 1, 3);
    cloud.positions.bottomRows(1) << 0, 0, 3;
    const Mesh source = make_mesh(cloud);
    const Bent bent;
    Positions start(source.positions.rows(), 3);
    start << bent.truth, Eigen::RowVector3d(9, 9, 9);
    WrapTarget onto = bent.onto;
    Progress progress;
    const Positions found = wrap(source, start, onto, {}, {.first_length = 0.01}, progress);
    EXPECT_EQ(found.bottomRows(1), start.bottomRows(1));
    Mesh none = source;
    none.triangles.resize(0, 3);
    EXPECT_EQ(wrap(none, start, onto, {}, {}, progress), start);
}

/// 1 where the place at rest has x over this, 0 elsewhere.
Values right_of(const Mesh& mesh, double x) {
    return (mesh.positions.col(0).array() > x).cast<double>();
}

TEST(Wrapping, FixedPlacesStayToTheBit) {
    const Bent bent;
    const Positions start = shaken(bent.truth, 0.05, 8);
    const Values fixed = right_of(bent.source, 0.3);
    // Far from the target, to which they would go.
    const double far = 0.2;
    const Positions places = bent.truth + far * bent.target.place_normals;
    const auto wrapped = [&](double weight) {
        Progress progress;
        return wrap(bent.source, start, bent.onto,
                    {.marks = {}, .fixed = weight * fixed, .places = places},
                    {.first_length = 0.03}, progress);
    };
    const Positions found = wrapped(1.0), half = wrapped(0.5);
    EXPECT_TRUE(found.allFinite());
    Index count = 0;
    for (Index v = 0; v < found.rows(); ++v) {
        if (fixed[v] < 1.0) continue;
        ++count;
        ASSERT_EQ(found.row(v), places.row(v));
        // Half fixed, a place goes a third of the way or a half.
        const double share = (half.row(v) - places.row(v)).norm() / far;
        ASSERT_GT(share, 0.25);
        ASSERT_LT(share, 0.6);
    }
    ASSERT_GT(count, is_watched() ? 125 : 500);
}

TEST(Wrapping, RigidRegionsKeepTheirShape) {
    const Bent bent;
    const Positions start = shaken(bent.truth, 0.05, 9);
    const Values rigid = right_of(bent.source, 0.3);
    Progress progress;
    const Positions found = wrap(bent.source, start, bent.onto, {.marks = {}, .rigid = rigid},
                                 {.first_length = 0.03}, progress);
    std::vector<Index> rows;
    for (Index v = 0; v < found.rows(); ++v)
        if (rigid[v] == 1.0) rows.push_back(v);
    ASSERT_GT(rows.size(), 41u);
    const Positions rest = gather(bent.source.positions, rows), ends = gather(found, rows);
    const Similarity fit = fit_similarity(rest, ends);
    EXPECT_LT((fit.apply(rest) - ends).cwiseAbs().maxCoeff(), 1e-9);
    if (is_watched()) return;
    const Positions soft =
        wrap(bent.source, start, bent.onto, {}, {.first_length = 0.03}, progress);
    const Positions given_way = gather(soft, rows);
    EXPECT_GT((fit_similarity(rest, given_way).apply(rest) - given_way).cwiseAbs().maxCoeff(),
              0.02);
}

TEST(Wrapping, RelaxesOnTheTargetAsOftenAsItIsAskedTo) {
    SKIP_WHERE_WATCHED();
    const Bent bent;
    const Positions start = shaken(bent.truth, 0.05, 6);
    const std::vector<WrapMark> marks{{17, bent.target.positions.row(17).transpose()}};
    const WrapHolds holds{.marks = marks, .rigid = right_of(bent.source, 0.7)};
    const auto wrapped = [&](Index relaxing) {
        Progress progress;
        return wrap(bent.source, start, bent.onto, holds,
                    {.first_length = 0.02, .relaxing = relaxing}, progress);
    };
    Progress progress;
    const Positions none = wrapped(0);
    EXPECT_EQ(wrap(bent.source, start, bent.onto, holds, {.first_length = 0.02}, progress), none);
    const TriangleTree tree(bent.target.positions, bent.target.triangles, progress);
    const auto off = [&](const Positions& x) {
        double most = 0.0;
        for (Index v = 0; v < x.rows(); ++v)
            if (!(holds.rigid[v] > 0.0))
                most = std::max(most, tree.closest(x.row(v).transpose()).squared_distance);
        return std::sqrt(most);
    };
    for (const Index relaxing : {1, 20}) {
        const Positions x = wrapped(relaxing);
        EXPECT_NE(x, none);
        EXPECT_EQ(x.row(17), bent.target.positions.row(17));
        EXPECT_LE(off(x), off(none) + 0.02 * bent.spacing());
        EXPECT_EQ(turned_over(bent.source, x, bent.target), 0);
        for (Index v = 0; v < x.rows(); ++v)
            if (holds.rigid[v] > 0.0) {
                ASSERT_EQ(x.row(v), none.row(v));
            }
    }
}

TEST(Wrapping, ConformsAsFirmlyAsItIsAskedTo) {
    const Bent bent;
    const Positions start = bent.truth * 1.1;
    const auto off = [&](double conform) {
        Progress progress;
        const Positions found = wrap(bent.source, start, bent.onto, {},
                                     {.first_length = 0.03, .conform = conform}, progress);
        const TriangleTree tree(bent.target.positions, bent.target.triangles, progress);
        double sum = 0.0;
        for (Index v = 0; v < found.rows(); ++v)
            sum += std::sqrt(tree.closest(found.row(v).transpose()).squared_distance);
        return sum / static_cast<double>(found.rows());
    };
    const double none = off(0.0);
    EXPECT_GT(none, 0.04);  // 0.045 on the coarser mesh that is watched
    if (is_watched()) return;
    const double full = off(1.0), little = off(0.01);
    EXPECT_LT(full, 1e-3);
    EXPECT_GT(little, full);
    EXPECT_GT(none, little);
}

TEST(Wrapping, RandomMeshesWithRandomMapsGainNoTurnedFace) {
    SKIP_WHERE_WATCHED();
    for (const unsigned seed : {1u, 2u, 3u, 4u}) {
        // A ball with vertices where they like, onto a bumpy one.
        Cloud cloud = mesh_shapes::icosphere(3 + static_cast<int>(seed % 2));
        std::mt19937_64 random(seed);
        std::normal_distribution<double> normal(0.0, seed % 2 ? 0.012 : 0.025);
        for (Index v = 0; v < cloud.size(); ++v) {
            const Vector3 noise(normal(random), normal(random), normal(random));
            cloud.positions.row(v) =
                (cloud.positions.row(v).transpose() + noise).normalized().transpose();
        }
        const Mesh source = make_mesh(cloud), target = make_mesh(bumpy());
        const WrapTarget onto =
            target_of(target, source, [](const Vector3& p) { return p.normalized(); });
        const Positions start = shaken(source.positions, 0.08, 10 + seed);
        Progress progress;
        const Positions found = wrap(source, start, onto, {}, {}, progress);
        EXPECT_LE(turned_over(source, found, target), turned_over(source, start, target)) << seed;
        EXPECT_EQ(turned_over(source, found, target), 0) << seed;
    }
}

TEST(Wrapping, HardlyCreasesOnAnUnevenSurface) {
    const Mesh source = make_mesh(mesh_shapes::icosphere(fineness() + 1));
    Cloud cloud = mesh_shapes::icosphere(fineness());
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal(0.0, 0.06);
    for (Index v = 0; v < cloud.size(); ++v) cloud.positions.row(v) *= 1.0 + normal(random);
    const Mesh target = make_mesh(cloud);
    const WrapTarget onto =
        target_of(target, source, [](const Vector3& p) { return p.normalized(); });
    WrapOptions options;
    if (is_watched()) options.coarse_places /= 4;  // so that it is still a large mesh
    Progress progress;
    const Positions found = wrap(source, source.positions, onto, {}, options, progress);
    const ElasticSheet sheet(source.positions, source.triangles, progress);

    // 16; where steps could crease faces, 156
    EXPECT_LT(creased_faces(source, sheet, found, progress).size(), 40);
}

/// A ball, part of whose vertices lie anywhere around.
struct Crumpled {
    Mesh mesh = make_mesh(mesh_shapes::icosphere(4));
    Progress progress;
    ElasticSheet sheet{mesh.positions, mesh.triangles, progress};
    Positions x = mesh.positions;
    MendTarget target;
    std::vector<char> is_fixed = std::vector<char>(to_size(x.rows()), 0);

    Crumpled() {
        std::mt19937_64 random(5);
        std::normal_distribution<double> normal(0.0, 0.06);
        for (Index v = 0; v < x.rows(); ++v)
            if (x(v, 2) > 0.9 * x.row(v).norm())
                x.row(v) += Eigen::RowVector3d(normal(random), normal(random), normal(random));
        const double radius = mesh.positions.row(0).norm();
        target.landed = [radius](Index, const Vector3& place, const Vector3&) {
            return Vector3(radius * place.normalized());
        };
        target.samples = mesh.positions;
        target.reach = target.farthest = 1.0;
    }
    Index creased() const {
        Index count = 0;
        const MeshEdges edges(mesh.triangles);
        for (Index e = 0; e < edges.size(); ++e) {
            const auto facing = [&](std::size_t side) {
                const ElasticSheet::Corners p = sheet.places(x, edges[e][side].triangle);
                return Vector3((p.col(1) - p.col(0)).cross(Vector3(p.col(2) - p.col(0))));
            };
            count += facing(0).dot(facing(1)) < 0.0;
        }
        return count;
    }
};

/// take_back_creases(), one face after the other, and all of them every time.
Positions taken_back_slowly(const Crumpled& ball, const Positions& before,
                            const std::vector<char>& stays, Positions x) {
    const Creases creases(ball.mesh, ball.sheet);
    for (bool is_any = true; is_any;) {
        is_any = false;
        std::vector<Index> worse;
        for (Index f = 0; f < ball.mesh.triangles.rows(); ++f)
            if (creases.of_face(x, f) > creases.of_face(before, f)) worse.push_back(f);
        for (const Index f : worse)
            for (const Index v : ball.mesh.triangles.row(f)) {
                if (stays[to_size(v)] || x.row(v) == before.row(v)) continue;
                x.row(v) = before.row(v);
                is_any = true;
            }
    }
    return x;
}

TEST(Creases, AreTakenBackUntilNoFaceHasMore) {
    Crumpled ball;
    const Creases creases(ball.mesh, ball.sheet);
    // Creased already, but less.
    const Positions before = 0.4 * ball.x + 0.6 * ball.mesh.positions;
    std::vector<char> stays(to_size(ball.x.rows()), 0);
    for (const bool some_stay : {false, true}) {
        if (some_stay)
            for (std::size_t v = 0; v < stays.size(); v += 7) stays[v] = 1;
        Positions x = ball.x;
        take_back_creases(ball.mesh, ball.sheet, before, stays, x, ball.progress);
        EXPECT_EQ(x, taken_back_slowly(ball, before, stays, ball.x));
        Index back = 0, moved = 0;
        for (Index v = 0; v < x.rows(); ++v) {
            const bool was_moved = ball.x.row(v) != before.row(v);
            moved += was_moved;
            back += was_moved && x.row(v) == before.row(v);
            EXPECT_TRUE(x.row(v) == before.row(v) || x.row(v) == ball.x.row(v));
            EXPECT_TRUE(!stays[to_size(v)] || x.row(v) == ball.x.row(v));
        }
        EXPECT_GT(back, 0);
        EXPECT_LT(back, moved);
        if (some_stay) continue;
        for (Index f = 0; f < ball.mesh.triangles.rows(); ++f)
            EXPECT_LE(creases.of_face(x, f), creases.of_face(before, f));
    }
}

TEST(Wrapping, MendsCreasesWithWhatIsAround) {
    Crumpled ball;
    ASSERT_GT(ball.creased(), 20);
    const Positions before = ball.x;
    Progress progress;
    TriangleTree tree(ball.x, ball.mesh.triangles, progress);
    mend(ball.mesh, ball.sheet, ball.target, ball.is_fixed, tree, ball.x, progress);
    EXPECT_EQ(ball.creased(), 0);
    for (Index v = 0; v < ball.x.rows(); ++v) {
        if (before(v, 2) >= 0.0) continue;
        EXPECT_EQ(ball.x.row(v), before.row(v));
    }
}

TEST(Wrapping, MendsNoMoreOfAPatchOnceItIsCancelled) {
    Crumpled ball;
    std::mt19937_64 random(5);
    std::normal_distribution<double> normal(0.0, 0.06);
    for (Index v = 0; v < ball.x.rows(); ++v)  // all of it is one patch
        ball.x.row(v) += Eigen::RowVector3d(normal(random), normal(random), normal(random));
    std::atomic<int> landed{0};
    ball.target.landed = [&](Index, const Vector3& place, const Vector3&) {
        ++landed;
        return place;
    };
    Progress progress([&](std::string_view, double) { return landed == 0; },
                      std::chrono::milliseconds(0));
    TriangleTree tree(ball.x, ball.mesh.triangles, ball.progress);
    const ThreadCount one(1);
    EXPECT_THROW(mend(ball.mesh, ball.sheet, ball.target, ball.is_fixed, tree, ball.x, progress),
                 Cancelled);
    EXPECT_GT(landed, 0);
    EXPECT_LT(landed, ball.x.rows() / 2);
}

TEST(Wrapping, MendsOnlyWhatStaysCovered) {
    // A spike of the target that nothing else reaches.
    Crumpled ball;
    ball.target.reach = 0.0;
    ball.target.samples = ball.x;
    const Positions before = ball.x;
    Progress progress;
    TriangleTree tree(ball.x, ball.mesh.triangles, progress);
    const Index creased = ball.creased();
    mend(ball.mesh, ball.sheet, ball.target, ball.is_fixed, tree, ball.x, progress);
    EXPECT_EQ(ball.x, before);
    std::ranges::fill(ball.is_fixed, 1);
    ball.target.reach = 1.0;
    mend(ball.mesh, ball.sheet, ball.target, ball.is_fixed, tree, ball.x, progress);
    EXPECT_EQ(ball.x, before);
    EXPECT_EQ(ball.creased(), creased);
}

TEST(Wrapping, SaysHowFarItIs) {
    const Bent bent;
    std::vector<double> said;
    const auto listening = [&] {
        said.clear();
        return [&](std::string_view, double fraction) {
            said.push_back(fraction);
            return true;
        };
    };
    // What is only made ready has no share.
    {
        Progress progress(listening(), std::chrono::milliseconds(0));
        const ElasticSheet sheet(bent.source.positions, bent.source.triangles, progress);
        const TriangleTree tree(bent.source.positions, bent.source.triangles, progress);
        ASSERT_FALSE(said.empty());
        EXPECT_EQ(said.back(), 0.0);
    }
    Progress progress(listening(), std::chrono::milliseconds(0));
    wrap(bent.source, shaken(bent.truth, 0.1, 7), bent.onto, {}, {}, progress);
    EXPECT_EQ(said.back(), 1.0);
    const auto up_to = [&](double fraction) {
        return static_cast<double>(std::ranges::upper_bound(said, fraction) - said.begin()) /
               static_cast<double>(said.size());
    };
    EXPECT_LT(up_to(0.25), 0.5);
    EXPECT_GT(up_to(0.75), 0.4);
}

TEST(Wrapping, CanBeCancelled) {
    const Bent bent;
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(wrap(bent.source, shaken(bent.truth, 0.1, 7), bent.onto, {}, {}, progress),
                 Cancelled);
}

TEST(Example, Wrapping) {
    SKIP_WHERE_WATCHED();
    const Mesh mesh = make_mesh(mesh_shapes::icosphere(3));
    const Mesh target_mesh = make_mesh(mesh_shapes::icosphere(4));
    const WrapTarget target = target_of(target_mesh, mesh, [](const Vector3& p) { return p; });
    const Positions images_of_places = shaken(mesh.positions, 0.01, 1);
    const WrapMark nose{5, target_mesh.positions.row(5).transpose()};
    Progress progress;
    // --- example
    const std::vector<WrapMark> marks{nose};
    const Positions wrapped = wrap(mesh, images_of_places, target, {.marks = marks}, {}, progress);
    // --- end of the example
    EXPECT_EQ((wrapped.row(5).transpose() - nose.target).norm(), 0.0);
    EXPECT_LT((wrapped.rowwise().norm().array() / target_mesh.positions.row(0).norm() - 1.0)
                  .abs()
                  .maxCoeff(),
              0.02);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/frames/mesh_motion.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <functional>
#include <numbers>
#include <random>

#include "mesh/mesh_edges.hpp"
#include "mesh_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "shaken_shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

constexpr int kTimes = 24;
constexpr double kThick = 0.1;
const Vector3 kAcross(1, 0, 0);

/// A tube along x from −1 to 1, closed by a disk at each end.
Cloud tube(Index rings = 60, Index sides = 16) {
    Cloud cloud = mesh_shapes::cylinder(sides);
    cloud.faces = {};
    cloud.positions.resize(rings * sides, 3);
    std::vector<Index> first, last;
    for (Index r = 0; r < rings; ++r)
        for (Index s = 0; s < sides; ++s) {
            const double angle = 2.0 * std::numbers::pi * s / sides;
            cloud.positions.row(r * sides + s) << 2.0 * r / (rings - 1) - 1.0,
                kThick * std::cos(angle), kThick * std::sin(angle);
            const Index next = (s + 1) % sides;
            if (r + 1 < rings)
                mesh_shapes::add_face(cloud.faces, {r * sides + s, (r + 1) * sides + s,
                                                    (r + 1) * sides + next, r * sides + next});
        }
    for (Index s = 0; s < sides; ++s) {
        first.push_back(s);
        last.insert(last.begin(), (rings - 1) * sides + s);
    }
    mesh_shapes::add_face(cloud.faces, first);
    mesh_shapes::add_face(cloud.faces, last);
    return cloud;
}

/// The tube's axis along an arc of so much angle.
Vector3 bent(const Vector3& p, double angle) {
    if (angle == 0.0) return p;
    const double radius = 2.0 / angle, a = p.x() / radius;
    return {(radius - p.y()) * std::sin(a), radius - (radius - p.y()) * std::cos(a), p.z()};
}

/// One end against the other.
Vector3 twisted(const Vector3& p, double angle) {
    return Eigen::AngleAxisd(0.5 * angle * p.x(), kAcross) * p;
}

Positions mapped(const Positions& positions, const std::function<Vector3(const Vector3&)>& map) {
    Positions result(positions.rows(), 3);
    for (Index v = 0; v < positions.rows(); ++v)
        result.row(v) = map(positions.row(v).transpose()).transpose();
    return result;
}

/// A mesh on its way.
struct Trip {
    Cloud cloud;
    Mesh mesh;
    Normals normals;
    Positions ends;
    MeshMotion motion;

    Trip(const Cloud& from, const Positions& to, PathKind path)
        : cloud(from),
          mesh(make_mesh(from)),
          normals(gather(mesh.place_normals, mesh.places)),
          ends(to),
          motion(make(path)) {}
    Trip(const Trip&) = delete;

    MeshMotion make(PathKind path) const {
        Progress progress;
        const GradualSimilarity similarity{fit_similarity(cloud.positions, ends),
                                           cloud.positions.colwise().mean().transpose()};
        return {mesh, {cloud.positions, normals}, ends, similarity, path, progress};
    }
};

/// Of vertices: twice the areas of the triangles, toward where they face.
Normals faces_at(const Mesh& mesh, const Positions& vertices) {
    Positions x = mesh.positions;
    for (std::size_t v = mesh.places.size(); v-- > 0;)
        x.row(mesh.places[v]) = vertices.row(static_cast<Eigen::Index>(v));
    Normals result(mesh.triangles.rows(), 3);
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
        const auto corner = [&](Index k) -> Vector3 { return x.row(mesh.triangles(f, k)); };
        result.row(f) = (corner(1) - corner(0)).cross(corner(2) - corner(0)).transpose();
    }
    return result;
}

/// Triangles that face another way than where they should be, after the best turn of the whole.
Index turned_over(const Mesh& mesh, const Positions& vertices, const Positions& truth) {
    const Normals is = faces_at(mesh, fit_similarity(vertices, truth).apply(vertices));
    const Normals should = faces_at(mesh, truth);
    return to_index((is.cwiseProduct(should).rowwise().sum().array() <= 0.0).count());
}

/// Edges that bend by over 90°.
Index creased(const Mesh& mesh, const Positions& vertices) {
    const Normals normals = faces_at(mesh, vertices);
    const MeshEdges edges(mesh.triangles);
    Index count = 0;
    for (Index e = 0; e < edges.size(); ++e) {
        const auto sides = edges[e];
        count += sides.size() == 2 &&
                 normals.row(sides[0].triangle).dot(normals.row(sides[1].triangle)) < 0.0;
    }
    return count;
}

double distance(const Positions& vertices, const Positions& truth) {
    return (fit_similarity(vertices, truth).apply(vertices) - truth).rowwise().norm().maxCoeff();
}

TEST(MeshMotion, EndsWhereItIsToldTo) {
    const Cloud cloud = tube();
    const Positions ends = mapped(cloud.positions, [](const Vector3& p) {
        return Vector3(3.0 * bent(p, 2.0) + Vector3(4, 5, 6));
    });
    for (const PathKind path : {PathKind::kLinear, PathKind::kSimilarity, PathKind::kRigid}) {
        const Trip trip(cloud, ends, path);
        EXPECT_LT((trip.motion.at(0.0) - cloud.positions).cwiseAbs().maxCoeff(), 1e-9);
        EXPECT_LT((trip.motion.at(1.0) - ends).cwiseAbs().maxCoeff(), 1e-9);
    }
}

TEST(MeshMotion, SeamsThatDifferByRoundingStayClosedOnTheWay) {
    const Cloud cloud = mesh_shapes::split(tube());
    Positions beside = cloud.positions;
    for (Index v = 0; v < cloud.size(); ++v) beside(v, v % 3) += v % 2 == 0 ? 1e-6 : 0.0;
    const Positions ends = mapped(cloud.positions, [](const Vector3& p) { return bent(p, 2.0); });
    Cloud rounded = cloud;
    rounded.positions = beside;
    const Trip trip(rounded, ends, PathKind::kRigid), closed(cloud, ends, PathKind::kRigid);
    EXPECT_LT((trip.motion.at(0.0) - beside).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((trip.motion.at(1.0) - ends).cwiseAbs().maxCoeff(), 1e-9);
    for (const double t : {0.25, 0.5, 0.75})
        EXPECT_LT((trip.motion.at(t) - closed.motion.at(t)).cwiseAbs().maxCoeff(), 1e-4);
}

TEST(MeshMotion, BothSidesOfASeamGoWhereTheyAreTold) {
    const Cloud cloud = mesh_shapes::split(tube());
    Positions ends = cloud.positions;
    for (Index v = 0; v < cloud.size(); ++v) ends(v, 2) += v % 2 == 0 ? 0.2 : 0.0;
    const Trip trip(cloud, ends, PathKind::kRigid);
    EXPECT_LT((trip.motion.at(1.0) - ends).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((trip.motion.at(1.0 - 1e-6) - ends).cwiseAbs().maxCoeff(), 1e-4);
}

TEST(MeshMotion, ABentTubeBendsEvenly) {
    const Cloud cloud = tube();
    // At the last, both ends turn by more than half a turn against the middle.
    for (const double angle : {1.0, 4.0, 8.0}) {
        const auto at = [&](double t) {
            return mapped(cloud.positions, [&](const Vector3& p) { return bent(p, t * angle); });
        };
        const Trip trip(cloud, at(1.0), PathKind::kRigid);
        for (int k = 0; k < kTimes; ++k) {
            const double t = k / (kTimes - 1.0);
            const Positions vertices = trip.motion.at(t);
            EXPECT_LT(distance(vertices, at(t)), 0.02) << angle << " at " << t;
            EXPECT_EQ(turned_over(trip.mesh, vertices, at(t)), 0) << angle << " at " << t;
        }
    }
}

TEST(MeshMotion, ATwistedTubeTwistsEvenly) {
    const Cloud cloud = tube();
    const double angle = 1.5 * std::numbers::pi;
    const auto at = [&](double t) {
        return mapped(cloud.positions, [&](const Vector3& p) { return twisted(p, t * angle); });
    };
    const Trip trip(cloud, at(1.0), PathKind::kRigid);
    for (int k = 0; k < kTimes; ++k) {
        const double t = k / (kTimes - 1.0);
        const Positions vertices = trip.motion.at(t);
        EXPECT_EQ(turned_over(trip.mesh, vertices, at(t)), 0) << t;
        EXPECT_LT(distance(vertices, at(t)), 0.05) << t;
    }
}

TEST(MeshMotion, ATubeUntwistsByWholeTurns) {
    const Cloud cloud = tube();
    for (const double turns : {0.5, 0.97, 1.0, 1.5, 2.0, 2.5}) {
        const auto at = [&](double t) {
            return mapped(cloud.positions, [&](const Vector3& p) {
                return twisted(p, t * turns * 2.0 * std::numbers::pi);
            });
        };
        const Trip trip(cloud, at(1.0), PathKind::kRigid);
        for (const double t : {0.25, 0.5, 0.75})
            EXPECT_LT(distance(trip.motion.at(t), at(t)), 0.1) << turns << " at " << t;
        EXPECT_LT(distance(trip.motion.at(1.0), at(1.0)), 1e-9) << turns;
    }
}

/// A cup around z with a wall as thick as between the radii, which is as high as 2; the floors are
/// at 0 and `floor`.
Cloud cup(double outer, double inner, double rim, double floor) {
    constexpr Index kSides = 24;
    const std::array<std::pair<double, double>, 6> rings{
        std::pair{outer, 0.0}, {outer, 2.0},   {0.5 * (outer + inner), rim},
        {inner, 2.0},          {inner, floor}, {0.5 * inner, floor}};
    Cloud cloud = mesh_shapes::cylinder(kSides);
    cloud.faces = {};
    cloud.positions.resize(to_index(rings.size()) * kSides, 3);
    std::vector<Index> below, within;
    for (Index s = 0; s < kSides; ++s) {
        const double angle = 2.0 * std::numbers::pi * s / kSides;
        const Index next = (s + 1) % kSides;
        for (Index r = 0; r < to_index(rings.size()); ++r) {
            const auto& [radius, height] = rings[to_size(r)];
            cloud.positions.row(r * kSides + s) << radius * std::cos(angle),
                radius * std::sin(angle), height;
            if (r + 1 < to_index(rings.size()))
                mesh_shapes::add_face(cloud.faces, {r * kSides + s, r * kSides + next,
                                                    (r + 1) * kSides + next, (r + 1) * kSides + s});
        }
        below.insert(below.begin(), s);
        within.push_back((to_index(rings.size()) - 1) * kSides + s);
    }
    mesh_shapes::add_face(cloud.faces, below);
    mesh_shapes::add_face(cloud.faces, within);
    return cloud;
}

TEST(MeshMotion, TheInsideOfACupStaysInsideWhereTheWallComesOutOnItsOtherSide) {
    const Cloud thick = cup(1.0, 0.9, 2.0, 0.1);
    for (const double inner : {0.97, 1.03, 1.1})
        for (const double rim : {1.95, 2.0, 2.05}) {
            const Cloud thin = cup(1.0, inner, rim, 0.3);
            const Trip trip(thick, thin.positions, PathKind::kRigid);
            for (const double t : {0.25, 0.5, 0.75}) {
                const Positions vertices = trip.motion.at(t);
                const Positions straight = (1.0 - t) * thick.positions + t * thin.positions;
                EXPECT_LT((vertices - straight).rowwise().norm().maxCoeff(), 0.3)
                    << inner << " " << rim << " at " << t;
            }
        }
}

TEST(MeshMotion, AnEggThatBendsAndTwistsGetsNoCrease) {
    SKIP_WHERE_WATCHED();
    const Cloud egg = mesh_shapes::moved(mesh_shapes::icosphere(4),
                                         Vector3(1.0, 0.5, 0.4).asDiagonal(), Vector3::Zero());
    const Positions ends = mapped(egg.positions, [](const Vector3& p) {
        const Vector3 longer(p.x() * (1.0 + 0.5 * p.x() * p.x()), p.y(), p.z());
        return bent(twisted(longer, 2.0), 2.0);
    });
    const Trip trip(egg, ends, PathKind::kRigid);
    EXPECT_EQ(creased(trip.mesh, ends), 0);
    for (int k = 0; k < kTimes; ++k) {
        const double t = k / (kTimes - 1.0);
        EXPECT_EQ(creased(trip.mesh, trip.motion.at(t)), 0) << t;
    }
}

/// Which faces lie against those around them.
std::vector<char> lie_against(const Mesh& mesh, const Positions& vertices) {
    const Normals faces = faces_at(mesh, vertices);
    Normals around = Normals::Zero(mesh.positions.rows(), 3);
    for (Index f = 0; f < faces.rows(); ++f)
        for (Index k = 0; k < 3; ++k) around.row(mesh.triangles(f, k)) += faces.row(f);
    around.rowwise().normalize();
    std::vector<char> result;
    for (Index f = 0; f < faces.rows(); ++f) {
        Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
        for (Index k = 0; k < 3; ++k) sum += around.row(mesh.triangles(f, k));
        result.push_back(faces.row(f).dot(sum) < 0.0);
    }
    return result;
}

/// Faces that lie against those around them on the way, and do at neither end.
Index turned_on_the_way(const Trip& trip) {
    const std::vector<char> first = lie_against(trip.mesh, trip.cloud.positions);
    const std::vector<char> last = lie_against(trip.mesh, trip.ends);
    Index count = 0;
    for (int k = 1; k < kTimes; ++k) {
        const auto now = lie_against(trip.mesh, trip.motion.at(k / static_cast<double>(kTimes)));
        for (std::size_t f = 0; f < now.size(); ++f) count += now[f] && !first[f] && !last[f];
    }
    return count;
}

/// A bumpy ball, and the same twisted and bent.
struct BentAtRandom {
    Cloud ball = mesh_shapes::icosphere(4);
    Positions ends;

    explicit BentAtRandom(unsigned seed) {
        ball.positions = shapes::waved(ball.positions, 0.02, 10 * seed, 8, 4.0);
        ends = mapped(shapes::waved(ball.positions, 0.04, seed, 8, 4.0),
                      [&](const Vector3& p) { return bent(twisted(p, 0.4 * seed), 1.0); });
    }
};

TEST(MeshMotion, TurnsNoFaceOverOfMeshesBentAtRandom) {
    SKIP_WHERE_WATCHED();
    for (const unsigned seed : {3u, 4u}) {
        const BentAtRandom shapes(seed);
        EXPECT_EQ(turned_on_the_way(Trip(shapes.ball, shapes.ends, PathKind::kRigid)), 0) << seed;
    }
}

TEST(MeshMotion, IsAtItsEndsAndDoesNotJumpWhereFacesAreTurnedBack) {
    SKIP_WHERE_WATCHED();
    const BentAtRandom shapes(4);
    const Trip trip(shapes.ball, shapes.ends, PathKind::kRigid);
    EXPECT_LT(distance(trip.motion.at(0.0), shapes.ball.positions), 1e-9);
    EXPECT_LT(distance(trip.motion.at(1.0), shapes.ends), 1e-9);
    const double whole = (shapes.ends - shapes.ball.positions).rowwise().norm().maxCoeff();
    constexpr double kStep = 1e-5;
    for (int k = 1; k < 40; ++k) {
        const double t = k / 40.0;
        const Positions step = trip.motion.at(t + kStep) - trip.motion.at(t);
        EXPECT_LT(step.rowwise().norm().maxCoeff(), 20.0 * kStep * whole) << t;
    }
}

TEST(MeshMotion, ATurnedAndGrownMeshTurnsAndGrowsEvenly) {
    const Cloud ball = mesh_shapes::split(mesh_shapes::icosphere(3));
    const Similarity whole{4.0,
                           Eigen::AngleAxisd(2.0, Vector3(1, 2, 3).normalized()).toRotationMatrix(),
                           Vector3(1, -5, 2)};
    const GradualSimilarity similarity{whole, ball.positions.colwise().mean().transpose()};
    for (const PathKind path : {PathKind::kSimilarity, PathKind::kRigid}) {
        const Trip trip(ball, whole.apply(ball.positions), path);
        for (const double t : {0.25, 0.5, 0.9})
            EXPECT_LT(
                (trip.motion.at(t) - similarity.at(t).apply(ball.positions)).cwiseAbs().maxCoeff(),
                1e-6);
    }
}

TEST(MeshMotion, PartsAndLooseVerticesComeAlong) {
    Cloud cloud = mesh_shapes::together(
        tube(), mesh_shapes::moved(mesh_shapes::icosphere(1), 0.05 * Matrix3::Identity(),
                                   Vector3(0.9, 0.2, 0.0)));
    cloud.positions.conservativeResize(cloud.size() + 1, 3);
    cloud.positions.bottomRows(1) << 1.0, 0.3, 0.0;
    const auto at = [&](double t) {
        return mapped(cloud.positions, [&](const Vector3& p) { return bent(p, 2.0 * t); });
    };
    const Trip trip(cloud, at(1.0), PathKind::kRigid);
    for (const double t : {0.25, 0.5, 0.75}) EXPECT_LT(distance(trip.motion.at(t), at(t)), 0.05);
}

TEST(MeshMotion, LargeMeshesAreSolvedStepByStep) {
    SKIP_WHERE_WATCHED();
    const Cloud cloud = tube(1000, 64);
    const auto at = [&](double t) {
        return mapped(cloud.positions, [&](const Vector3& p) { return bent(p, 3.0 * t); });
    };
    const Trip trip(cloud, at(1.0), PathKind::kRigid);
    for (const double t : {0.1, 0.5, 0.9}) {
        EXPECT_LT(distance(trip.motion.at(t), at(t)), 0.02) << t;
        EXPECT_EQ(turned_over(trip.mesh, trip.motion.at(t), at(t)), 0) << t;
    }
}

TEST(MeshMotion, IsTheSameForAnyNumberOfThreads) {
    const Cloud cloud = tube();
    const Positions ends =
        mapped(cloud.positions, [](const Vector3& p) { return twisted(bent(p, 1.0), 1.0); });
    const Positions all = Trip(cloud, ends, PathKind::kRigid).motion.at(0.4);
    const ThreadCount one(1);
    EXPECT_EQ(Trip(cloud, ends, PathKind::kRigid).motion.at(0.4), all);
}

/// Vertices moved at random by up to so much along each axis.
Positions shaken(const Positions& positions, const Vector3& most, unsigned seed) {
    std::mt19937 random(seed);
    Positions result = positions;
    for (Index v = 0; v < result.rows(); ++v)
        for (Index k = 0; k < 3; ++k) {
            const double share = static_cast<double>(random()) / 4294967296.0;
            result(v, k) += (2.0 * share - 1.0) * most[k];
        }
    return result;
}

/// The longest step of a vertex between two of 201 times, over what the fastest needs evenly.
double unevenness(const Trip& trip) {
    constexpr int kSteps = 200;
    Positions last = trip.motion.at(0.0);
    double longest = 0.0;
    for (int k = 1; k <= kSteps; ++k) {
        const Positions now = trip.motion.at(k / static_cast<double>(kSteps));
        longest = std::max(longest, (now - last).rowwise().norm().maxCoeff());
        last = now;
    }
    return longest * kSteps / (trip.ends - trip.cloud.positions).rowwise().norm().maxCoeff();
}

/// How far vertices are outside the box around both ends, over its diagonal.
double outside(const Trip& trip) {
    const auto least =
        trip.cloud.positions.colwise().minCoeff().cwiseMin(trip.ends.colwise().minCoeff()).eval();
    const auto most =
        trip.cloud.positions.colwise().maxCoeff().cwiseMax(trip.ends.colwise().maxCoeff()).eval();
    double result = 0.0;
    for (int k = 1; k < kTimes; ++k) {
        const Positions now = trip.motion.at(k / static_cast<double>(kTimes));
        for (Index v = 0; v < now.rows(); ++v)
            result =
                std::max({result, (least - now.row(v)).maxCoeff(), (now.row(v) - most).maxCoeff()});
    }
    return result / (most - least).norm();
}

TEST(MeshMotion, CoarseMeshesNeitherJumpNorFlyAway) {
    SKIP_WHERE_WATCHED();
    for (unsigned seed = 1; seed <= 6; ++seed) {
        // Walls of long slivers, and two disks of one face each.
        const Cloud bar = tube(2, 16);
        Positions ends = shaken(bar.positions, Vector3(0.3, 0.15, 0.15), seed);
        ends.topRows(4).rowwise() = ends.row(0).eval();  // faces that collapse
        const Trip trip(bar, ends, PathKind::kRigid);
        EXPECT_LT(unevenness(trip), 4.0) << seed;
        EXPECT_LT(outside(trip), 0.15) << seed;
        const Cloud ball = mesh_shapes::icosphere(1);
        const Trip rough(ball, shaken(ball.positions, Vector3::Constant(0.6), seed),
                         PathKind::kRigid);
        EXPECT_LT(unevenness(rough), 4.0) << seed;
        EXPECT_LT(outside(rough), 0.15) << seed;
    }
}

TEST(MeshMotion, WhatIsFlatStaysInItsPlane) {
    Cloud grid;
    constexpr Index kSide = 9;
    grid.positions.resize(kSide * kSide, 3);
    for (Index v = 0; v < kSide * kSide; ++v) grid.positions.row(v) << v % kSide, v / kSide, 0.0;
    for (Index row = 0; row + 1 < kSide; ++row)
        for (Index v = row * kSide; v + 1 < (row + 1) * kSide; ++v)
            mesh_shapes::add_face(grid.faces, {v, v + 1, v + kSide + 1, v + kSide});
    const Matrix3 turn = Eigen::AngleAxisd(0.7, Vector3(1, 2, 3).normalized()).toRotationMatrix();
    grid.positions = grid.positions * turn.transpose();
    for (unsigned seed = 1; seed <= 3; ++seed) {
        // Many faces turn over in the plane.
        const Positions flat = shaken(grid.positions * turn, Vector3(0.9, 0.9, 0.0), seed);
        const Trip trip(grid, flat * turn.transpose(), PathKind::kRigid);
        EXPECT_LT(unevenness(trip), 4.0) << seed;
        for (int k = 0; k < kTimes; ++k) {
            const Positions now = trip.motion.at(k / (kTimes - 1.0));
            EXPECT_LT(((now.rowwise() - now.row(0)) * turn).col(2).cwiseAbs().maxCoeff(), 1e-3)
                << seed;
        }
    }
}

TEST(MeshMotion, AThinPlateKeepsItsSides) {
    // Its faces' normals cancel each other but for rounding.
    Cloud plate = mesh_shapes::icosphere(2);
    plate.positions.col(2) *= 0.004;
    const Matrix3 turn = Eigen::AngleAxisd(0.7, Vector3(1, 2, 3).normalized()).toRotationMatrix();
    plate.positions = plate.positions * turn.transpose();
    for (unsigned seed = 1; seed <= 3; ++seed) {
        const Positions ends = shaken(plate.positions * turn, Vector3(0.02, 0.02, 0.0), seed);
        const Trip trip(plate, ends * turn.transpose(), PathKind::kRigid);
        const Positions thickness = plate.positions * turn;
        for (int k = 0; k < kTimes; ++k) {
            const Positions now = trip.motion.at(k / (kTimes - 1.0)) * turn;
            // 1 where each side stays on its side, -1 where the plate has turned over.
            const double kept = now.col(2).dot(thickness.col(2)) / thickness.col(2).squaredNorm();
            EXPECT_GT(kept, 0.7) << seed;
        }
    }
}

TEST(MeshMotion, TakesWhatHasCollapsed) {
    const Cloud cloud = tube(is_watched() ? 15 : 60);
    const Positions ends =
        mapped(cloud.positions, [](const Vector3& p) { return Vector3(p.x(), 0.0, 0.0); });
    const Trip trip(cloud, ends, PathKind::kRigid);
    for (const double t : {0.0, 0.5, 1.0}) EXPECT_TRUE(trip.motion.at(t).allFinite());
}

TEST(Example, MeshMotion) {
    const Cloud ball = mesh_shapes::icosphere(2);
    const Mesh mesh = make_mesh(ball);
    const Positions &vertices = ball.positions, &normals = ball.positions;
    const Matrix3 turn = Eigen::AngleAxisd(2.0, kAcross).toRotationMatrix();
    const GradualSimilarity similarity{{2.0, turn, Vector3::Zero()}, Vector3::Zero()};
    const Positions wrapped_vertices = similarity.whole.apply(vertices);
    Progress progress;
    // --- example
    const MeshMotion motion(mesh, {vertices, normals}, wrapped_vertices, similarity,
                            PathKind::kRigid, progress);
    const Positions half_way = motion.at(0.5);  // #vertices by 3
    // --- end of the example
    EXPECT_LT((half_way - similarity.at(0.5).apply(vertices)).cwiseAbs().maxCoeff(), 1e-9);
}

}  // namespace
}  // namespace pointmorph

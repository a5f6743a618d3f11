#include "pointmorph/measures/mesh_quality.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>

#include "measures/mapped.hpp"
#include "mesh_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

const Index kTraySide = is_watched() ? 20 : 40;
const double kStep = 2.0 / static_cast<double>(kTraySide);

Cloud with_normals(Cloud cloud) {
    const Mesh mesh = make_mesh(cloud);
    cloud.normals = gather(mesh.place_normals, mesh.places);
    return cloud;
}

/// A source whose vertices end at `ends`, on a target with faces.
MeshQuality measured(const Cloud& source, const Positions& ends, const Cloud& target,
                     std::span<const Feature> features = {}) {
    const Mesh from = make_mesh(source), to = make_mesh(target);
    Progress progress;
    return measure_mesh_quality({source, from, ends}, {with_normals(target), &to}, features,
                                progress);
}

Cloud sheet() {
    Cloud cloud = mesh_shapes::grid(kTraySide);
    cloud.name = "Sheet";
    return cloud;
}

Cloud tray() {
    Cloud cloud = mesh_shapes::grid(2 * kTraySide);
    cloud.name = "Tray";
    return cloud;
}

/// Columns of vertices at −kStep and 0 exchanged: the squares between them are turned over.
Vector3 swapped(const Vector3& p) {
    if (std::abs(p.x()) < 1e-9) return {-kStep, p.y(), p.z()};
    if (std::abs(p.x() + kStep) < 1e-9) return {0.0, p.y(), p.z()};
    return p;
}

TEST(MeshQuality, NothingIsWrongWithAMeshOnItself) {
    for (const Cloud& cloud : {mesh_shapes::icosphere(3), mesh_shapes::cube(), sheet(),
                               mesh_shapes::split(mesh_shapes::cylinder(12))}) {
        const MeshQuality quality = measured(cloud, cloud.positions, cloud);
        EXPECT_EQ(quality.figures.folded, 0.0) << cloud.name;
        EXPECT_EQ(quality.figures.creased, 0.0) << cloud.name;
        EXPECT_NEAR(quality.figures.uncovered, 0.0, 1e-9) << cloud.name;
        EXPECT_NEAR(quality.figures.off, 0.0, 1e-9) << cloud.name;
        EXPECT_EQ(quality.grade, MeshGrade::kGood);
        EXPECT_EQ(quality.verdict,
                  "Good: the faces of " + cloud.name + " lie smoothly on " + cloud.name + ".");
        EXPECT_TRUE(quality.worst.empty());
    }
}

TEST(MeshQuality, ALiftedSheetIsOffByItsHeight) {
    const Cloud source = sheet();
    const auto lifted = [](const Vector3& p) { return Vector3(p.x(), p.y(), 0.06); };
    const MeshQuality quality = measured(source, mapped(source.positions, lifted), tray());
    EXPECT_NEAR(quality.figures.off, 0.03, 1e-9);  // √area is 2
    EXPECT_NEAR(quality.figures.uncovered, 0.03, 1e-9);
    EXPECT_EQ(quality.figures.folded, 0.0);
    EXPECT_EQ(quality.figures.creased, 0.0);
    EXPECT_EQ(quality.grade, MeshGrade::kPoor);
    EXPECT_EQ(
        quality.verdict,
        "Poor: details of Tray are missed by 3 % of its size; the vertices lie off Tray by 3 % "
        "of its size.");
    ASSERT_EQ(quality.worst.size(), 5u);
    for (const MeshPlace& place : quality.worst) EXPECT_NEAR(place.distance, 0.03, 1e-9);
}

TEST(MeshQuality, SaysHowMuchStaysBare) {
    const Cloud source = sheet();
    const auto squeezed = [](const Vector3& p) { return Vector3(0.3 * p.x(), p.y(), p.z()); };
    const MeshQuality quality = measured(source, mapped(source.positions, squeezed), tray());
    // All beyond 0.3, and 0.1 (0.05 √area) more on either side.
    const std::string expected = "Poor: ";
    ASSERT_EQ(quality.verdict.find(expected), 0u) << quality.verdict;
    EXPECT_NEAR(std::stod(quality.verdict.substr(expected.size())), 60.0, 3.0);
    EXPECT_NE(quality.verdict.find(" % of Tray stays bare"), std::string::npos);
}

TEST(MeshQuality, AFoldIsItsShareOfTheArea) {
    const Cloud source = sheet();
    const MeshQuality quality = measured(source, mapped(source.positions, swapped), tray());
    // One column of squares lies against the target; the two beside it are twice as wide.
    EXPECT_NEAR(quality.figures.folded, 1.0 / (kTraySide + 2), 1e-9);
    // Two columns of edges bend, of all that have two triangles.
    EXPECT_NEAR(quality.figures.creased, 2.0 / (3.0 * kTraySide - 2.0), 1e-9);
    EXPECT_NEAR(quality.figures.uncovered, 0.0, 1e-9);
    EXPECT_NEAR(quality.figures.off, 0.0, 1e-9);
    ASSERT_FALSE(quality.worst.empty());
    const MeshPlace& place = quality.worst.front();
    EXPECT_EQ(place.flaw, MeshFlaw::kFolded);
    EXPECT_NEAR(place.position.x(), -0.5 * kStep, 0.5 * kStep);
    EXPECT_NEAR(source.positions(place.source, 0), -0.5 * kStep, kStep);
    EXPECT_LT((tray().positions.row(place.target).transpose() - place.position).norm(), kStep);
    for (std::size_t k = 1; k < quality.worst.size(); ++k)
        EXPECT_GT((quality.worst[k].position - place.position).norm(), 0.4 - 1e-9);
}

TEST(MeshQuality, WhatNoFaceReachesIsUncovered) {
    const Cloud source = sheet();
    const auto squeezed = [](const Vector3& p) {
        return Vector3(0.9 * p.x() - 0.1, p.y(), p.z());  // ends at 0.8
    };
    const Feature corner = point_feature("corner", kTraySide * (kTraySide + 1), 0);
    const MeshQuality quality =
        measured(source, mapped(source.positions, squeezed), tray(), {&corner, 1});
    // A tenth of the area lies 0 to 0.2 away: 9 of 10 of that at the percentile.
    EXPECT_NEAR(quality.figures.uncovered, 0.18 / 2.0, 0.001);
    EXPECT_NEAR(quality.figures.off, 0.0, 1e-9);
    ASSERT_GE(quality.worst.size(), 3u);
    double share = 0.0;
    bool named = false;
    for (const MeshPlace& place : quality.worst) {
        EXPECT_EQ(place.flaw, MeshFlaw::kUncovered);
        EXPECT_GT(place.position.x(), 0.8);
        EXPECT_LE(place.distance, 0.1);
        EXPECT_NEAR(source.positions(place.source, 0), 1.0, kStep);
        share += place.share;
        named = named || place.advice.find("\"corner\"") != std::string::npos;
        EXPECT_NE(place.advice.find("more vertices"), std::string::npos) << place.advice;
    }
    EXPECT_LT(share, 0.093);  // all of it that is farther than 0.014
    EXPECT_TRUE(named);
}

TEST(MeshQuality, EdgesThatTheModelsBendThemselvesAreNoCreases) {
    // A roof whose ridge bends by 120°, and a sheet that takes it on.
    const auto roof = [](const Vector3& p) {
        return Vector3(0.5 * p.x(), p.y(), -std::sqrt(3.0) / 2.0 * std::abs(p.x()));
    };
    Cloud target = sheet();
    target.positions = mapped(target.positions, roof);
    const Cloud source = sheet();
    const MeshQuality taken_on = measured(source, target.positions, target);
    EXPECT_EQ(taken_on.figures.creased, 0.0);
    EXPECT_TRUE(taken_on.worst.empty());
    // The other way round the ridge is gone; on a target without one it shows.
    if (!is_watched()) {
        EXPECT_EQ(measured(target, source.positions, source).figures.creased, 0.0);
    }
    const MeshQuality wrong = measured(source, target.positions, source);
    EXPECT_NEAR(wrong.figures.creased, 1.0 / (3.0 * kTraySide - 2.0), 1e-9);
}

TEST(MeshQuality, ABevelOfTheTargetIsNoCrease) {
    // A roof like the one above, whose ridge is flat and half as wide as the squares beside it.
    const auto roof = [](double x, double y) {
        const double slope = std::max(0.0, std::abs(x) - 0.25 * kStep);
        return Vector3(std::copysign(0.5 * slope + 0.25 * kStep, x), y,
                       -std::sqrt(3.0) / 2.0 * slope);
    };
    Cloud target = sheet();
    for (Index i = 0; i < target.size(); ++i) {
        const double x = target.positions(i, 0), y = target.positions(i, 1);
        if (std::abs(x) < 1e-9)
            target.positions.row(i) = roof(-0.25 * kStep, y).transpose();
        else if (std::abs(x - kStep) < 1e-9)
            target.positions.row(i) = roof(0.25 * kStep, y).transpose();
        else
            target.positions.row(i) = roof(x, y).transpose();
    }
    const Cloud source = sheet();
    const Positions ridged = mapped(source.positions, [&](const Vector3& p) -> Vector3 {
        return std::abs(p.x()) < 1e-9 ? Vector3(0, p.y(), 0) : roof(p.x(), p.y());
    });
    EXPECT_EQ(measured(source, ridged, target).figures.creased, 0.0);
    EXPECT_GT(measured(source, ridged, tray()).figures.creased, 0.0);
}

TEST(MeshQuality, ACreaseOnAThinBoardIsOneButItsRimIsNone) {
    const double thickness = 0.02;  // 0.007 √area
    const Cloud side = mesh_shapes::grid(2 * kTraySide);
    const Cloud board = mesh_shapes::together(
        side, mesh_shapes::moved(side, Vector3(1, -1, -1).asDiagonal(), Vector3(0, 0, -thickness)));
    const Cloud source = sheet();
    const MeshQuality crumpled = measured(source, mapped(source.positions, swapped), board);
    // But for the ends of both columns, which are at the rim.
    const double columns = 2.0 / (3.0 * kTraySide - 2.0);
    EXPECT_NEAR(crumpled.figures.creased, 0.9 * columns, 0.1 * columns + 1e-9);
    // Over both sides and about the rim at x = −1.
    const auto over = [&](const Vector3& p) {
        return Vector3(2.0 * std::abs(p.x()) - 1.0, p.y(), p.x() < 0.0 ? -thickness : 0.0);
    };
    EXPECT_EQ(measured(source, mapped(source.positions, over), board).figures.creased, 0.0);
}

TEST(MeshQuality, WhatIsFoldedAtRestIsNoFold) {
    const auto closed = [](const Vector3& p) {
        return Vector3(std::abs(p.x()), p.y(), p.x() < 0.0 ? -1e-3 * p.x() : 0.0);
    };
    Cloud source = sheet();
    const Positions shut = mapped(source.positions, closed);
    EXPECT_GT(measured(source, shut, tray()).figures.folded, 0.0);
    source.positions = shut;
    EXPECT_EQ(measured(source, shut, tray()).figures.folded, 0.0);
}

TEST(MeshQuality, ABareCloudIsASurfaceAsWell) {
    const Cloud source = sheet();
    const auto lifted = [](const Vector3& p) -> Vector3 {
        return swapped(p) + Vector3(0, 0, 0.02);
    };
    const Cloud target = with_normals(tray());
    const Mesh from = make_mesh(source);
    Progress progress;
    const MeshQuality quality = measure_mesh_quality(
        {source, from, mapped(source.positions, lifted)}, {target, nullptr}, {}, progress);
    EXPECT_NEAR(quality.figures.folded, 1.0 / (kTraySide + 2), 1e-9);
    EXPECT_NEAR(quality.figures.off, 0.01, 0.001);
    EXPECT_NEAR(quality.figures.uncovered, 0.01, 0.001);
}

TEST(MeshQuality, IsTheSameAnywhereAtAnySizeAndForAnyNumberOfThreads) {
    SKIP_WHERE_WATCHED();
    const Matrix3 turn = Eigen::AngleAxisd(1.0, Vector3(1, 2, 0).normalized()).toRotationMatrix();
    const auto away = [&](const Vector3& p) -> Vector3 {
        return 1e-3 * (turn * p) + Vector3(7, 8, 9);
    };
    const auto bent = [](const Vector3& p) -> Vector3 {
        return swapped(p) + Vector3(0, 0, 0.02 * std::sin(5.0 * p.y()));
    };
    const Cloud source = sheet(), target = tray();
    const Positions ends = mapped(source.positions, bent);
    const MeshQuality here = measured(source, ends, target);
    Cloud far = target;
    far.positions = mapped(target.positions, away);
    const MeshQuality there = measured(source, mapped(ends, away), far);
    EXPECT_NEAR(there.figures.folded, here.figures.folded, 1e-9);
    EXPECT_NEAR(there.figures.creased, here.figures.creased, 1e-9);
    EXPECT_NEAR(there.figures.uncovered, here.figures.uncovered, 1e-9);
    EXPECT_NEAR(there.figures.off, here.figures.off, 1e-9);
    const ThreadCount one(1);
    const MeshQuality again = measured(source, ends, target);
    EXPECT_EQ(again.figures.off, here.figures.off);
    EXPECT_EQ(again.figures.uncovered, here.figures.uncovered);
    ASSERT_EQ(again.worst.size(), here.worst.size());
    for (std::size_t k = 0; k < here.worst.size(); ++k) {
        EXPECT_EQ(again.worst[k].position, here.worst[k].position);
        EXPECT_EQ(again.worst[k].advice, here.worst[k].advice);
    }
}

TEST(MeshQuality, TheWorstFigureMakesTheGrade) {
    EXPECT_EQ(grade_of({}), MeshGrade::kGood);
    EXPECT_EQ(grade_of({.folded = 1e-3, .creased = 2e-3, .uncovered = 7e-3, .off = 5e-4}),
              MeshGrade::kGood);
    EXPECT_EQ(grade_of({.off = 6e-4}), MeshGrade::kFair);
    EXPECT_EQ(grade_of({.uncovered = 0.021}), MeshGrade::kPoor);
    EXPECT_EQ(grade_of({.folded = 2e-3, .creased = 0.011}), MeshGrade::kPoor);
}

TEST(MeshQuality, TakesWhatHasCollapsedAndLooseVertices) {
    Cloud source = mesh_shapes::grid(10);  // all faces are nearest to every place: it takes long
    source.positions.conservativeResize(source.size() + 1, 3);
    source.positions.bottomRows(1) << 0, 0, 5;
    const Positions nowhere = Positions::Zero(source.size(), 3);
    const MeshQuality quality = measured(source, nowhere, mesh_shapes::grid(20));
    EXPECT_EQ(quality.grade, MeshGrade::kPoor);
    EXPECT_GT(quality.figures.uncovered, 0.3);
    EXPECT_NEAR(quality.figures.off, 0.0, 1e-9);
    EXPECT_EQ(quality.figures.folded, 0.0);
}

TEST(MeshQuality, CanBeCancelled) {
    const Cloud source = sheet(), target = with_normals(tray());
    const Mesh from = make_mesh(source), to = make_mesh(target);
    Progress progress([](std::string_view, double) { return false; }, std::chrono::milliseconds(0));
    progress.poll(0.0);
    EXPECT_THROW(
        measure_mesh_quality({source, from, source.positions}, {target, &to}, {}, progress),
        Cancelled);
}

TEST(Example, MeshQuality) {
    const Cloud source = sheet(), target = with_normals(tray());
    const Mesh source_mesh = make_mesh(source), target_mesh = make_mesh(target);
    const Positions wrapped_vertices = mapped(source.positions, swapped);
    const std::vector<Feature> features;
    Progress progress;
    std::vector<std::string> printed;
    const auto print = [&](const std::string& text) { printed.push_back(text); };
    // --- example
    const MeshQuality quality = measure_mesh_quality({source, source_mesh, wrapped_vertices},
                                                     {target, &target_mesh}, features, progress);
    print(quality.verdict);  // "Poor: 7.1 % of the area of Sheet is folded over; …"
    for (const MeshPlace& place : quality.worst) print(place.advice);
    // --- end of the example
    EXPECT_EQ(printed.front().substr(0, 5), "Poor:");
    EXPECT_EQ(printed.size(), 1 + quality.worst.size());
}

}  // namespace
}  // namespace pointmorph

#include "mesh/wrap_borders.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <string_view>
#include <vector>

#include "mesh_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "processor_time.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// Loose triangles anywhere in a cube.
Cloud loose_triangles(Index count, double size, unsigned seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> anywhere(0.0, 1.0);
    Cloud cloud;
    cloud.positions.resize(3 * count, 3);
    for (Index f = 0; f < count; ++f) {
        const Eigen::RowVector3d at(anywhere(random), anywhere(random), anywhere(random));
        for (Index k = 0; k < 3; ++k)
            cloud.positions.row(3 * f + k) =
                at +
                size * Eigen::RowVector3d(anywhere(random), anywhere(random), anywhere(random));
        mesh_shapes::add_face(cloud.faces, {3 * f, 3 * f + 1, 3 * f + 2});
    }
    return cloud;
}

std::vector<Positions> outlines(const Positions& corners) {
    std::vector<Positions> lines;
    for (Eigen::Index first = 0; first < corners.rows(); first += 3)
        lines.push_back(corners.middleRows(first, 3));
    return lines;
}

/// From a line, or from its sides made longer than they are, which places are put onto.
double distance_to(const Positions& line, const Eigen::RowVector3d& place, bool longer = false) {
    double least = std::numeric_limits<double>::infinity();
    for (Eigen::Index k = 0; k < line.rows(); ++k) {
        const Eigen::RowVector3d from = line.row(k);
        const Eigen::RowVector3d way = line.row((k + 1) % line.rows()) - from;
        double along = (place - from).dot(way) / way.squaredNorm();
        if (!longer) along = std::clamp(along, 0.0, 1.0);
        least = std::min(least, (from + along * way - place).norm());
    }
    return least;
}

TEST(WrapBorders, GoWithTheNearestLine) {
    const Mesh mesh = make_mesh(loose_triangles(60, 0.3, 1));
    const std::vector<Positions> lines = outlines(loose_triangles(80, 0.3, 2).positions);
    Positions start = mesh.positions;
    for (Eigen::Index p = 0; p < start.rows(); ++p)  // most lie near one, and some near none
        start.row(p) = lines[to_size(p / 3)].row(p % 3) + 0.02 * (p / 3 % 5) * start.row(p);
    Progress progress;
    const WrapBorders borders(mesh, start, lines, progress);
    Positions landed = start;
    borders.land(landed);
    int matched = 0;
    for (const std::vector<Index>& border : mesh.borders) {
        const auto mean_distance = [&](const Positions& line) {
            double sum = 0.0;
            for (const Index p : border) sum += distance_to(line, start.row(p));
            return sum / static_cast<double>(border.size());
        };
        const auto nearest = std::ranges::min_element(lines, {}, mean_distance);
        const double distance = mean_distance(*nearest);
        if (distance > 0.049 && distance < 0.051) continue;  // lines are points 0.001 apart
        matched += distance < 0.05;
        for (const Index p : border) {
            if (distance > 0.05)
                EXPECT_EQ(landed.row(p), start.row(p));
            else
                EXPECT_LT(distance_to(*nearest, landed.row(p), true), 1e-9);
        }
    }
    EXPECT_GT(matched, 20);
    EXPECT_LT(matched, 60);
}

TEST(WrapBorders, OfVeryManyPiecesAreFoundAsSoonAsTheirLinesAreMade) {
    SKIP_WHERE_WATCHED();
    constexpr Index kMany = 3000;
    const Mesh mesh = make_mesh(loose_triangles(kMany, 0.02, 1));
    const Mesh without = make_mesh(mesh_shapes::icosphere(1));
    const std::vector<Positions> lines = outlines(loose_triangles(kMany, 0.02, 2).positions);
    const auto time = [&](const Mesh& of) {
        return processor_time([&] {
            Progress progress;
            const WrapBorders borders(of, of.positions, lines, progress);
        });
    };
    // With the distance to each of the lines measured, it is a hundred times as long.
    EXPECT_LT(time(mesh), 25.0 * time(without));
}

TEST(WrapBorders, ThatMeetAtOnePlaceAreFoundAsSoonAsTheirLinesAreMade) {
    SKIP_WHERE_WATCHED();
    constexpr Index kMany = 1500;
    const auto blades = [](double bend) {
        Cloud cloud;
        cloud.positions.resize(2 * kMany + 1, 3);
        cloud.positions.row(2 * kMany).setZero();
        for (Index k = 0; k < 2 * kMany; ++k) {
            const double angle = std::numbers::pi * k / kMany;
            cloud.positions.row(k) << std::cos(angle), std::sin(angle),
                bend * std::sin(3.0 * angle);
            if (k % 2 == 0) mesh_shapes::add_face(cloud.faces, {2 * kMany, k, k + 1});
        }
        return cloud;
    };
    const Mesh mesh = make_mesh(blades(0.1)), without = make_mesh(mesh_shapes::icosphere(1));
    const Mesh target = make_mesh(blades(0.2));
    std::vector<Positions> lines;
    for (const std::vector<Index>& border : target.borders)
        lines.push_back(gather(target.positions, border));
    const auto time = [&](const Mesh& of) {
        return processor_time([&] {
            Progress progress;
            const WrapBorders borders(of, of.positions, lines, progress);
        });
    };
    EXPECT_EQ(lines.size(), to_size(kMany));
    EXPECT_LT(time(mesh), 10.0 * time(without));  // each compared with each: 60 times
}

TEST(WrapBorders, TakeLinesOfAnyLength) {
    // Of points 0.001 apart, there would be 2,000 million.
    Positions line(4, 3);
    line << 0, 0, 0, 1e6, 0, 0, 1e6, 1, 0, 0, 1, 0;
    const Mesh mesh = make_mesh(mesh_shapes::grid(1));
    Positions start(mesh.positions.rows(), 3);
    start << 10, 0.01, 0, 20, 0.01, 0, 30, 0.01, 0, 20, 0.01, 0;
    Progress progress;
    const WrapBorders borders(mesh, start, {line}, progress);
    Positions landed = start;
    borders.land(landed);
    EXPECT_EQ(landed.rows(), 4);
}

TEST(WrapBorders, CanBeCancelled) {
    const Mesh mesh = make_mesh(loose_triangles(10, 0.1, 1));
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(WrapBorders(mesh, mesh.positions, outlines(mesh.positions), progress), Cancelled);
}

}  // namespace
}  // namespace pointmorph

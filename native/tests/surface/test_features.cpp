#include "pointmorph/surface/features.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <numbers>
#include <string_view>

#include "checks.hpp"
#include "marked_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// The message that validate() throws for some features of two spheres of 50 points.
std::string refusal(std::vector<Feature> features) {
    const Cloud source = cloud_of(shapes::sphere(50), "Cow");
    const Cloud target = cloud_of(shapes::sphere(50), "Bull");
    try {
        validate(features, source, target);
    } catch (const FeatureError& error) {
        return error.what();
    }
    return "";
}

TEST(Features, WhatFitsIsTaken) {
    EXPECT_EQ(refusal({}), "");
    EXPECT_EQ(refusal({point_feature("nose", 0, 49), curve("seam", {1, 2, 3}, {4, 5}),
                       curve("belt", {6, 7, 8}, {9, 8, 7, 6}, true, true),
                       region("snout", {{1, 2}, {0.0, 1.0}}, {{3}, {}})}),
              "");
    // Curves that meet in a point, which is a feature as well.
    EXPECT_EQ(refusal({point_feature("nose", 3, 5), curve("a", {1, 2, 3}, {4, 5}, false, true),
                       curve("b", {3, 9}, {5, 8}, false, true)}),
              "");
    // Soft ones may contradict one another.
    EXPECT_EQ(refusal({point_feature("nose", 3, 5), curve("a", {1, 2, 3}, {4, 6})}), "");
}

TEST(Features, EveryBadCaseIsNamed) {
    const auto expect = [](std::vector<Feature> features,
                           std::initializer_list<const char*> parts) {
        const std::string message = refusal(std::move(features));
        for (const char* part : parts)
            EXPECT_NE(message.find(part), std::string::npos) << part << " in " << message;
    };
    Feature two = point_feature("nose", 1, 2);
    two.target.rows.push_back(3);
    expect({two}, {"feature \"nose\"", "one point of Bull", "found 2"});
    expect({point_feature("nose", 50, 0)}, {"Cow, 0 to 49", "point 50"});
    expect({point_feature("nose", 0, -1)}, {"Bull, 0 to 49", "point -1"});
    expect({point_feature("nose", 5, 1), point_feature("chin", 5, 2)},
           {"feature \"chin\"", "a point of its own on Cow", "\"nose\""});
    expect({point_feature("nose", 5, 1), point_feature("nose", 6, 2)}, {"a name of its own"});
    expect({curve("seam", {1}, {2, 3})}, {"2 or more points along the curve on Cow", "found 1"});
    expect({curve("seam", {1, 2, 3}, {2, 3}, true)}, {"3 or more", "closed curve on Bull"});
    expect({curve("seam", {1, 2, 1}, {2, 3})}, {"each point of Cow once", "point 1 twice"});
    expect({curve("seam", {1, 2}, {2, 77})}, {"Bull, 0 to 49", "point 77"});
    expect({region("snout", {}, {{1}, {}})}, {"one or more points of Cow", "none"});
    expect({region("snout", {{1, 1}, {}}, {{1}, {}})}, {"each point of Cow once"});
    expect({region("snout", {{1}, {1.0, 0.5}}, {{1}, {}})}, {"a weight for each of 1", "found 2"});
    expect({region("snout", {{1}, {}}, {{1}, {1.5}})}, {"weights of points from 0 to 1", "1.5"});
    expect({region("snout", {{1}, {}}, {{1}, {std::nan("")}})}, {"from 0 to 1", "nan"});
    expect({region("snout", {{1, 2}, {0.0, 0.0}}, {{1}, {}})}, {"a weight above 0", "none"});
    for (const double weight : {0.0, -1.0, HUGE_VAL, std::nan("")}) {
        Feature light = point_feature("nose", 1, 2);
        light.weight = weight;
        expect({light}, {"a weight above 0"});
    }
    Feature closed = point_feature("nose", 1, 2);
    closed.closed = true;
    expect({closed}, {"a curve, to be closed", "a point"});
    Feature weighted = curve("seam", {1, 2}, {3, 4});
    weighted.source.weights = {1.0, 0.5};
    expect({weighted}, {"weights of points in a region", "curve"});
    expect({point_feature("nose", 3, 5), curve("seam", {1, 3}, {4, 6}, false, true)},
           {"feature \"seam\"", "point 3 of Cow", "point 6", "point 5", "\"nose\""});
    expect({curve("a", {1, 3}, {4, 6}, false, true), curve("b", {2, 9}, {4, 8}, false, true)},
           {"feature \"b\"", "point 4 of Bull", "\"a\""});
    std::vector<Feature> many;
    for (Index k = 0; k <= kMostRegions; ++k)
        many.push_back(region("r" + std::to_string(k), {{k}, {}}, {{k}, {}}));
    expect(many, {"at most 16 regions"});

    Cloud still = cloud_of(shapes::sphere(50), "Cow");
    still.positions.row(2) = still.positions.row(1);
    const std::vector<Feature> short_curve{curve("seam", {1, 2}, {3, 4})};
    EXPECT_THROW(validate(short_curve, still, still), FeatureError);
}

TEST(Features, OrderNamesAndSenseDontMatter) {
    const auto identity = rows_from(0, 100);
    const auto canon = [&](std::vector<Feature> features) {
        return canonical(features, identity, identity);
    };
    const auto same = [](const std::vector<Feature>& a, const std::vector<Feature>& b) {
        return std::ranges::equal(a, b, [](const Feature& x, const Feature& y) {
            return x.kind == y.kind && x.source.rows == y.source.rows &&
                   x.target.rows == y.target.rows && x.source.weights == y.source.weights &&
                   x.hard == y.hard && x.weight == y.weight;
        });
    };
    const auto first =
        canon({point_feature("a", 9, 1), point_feature("b", 2, 3), curve("c", {5, 6, 7}, {8, 9}),
               region("d", {{3, 1}, {0.5, 1.0}}, {{4}, {}})});
    const auto second =
        canon({region("x", {{1, 3}, {1.0, 0.5}}, {{4}, {1.0}}), curve("y", {7, 6, 5}, {9, 8}),
               point_feature("z", 2, 3), point_feature("w", 9, 1)});
    EXPECT_TRUE(same(first, second));
    EXPECT_EQ(first.front().source.rows.front(), 2);
    // A closed curve keeps its first point, and its sense says which way round.
    EXPECT_TRUE(same(canon({curve("c", {5, 6, 7}, {8, 9, 10}, true)}),
                     canon({curve("c", {5, 7, 6}, {8, 10, 9}, true)})));
    EXPECT_FALSE(same(canon({curve("c", {5, 6, 7}, {8, 9, 10}, true)}),
                      canon({curve("c", {5, 6, 7}, {8, 10, 9}, true)})));
    const std::vector<Index> rank{3, 2, 1, 0};
    EXPECT_EQ(canonical(std::vector{point_feature("a", 0, 1)}, rank, rank)[0].source.rows[0], 3);
}

TEST(Features, HardPointsAndEndsArePinned) {
    const std::vector<Feature> features{
        point_feature("a", 1, 2), curve("b", {1, 5, 7}, {2, 8}, false, true),
        curve("c", {10, 11, 12}, {20, 21, 22}, true, true), curve("d", {30, 31}, {32, 33}),
        region("e", {{1}, {}}, {{1}, {}}, true)};
    EXPECT_EQ(pinned_pairs(features), (std::vector<IndexPair>{{1, 2}, {7, 8}, {10, 20}}));
}

TEST(Features, ADenseCurveIsItsPolyline) {
    const Positions p = shapes::grid(21);
    Normals up = Normals::Zero(p.rows(), 3);
    up.col(2).setOnes();
    Progress progress;
    const KdTree<3> tree(p);
    // An L along the border: 0 … 20 along v, then along u.
    std::vector<Index> rows = rows_from(0, 21);
    for (Index u = 1; u < 21; ++u) rows.push_back(u * 21 + 20);
    const TracedCurve open = trace_curve(tree, up, rows, false, progress);
    EXPECT_EQ(open.places.rows(), 41);
    EXPECT_NEAR(open.length(), 4.0, 1e-12);
    EXPECT_NEAR((open.at(0.5) - Vector3(-1, 1, 0)).norm(), 0.0, 1e-12);
    EXPECT_NEAR((open.at(0.25) - Vector3(-1, 0, 0)).norm(), 0.0, 1e-12);
    EXPECT_EQ(open.at(1.0), Vector3(p.row(440).transpose()));
    EXPECT_NEAR(open.share(20), 0.5, 1e-12);
    const TracedCurve around = trace_curve(tree, up, shapes::grid_border(21), true, progress);
    EXPECT_NEAR(around.length(), 8.0, 1e-12);
    EXPECT_NEAR((around.at(1.0) - around.at(0.0)).norm(), 0.0, 1e-12);
}

TEST(Features, SparseMarksAreJoinedAlongTheSurface) {
    // A quarter of a great circle of a sphere, from three marks: the way through the ball is 10 %
    // shorter.
    for (const Index count : {2000, 8000}) {
        const Positions p = shapes::sphere(count) * shapes::rotation(3).transpose();
        const KdTree<3> tree(p);
        const auto nearest = [&](const Vector3& q) {
            Index row;
            double squared;
            tree.nearest(q.data(), {&row, 1}, {&squared, 1});
            return row;
        };
        const std::vector<Index> rows{nearest(Vector3::UnitX()),
                                      nearest(Vector3(1, 1, 0).normalized()),
                                      nearest(Vector3::UnitY())};
        const auto angle = [&](Index i, Index j) { return std::acos(p.row(i).dot(p.row(j))); };
        Progress progress;
        const TracedCurve traced = trace_curve(tree, p, rows, false, progress);
        const double length = angle(rows[0], rows[1]) + angle(rows[1], rows[2]);
        EXPECT_NEAR(traced.length(), length, 0.01 * length);
        for (Index k = 0; k < traced.places.rows(); ++k)
            EXPECT_NEAR(traced.places.row(k).norm(), 1.0, 5.0 / count);
        EXPECT_NEAR(traced.share(1), angle(rows[0], rows[1]) / length, 0.01);
    }
}

TEST(Features, ACurveThatTakesLongCanBeCancelled) {
    const Positions p = shapes::sphere(2000);
    const KdTree<3> tree(p);
    std::vector<Index> rows;  // from side to side
    for (Index k = 0; k < 100; ++k) rows.push_back(k % 2 == 0 ? k : 1999 - k);
    for (const int most : {1, 50, 500}) {
        int asked = 0;
        Progress progress([&](std::string_view, double) { return ++asked < most; },
                          std::chrono::milliseconds(0));
        EXPECT_THROW(trace_curve(tree, p, rows, false, progress), Cancelled);
        EXPECT_EQ(asked, most);
    }
}

TEST(Features, WhereThereIsNoWayAlongTheSurfaceACurveIsStraight) {
    Positions p(600, 3);
    p << shapes::sphere(300), shapes::sphere(300);
    const Normals n = p;
    p.bottomRows(300).col(0).array() += 10.0;
    Progress progress;
    const TracedCurve traced =
        trace_curve(KdTree<3>(p), n, std::vector<Index>{0, 300}, false, progress);
    EXPECT_EQ(traced.places.rows(), 2);
    EXPECT_NEAR(traced.length(), 10.0, 1e-9);
}

TEST(Example, Features) {
    const Cloud source = cloud_of(shapes::sphere(50), "Cow");
    const Cloud target = cloud_of(shapes::sphere(500), "Bull");
    // --- example
    const std::vector<Feature> features{
        point_feature("nose", 17, 403),
        {"seam", FeatureKind::kCurve, {{3, 4, 5}, {}}, {{7, 9}, {}}, false, false},
        {"snout", FeatureKind::kRegion, {{20, 21}, {1.0, 0.5}}, {{40}, {}}, false, false, 2.0}};
    validate(features, source, target);
    // --- end of the example
    EXPECT_EQ(pinned_pairs(features), (std::vector<IndexPair>{{17, 403}}));
}

}  // namespace
}  // namespace pointmorph

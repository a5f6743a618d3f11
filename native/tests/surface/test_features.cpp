#include "pointmorph/surface/features.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>

#include "checks.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/morph/morph.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

std::vector<Index> rows_from(Index first, Index count) {
    std::vector<Index> rows(to_size(count));
    std::iota(rows.begin(), rows.end(), first);
    return rows;
}

Feature curve(std::string name, std::vector<Index> source, std::vector<Index> target,
              bool closed = false, bool hard = false, double weight = 1.0) {
    return {std::move(name),
            FeatureKind::kCurve,
            {std::move(source), {}},
            {std::move(target), {}},
            closed,
            hard,
            weight};
}

Feature region(std::string name, Marked source, Marked target, bool hard = false,
               double weight = 1.0) {
    return {
        std::move(name), FeatureKind::kRegion, std::move(source), std::move(target), false, hard,
        weight};
}

// --- Checks
// ---------------------------------------------------------------------------------------

Cloud cloud_of(Positions positions, std::string name) {
    Cloud cloud;
    cloud.name = std::move(name);
    cloud.positions = std::move(positions);
    return cloud;
}

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

// --- Curves
// ---------------------------------------------------------------------------------------

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

// --- Maps
// -----------------------------------------------------------------------------------------

/// Two ellipsoids. Directions are the sphere's. Rows of the belt come first: points along the
/// equator, the target's turned by `twist`.
struct Belted {
    static constexpr Index kSource = 1250, kTarget = 1000, kBelt = 50, kOtherBelt = 37;
    Positions directions[2];
    Positions positions[2];
    Normals normals[2];
    Feature belt = curve("belt", rows_from(0, kBelt), rows_from(0, kOtherBelt), true);

    explicit Belted(double twist) {
        const Vector3 axes[2] = {{1.0, 0.9, 0.8}, {1.0, 0.7, 0.9}};
        for (int side = 0; side < 2; ++side) {
            const Index count = side == 0 ? kBelt : kOtherBelt;
            const Positions ball = shapes::sphere(side == 0 ? kSource : kTarget) *
                                   shapes::rotation(static_cast<unsigned>(side) + 1).transpose();
            directions[side].resize(count + ball.rows(), 3);
            for (Index k = 0; k < count; ++k) {
                const double angle = 2.0 * std::numbers::pi * k / count + (side == 0 ? 0.0 : twist);
                directions[side].row(k) << std::cos(angle), std::sin(angle), 0.0;
            }
            directions[side].bottomRows(ball.rows()) = ball;
            positions[side] = directions[side] * axes[side].asDiagonal();
            normals[side] = directions[side] * axes[side].cwiseInverse().asDiagonal();
            normals[side].rowwise().normalize();
        }
    }

    Refinement refined(std::span<const Feature> features) const {
        Progress progress;
        return refine(positions[0], normals[0], positions[1], normals[1], features, {}, progress);
    }

    double spacing() const {
        return std::sqrt(estimated_area(KdTree<3>(positions[1])) /
                         static_cast<double>(positions[1].rows()));
    }

    /// Root mean square distance of the source's belt from the same share of the target's, in
    /// spacings: the polyline is all that this needs.
    template <class Maps>
    double error(const Maps& r) const {
        const auto lengths = [&](int side, Index count) {
            std::vector<double> sums{0.0};
            for (Index k = 0; k < count; ++k)
                sums.push_back(
                    sums.back() +
                    (positions[side].row((k + 1) % count) - positions[side].row(k)).norm());
            return sums;
        };
        const auto own = lengths(0, kBelt), other = lengths(1, kOtherBelt);
        double sum = 0.0;
        for (Index k = 0; k < kBelt; ++k) {
            const double along = own[to_size(k)] / own.back() * other.back();
            Index j = 0;
            while (j + 1 < kOtherBelt && other[to_size(j + 1)] <= along) ++j;
            const double part =
                (along - other[to_size(j)]) / (other[to_size(j + 1)] - other[to_size(j)]);
            const Eigen::RowVector3d place =
                (1.0 - part) * positions[1].row(j) + part * positions[1].row((j + 1) % kOtherBelt);
            sum += (r.source_images.row(k) - place).squaredNorm();
        }
        return std::sqrt(sum / kBelt) / spacing();
    }
};

constexpr double kTwist = 40.0 / 180.0 * std::numbers::pi;

TEST(Features, AClosedCurveFollowsTheLengthAroundATwist) {
    SKIP_WHERE_WATCHED();
    const Belted belted(kTwist);
    EXPECT_GT(belted.error(belted.refined({})), 5.0);
    const std::vector<Feature> soft{belted.belt};
    EXPECT_LT(belted.error(belted.refined(soft)), 0.2);
    std::vector<Feature> hard{belted.belt};
    hard[0].hard = true;
    const Refinement r = belted.refined(hard);
    EXPECT_LT(belted.error(r), 0.1);
    EXPECT_EQ(r.source_images.row(0), belted.positions[1].row(0));
    EXPECT_EQ(r.target_images.row(0), belted.positions[0].row(0));
}

TEST(Features, MoreWeightLeavesLessResidual) {
    SKIP_WHERE_WATCHED();
    const Belted belted(kTwist);
    double last = HUGE_VAL;
    for (const double weight : {0.003, 0.03, 0.3, 3.0}) {
        std::vector<Feature> features{belted.belt};
        features[0].weight = weight;
        const double error = belted.error(belted.refined(features));
        EXPECT_LT(error, last) << weight;
        last = error;
    }
    EXPECT_LT(last, 0.1);

    // A point that is asked to go 20 degrees, while the six ends of the axes stay.
    const auto nearest = [&](int side, const Vector3& direction) {
        Index row;
        (belted.directions[side] * direction).maxCoeff(&row);
        return row;
    };
    std::vector<Feature> features;
    for (int axis = 0; axis < 6; ++axis) {
        const Vector3 end = (axis % 2 ? -1.0 : 1.0) * Vector3::Unit(axis / 2);
        features.push_back(point_feature(std::to_string(axis), nearest(0, end), nearest(1, end)));
    }
    const Vector3 here = Vector3(1, 1, 1).normalized(), there = Vector3(1, 1, 2).normalized();
    features.push_back(point_feature("pulled", nearest(0, here), nearest(1, there)));
    const auto offset = [&](const Refinement& r) {
        return (r.source_images.row(features.back().source.rows[0]) -
                belted.positions[1].row(features.back().target.rows[0]))
                   .norm() /
               belted.spacing();
    };
    EXPECT_EQ(offset(belted.refined(features)), 0.0);
    features.back().hard = false;
    last = HUGE_VAL;
    for (const double weight : {0.01, 0.1, 1.0, 10.0}) {
        features.back().weight = weight;
        const double now = offset(belted.refined(features));
        EXPECT_GT(now, 0.0);
        EXPECT_LT(now, 0.8 * last) << weight;
        last = now;
    }
    EXPECT_LT(last, 0.1);
}

TEST(Features, SparseMarksOnACurveDoAsWell) {
    const Belted belted(kTwist);
    std::vector<Feature> features{belted.belt};
    features[0].hard = true;
    features[0].source.rows = {0, 10, 20, 30, 40};
    features[0].target.rows = {0, 9, 18, 27};
    EXPECT_LT(belted.error(belted.refined(features)), 0.5);
}

TEST(Features, AnOpenCurveTakesItsEndsAlong) {
    // Half of the belt onto three eighths of the other.
    const Belted belted(0.0);
    std::vector<Feature> features{curve("arc", rows_from(0, 26), rows_from(0, 15), false, true)};
    const Refinement r = belted.refined(features);
    EXPECT_EQ(r.source_images.row(0), belted.positions[1].row(0));
    EXPECT_EQ(r.source_images.row(25), belted.positions[1].row(14));
    for (Index k = 0; k < 26; ++k) {
        const Vector3 direction =
            (r.source_images.row(k).transpose().array() / Eigen::Array3d(1.0, 0.7, 0.9)).matrix();
        EXPECT_LT(std::abs(direction.normalized().z()), 0.2 * belted.spacing());
    }
}

/// How much of a region's weight is carried into the partner: by the nearest sample to each image.
double carried(const Marked& from, const Marked& to, const Positions& images,
               const Positions& other) {
    Values weight = Values::Zero(other.rows());
    for (std::size_t i = 0; i < to.rows.size(); ++i) weight[to.rows[i]] = to.weight(i);
    const KdTree<3> tree(other);
    double sum = 0.0, all = 0.0;
    for (std::size_t i = 0; i < from.rows.size(); ++i) {
        Index nearest;
        double squared;
        tree.nearest(images.row(from.rows[i]).data(), {&nearest, 1}, {&squared, 1});
        sum += std::min(from.weight(i), weight[nearest]);
        all += from.weight(i);
    }
    return sum / all;
}

/// Points of a Belted side whose direction is closer than `radius` to `center`, weighted by
/// `weight` of the angle's share of the radius.
Marked cap(const Positions& directions, const Vector3& center, double radius,
           const std::function<double(double)>& weight) {
    Marked marked;
    for (Index i = 0; i < directions.rows(); ++i) {
        const double angle = std::acos(std::clamp(directions.row(i).dot(center), -1.0, 1.0));
        if (angle >= radius) continue;
        marked.rows.push_back(i);
        marked.weights.push_back(weight(angle / radius));
    }
    return marked;
}

/// The ends of the axes, but for +z, as features; then the region.
struct Capped : Belted {
    std::vector<Feature> features;

    Capped(
        const Vector3& there, double radius, double other_radius,
        const std::function<double(double)>& weight = [](double) { return 1.0; })
        : Belted(0.0) {
        for (const Vector3& end : {Vector3(1, 0, 0), Vector3(-1, 0, 0), Vector3(0, 1, 0),
                                   Vector3(0, -1, 0), Vector3(0, 0, -1)}) {
            Index rows[2];
            for (int side = 0; side < 2; ++side) (directions[side] * end).maxCoeff(&rows[side]);
            features.push_back(point_feature(std::to_string(features.size()), rows[0], rows[1]));
        }
        features.push_back(region("cap", cap(directions[0], Vector3::UnitZ(), radius, weight),
                                  cap(directions[1], there.normalized(), other_radius, weight)));
    }

    template <class Maps>
    double share(const Maps& r) const {
        const Feature& f = features.back();
        return std::min(carried(f.source, f.target, r.source_images, positions[1]),
                        carried(f.target, f.source, r.target_images, positions[0]));
    }
    std::span<const Feature> points() const { return std::span(features).first(5); }
};

TEST(Features, ARegionGoesIntoItsPartner) {
    SKIP_WHERE_WATCHED();
    const Capped moved(Vector3(0.55, 0.0, 1.0), 0.4, 0.4);
    EXPECT_LT(moved.share(moved.refined(moved.points())), 0.3);
    EXPECT_GE(moved.share(moved.refined(moved.features)), 0.95);

    const Capped grown(Vector3::UnitZ(), 0.35, 0.6);
    EXPECT_LT(grown.share(grown.refined(grown.points())), 0.5);
    EXPECT_GE(grown.share(grown.refined(grown.features)), 0.93);
}

TEST(Features, NoPointOfAHardRegionLeavesIt) {
    Capped moved(Vector3(0.55, 0.0, 1.0), 0.4, 0.5);
    moved.features.back().hard = true;
    EXPECT_EQ(moved.share(moved.refined(moved.features)), 1.0);
}

TEST(Features, MoreWeightBringsMoreOfARegionOver) {
    SKIP_WHERE_WATCHED();
    Capped moved(Vector3(0.55, 0.0, 1.0), 0.4, 0.4);
    double last = moved.share(moved.refined(moved.points()));
    for (const double weight : {0.03, 0.1, 0.5}) {
        moved.features.back().weight = weight;
        const double share = moved.share(moved.refined(moved.features));
        EXPECT_GT(share, last) << weight;
        last = share;
    }
}

TEST(Features, APaintedGradientIsCarriedOntoItself) {
    const Capped faded(Vector3(0.55, 0.0, 1.0), 0.6, 0.6, [](double r) { return 1.0 - r; });
    const Feature& f = faded.features.back();
    const auto mean_difference = [&](const Refinement& r) {
        Values weight = Values::Zero(faded.positions[1].rows());
        for (std::size_t i = 0; i < f.target.rows.size(); ++i)
            weight[f.target.rows[i]] = f.target.weight(i);
        const KdTree<3> tree(faded.positions[1]);
        double sum = 0.0;
        for (std::size_t i = 0; i < f.source.rows.size(); ++i) {
            Index nearest;
            double squared;
            tree.nearest(r.source_images.row(f.source.rows[i]).data(), {&nearest, 1},
                         {&squared, 1});
            sum += std::abs(weight[nearest] - f.source.weight(i));
        }
        return sum / static_cast<double>(f.source.rows.size());
    };
    EXPECT_GT(mean_difference(faded.refined(faded.points())), 0.2);
    EXPECT_LT(mean_difference(faded.refined(faded.features)), 0.05);
}

TEST(Features, RegionsTellThePose) {
    SKIP_WHERE_WATCHED();
    // A ball with nothing on it but three regions, turned.
    const Positions s = shapes::sphere(1500), t = shapes::sphere(1200) * shapes::rotation(9);
    const Matrix3 turn = shapes::rotation(7);
    std::vector<Feature> features;
    for (int k = 0; k < 3; ++k) {
        const Vector3 center = Vector3(k == 0, k == 1, 0.3 * k).normalized();
        const auto whole = [](double) { return 1.0; };
        features.push_back(region(std::to_string(k), cap(s, center, 0.3, whole),
                                  cap(t, turn * center, 0.3, whole)));
    }
    Progress progress;
    const Refinement r = refine(s, s, t, t, features, {}, progress);
    EXPECT_LT((r.source_images - s * turn.transpose()).rowwise().norm().mean(), 0.1);
}

// --- The whole morph
// ------------------------------------------------------------------------------

MorphInput input_of(const Belted& shape, std::vector<Feature> features) {
    MorphInput input{cloud_of(shape.positions[0], "Cow"),
                     cloud_of(shape.positions[1], "Bull"),
                     std::move(features),
                     {},
                     {},
                     {}};
    input.source.normals = shape.normals[0];
    input.target.normals = shape.normals[1];
    return input;
}

TEST(Features, TheMapIsTheSameHoweverTheyAreNamedAndOrderedAndForAnyThreadCount) {
    SKIP_WHERE_WATCHED();
    const Capped capped(Vector3(0.3, 0.0, 1.0), 0.4, 0.4);
    std::vector<Feature> features = capped.features;
    features.push_back(curve("arc", rows_from(0, 20), rows_from(0, 15), false, true));
    features.push_back(curve("belt", rows_from(30, 10), rows_from(25, 8)));
    features[0].hard = false;
    const auto maps = [&](std::vector<Feature> given, int threads) {
        Progress progress;
        MorphOptions options;
        options.threads = threads;
        const Morph morph(input_of(capped, std::move(given)), options, progress);
        return std::tuple{morph.source_to_target(progress), morph.target_to_source(progress),
                          morph.pairs()};
    };
    const auto first = maps(features, 1);
    EXPECT_EQ(first, maps(features, 3));
    std::ranges::reverse(features);
    int number = 0;
    for (Feature& f : features) {
        f.name = "name " + std::to_string(number++);
        if (f.kind != FeatureKind::kCurve) continue;
        std::ranges::reverse(f.source.rows);
        std::ranges::reverse(f.target.rows);
    }
    EXPECT_EQ(first, maps(features, 2));
}

TEST(Features, TheReportHasAResidualForEach) {
    const Capped capped(Vector3(0.3, 0.0, 1.0), 0.4, 0.4);
    std::vector<Feature> features = capped.features;
    features.push_back(curve("arc", rows_from(0, 20), rows_from(0, 15), false, true));
    features[1].hard = false;
    Progress progress;
    const Morph morph(input_of(capped, features), {}, progress);
    EXPECT_EQ(morph.report().feature_residual, 0.0);
    const auto& kept = morph.quality(progress).features;
    ASSERT_EQ(kept.size(), features.size());
    for (std::size_t k = 0; k < kept.size(); ++k) {
        EXPECT_EQ(kept[k].name, features[k].name);
        EXPECT_EQ(kept[k].kind, features[k].kind);
        EXPECT_EQ(kept[k].hard, features[k].hard);
    }
    EXPECT_EQ(kept[0].residual, 0.0);
    EXPECT_GT(kept[1].residual, 0.0);
    EXPECT_LT(kept[1].residual, 0.5);
    const RefinementStart r{morph.source_to_target(progress), morph.target_to_source(progress)};
    EXPECT_NEAR(kept[5].inside, capped.share(r), 1e-9);
    EXPECT_LT(kept[5].residual, 0.2);
    EXPECT_LT(kept[6].residual, 0.5);  // the points on it want it a little elsewhere
}

TEST(Features, AnEarlierMapIsPulledToACurve) {
    // Earlier, directions stayed: the belts lie 40 degrees apart.
    const Belted belted(kTwist);
    const Vector3 axes(1.0, 0.7, 0.9), others(1.0, 0.9, 0.8);
    const RefinementStart start{belted.directions[0] * axes.asDiagonal(),
                                belted.directions[1] * others.asDiagonal()};
    EXPECT_GT(belted.error(start), 5.0);
    MorphInput input = input_of(belted, {belted.belt});
    input.start = start;
    Progress progress;
    const Morph after(std::move(input), {}, progress);
    EXPECT_LT(belted.error(RefinementStart{after.source_to_target(progress), {}}), 0.3);
}

// --- Method paper
// ---------------------------------------------------------------------------------

Cloud sheet(Index side, double bump) {
    Cloud cloud = cloud_of(shapes::grid(side), "sheet");
    for (Index i = 0; i < cloud.size(); ++i)
        cloud.positions(i, 2) = bump * std::exp(-4.0 * cloud.positions.row(i).squaredNorm());
    return cloud;
}

MorphOptions paper() {
    MorphOptions options;
    options.method = Method::kPaper;
    return options;
}

TEST(Features, MethodPaperTakesPointsOfACurve) {
    // The middle line of one sheet onto a line beside the middle of the other.
    std::vector<Index> here, there;
    for (Index v = 10; v <= 30; ++v) here.push_back(20 * 41 + v);
    for (Index v = 8; v <= 24; ++v) there.push_back(20 * 33 + v);
    Progress progress;
    const auto residual = [&](std::vector<Feature> features) {
        const Morph morph({sheet(41, 0.0), sheet(33, 0.4), features, {}, {}, {}}, paper(),
                          progress);
        const Cloud &s = morph.source(), &t = morph.target();
        return feature_residuals(
                   std::vector{curve("line", here, there)},
                   {KdTree<3>(s.positions), s.normals, morph.source_to_target(progress)},
                   {KdTree<3>(t.positions), t.normals, morph.target_to_source(progress)}, progress)
            .front()
            .residual;
    };
    const double without = residual({});
    EXPECT_GT(without, 2.0);
    EXPECT_LT(residual({curve("line", here, there)}), 0.3 * without);

    const Morph morph({sheet(41, 0.0), sheet(33, 0.4), {curve("line", here, there)}, {}, {}, {}},
                      paper(), progress);
    EXPECT_TRUE(checks::mentions(morph.report().warnings, "no soft features"));
}

TEST(Features, MethodPaperRefusesRegions) {
    Progress progress;
    const Feature spot = region("spot", {{5, 6}, {}}, {{7}, {}});
    try {
        const Morph morph({sheet(21, 0.0), sheet(21, 0.4), {spot}, {}, {}, {}}, paper(), progress);
        FAIL();
    } catch (const FeatureError& error) {
        EXPECT_NE(std::string(error.what()).find("Only method auto knows regions"),
                  std::string::npos);
    }
    // The refinement behind the disk knows them.
    MorphOptions options;
    options.domain = Domain::kDisk;
    EXPECT_NO_THROW(Morph({sheet(21, 0.0), sheet(21, 0.4), {spot}, {}, {}, {}}, options, progress));
}

TEST(Features, ALoopIsOfPoints) {
    Progress progress;
    const std::vector<Feature> features{point_feature("a", 0, 0), point_feature("b", 1, 1),
                                        curve("c", {2, 3}, {2, 3})};
    EXPECT_THROW(
        Morph({sheet(21, 0.0), sheet(21, 0.4), features, {"a", "b", "c"}, {}, {}}, {}, progress),
        FeatureError);
}

TEST(Features, MarksOnHopelessCloudsStillGiveFiniteMaps) {
    Positions line = Positions::Zero(40, 3);
    line.col(0).setLinSpaced(40, 0.0, 1.0);
    const Normals up = Vector3::UnitZ().transpose().replicate(40, 1);
    const Positions same = Positions::Constant(40, 3, 7.0), noise = shapes::cube_noise(40);
    const std::vector<Feature> features{point_feature("a", 0, 0), curve("b", {1, 9, 5}, {4, 2}),
                                        curve("c", {6, 7, 8}, {5, 6, 7}, true, true),
                                        region("d", {{10, 11}, {}}, {{12}, {}}, true)};
    Progress progress;
    for (const Positions& p : {line, noise})
        for (const Positions& q : {line, noise}) {
            const Refinement r = refine(p, up, q, up, features, {}, progress);
            EXPECT_TRUE(r.source_images.allFinite());
            EXPECT_TRUE(r.target_images.allFinite());
        }
    const std::vector<Feature> without{features[0], features[3]};
    const Refinement r = refine(same, up, same, up, without, {}, progress);
    EXPECT_TRUE(r.source_images.allFinite());
}

}  // namespace
}  // namespace pointmorph

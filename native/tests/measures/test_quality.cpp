#include "pointmorph/measures/quality.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "measures/mapped.hpp"
#include "measures/measured_map.hpp"
#include "measures/place_words.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

/// Two clouds and a map between them that is known.
struct Case {
    Cloud source, target;
    Positions source_images, target_images;
    Pairing pairs;
    std::vector<Feature> features;

    TwoWayMap map() const { return {source, target, source_images, target_images, pairs}; }

    Quality measure() const {
        Progress progress;
        return measure_quality(map(), features, progress);
    }
};

Cloud cloud(std::string name, const Positions& positions, const Function& normal) {
    return {std::move(name), positions, mapped(positions, normal), {}, {}};
}

Vector3 up(const Vector3& /*place*/) {
    return {0.0, 0.0, 1.0};
}

/// Rows of one place are pairs: where both clouds have the same parameters.
Case of_same_rows(Cloud source, Cloud target, Positions source_images, Positions target_images) {
    Case result{std::move(source),
                std::move(target),
                std::move(source_images),
                std::move(target_images),
                {},
                {}};
    for (Index i = 0; i < result.source.size(); ++i) result.pairs.push_back({i, i});
    return result;
}

constexpr Index kSide = 81;

/// The plane [−1, 1]² onto itself.
Case plane(const Function& there, const Function& back) {
    const Positions p = shapes::grid(kSide);
    return of_same_rows(cloud("Sheet", p, up), cloud("Tray", p, up), mapped(p, there),
                        mapped(p, back));
}

Vector3 stay(const Vector3& p) {
    return p;
}

/// x runs back from 0 to −¼ where it should go on to ¼.
Vector3 fold(const Vector3& p) {
    const double x = p.x() < 0.0 ? p.x() : p.x() < 0.25 ? -p.x() : (5.0 * p.x() - 2.0) / 3.0;
    return {x, p.y(), p.z()};
}

Index row_at(double x, double y) {
    const auto step = [](double at) {
        return to_index(std::lround((at + 1.0) / 2.0 * (kSide - 1)));
    };
    return step(x) * kSide + step(y);
}

TEST(Quality, NothingIsWrongWhereNothingMoves) {
    const Quality quality = plane(stay, stay).measure();
    for (const auto& figures : {quality.source_to_target, quality.target_to_source}) {
        EXPECT_NEAR(figures.dirichlet, 1.0, 1e-9);
        EXPECT_NEAR(figures.stretch_p99, 1.0, 1e-9);
        EXPECT_NEAR(figures.conformal_median, 1.0, 1e-9);
        EXPECT_EQ(figures.flipped, 0.0);
        EXPECT_EQ(figures.collapsed, 0.0);
        EXPECT_NEAR(figures.round_trip_p99, 0.0, 1e-9);
        EXPECT_EQ(figures.coverage, 1.0);
    }
    EXPECT_LT(quality.source.distortion.maxCoeff(), 1e-6);
    EXPECT_TRUE(quality.worst.empty());
}

TEST(Quality, AStretchedPlaneHasTheSingularValuesOfTheStretch) {
    // Four times as long, sampled four times as densely along it: 2 and 1/2 at unit areas.
    const Positions source = shapes::grid(41);
    Positions target(161 * 41, 3);
    for (Index u = 0; u < 161; ++u)
        for (Index v = 0; v < 41; ++v)
            target.row(u * 41 + v) << u / 20.0 - 4.0, v / 20.0 - 1.0, 0.0;
    const auto longer = [](const Vector3& p) { return Vector3(4.0 * p.x(), p.y(), p.z()); };
    const auto shorter = [](const Vector3& p) { return Vector3(p.x() / 4.0, p.y(), p.z()); };
    Case one{cloud("Short", source, up),
             cloud("Long", target, up),
             mapped(source, longer),
             mapped(target, shorter),
             {},
             {}};
    const Quality quality = one.measure();
    for (const auto* points : {&quality.source, &quality.target})
        for (Eigen::Index i = 0; i < points->stretch.rows(); ++i) {
            ASSERT_NEAR(points->stretch(i, 0), 2.0, 0.06);
            ASSERT_NEAR(points->stretch(i, 1), 0.5, 0.015);
            ASSERT_NEAR(points->distortion[i], std::log(2.0), 0.03);
            ASSERT_LT(points->round_trip[i], 1e-9);
        }
    for (const auto& figures : {quality.source_to_target, quality.target_to_source}) {
        // edges along the border, of which there is more across the stretch, outweigh others
        EXPECT_NEAR(figures.dirichlet, (4.0 + 0.25) / 2.0, 0.15);
        EXPECT_NEAR(figures.stretch_p99, 2.0, 0.06);
        EXPECT_NEAR(figures.conformal_median, (4.0 + 0.25) / 2.0, 1e-6);
    }
    EXPECT_TRUE(quality.worst.empty());
}

/// Every point once more, beside itself by rounding; both have their own images.
TEST(Quality, TakesBothSidesOfASeamForOnePlace) {
    const Positions sheet = shapes::grid(kSide);
    Positions twice(2 * sheet.rows(), 3), images(twice.rows(), 3);
    twice << sheet, sheet.array() + 1e-7;
    images << sheet, sheet.array() + 2e-3;
    const Case rounded =
        of_same_rows(cloud("Sheet", twice, up), cloud("Tray", images, up), images, twice);
    EXPECT_LT(rounded.measure().source_to_target.stretch_p99, 1.3);
}

TEST(Quality, OfASphereThatBecomesAnEllipsoid) {
    const Vector3 axes(2.0, 1.0, 0.7);
    const Positions p = shapes::sphere(12000);
    const auto there = [&](const Vector3& x) -> Vector3 { return axes.cwiseProduct(x); };
    const auto normal = [&](const Vector3& x) -> Vector3 {
        return x.cwiseQuotient(axes.cwiseProduct(axes));
    };
    const Positions ellipsoid = mapped(p, there);  // its normals are gradients, of any length
    const Quality quality =
        of_same_rows(cloud("Ball", p, stay), cloud("Egg", ellipsoid, normal), ellipsoid, p)
            .measure();

    // The spiral is even, so that the mean over points is that over the sphere.
    Eigen::MatrixX2d expected(p.rows(), 2);
    for (Eigen::Index i = 0; i < p.rows(); ++i) {
        const Vector3 n = p.row(i), a = n.unitOrthogonal(), b = n.cross(a);
        Eigen::Matrix<double, 3, 2> jacobian;
        jacobian << there(a), there(b);
        expected.row(i) = jacobian.jacobiSvd().singularValues();
    }
    expected /= std::sqrt(expected.rowwise().prod().mean());
    std::vector<double> errors;
    for (Eigen::Index i = 0; i < p.rows(); ++i)
        for (const int k : {0, 1})
            errors.push_back(std::abs(quality.source.stretch(i, k) / expected(i, k) - 1.0));
    std::ranges::sort(errors);
    EXPECT_LT(errors[errors.size() * 99 / 100], 0.04);
    EXPECT_NEAR(quality.source_to_target.dirichlet, expected.rowwise().squaredNorm().mean() / 2.0,
                0.06);
    EXPECT_EQ(quality.source_to_target.flipped, 0.0);
    EXPECT_LT(quality.source_to_target.round_trip_p99, 1e-9);  // samples land on samples
    for (Eigen::Index i = 0; i < p.rows(); ++i)
        ASSERT_NEAR(quality.target.stretch(i, 0) * quality.source.stretch(i, 1), 1.0, 0.03);
}

TEST(Quality, AFoldIsFlippedBetweenItsCreases) {
    const Quality quality = plane(fold, stay).measure();
    const Positions p = shapes::grid(kSide);
    const double margin = 3.0 * 2.0 / (kSide - 1);
    for (Eigen::Index i = 0; i < p.rows(); ++i) {
        const double x = p(i, 0);
        const auto flipped = quality.source.flipped[to_size(i)];
        if (x > margin && x < 0.25 - margin) {
            ASSERT_EQ(flipped, 1) << x;
        } else if (x < -margin || x > 0.25 + margin) {
            ASSERT_EQ(flipped, 0) << x;
        }
    }
    EXPECT_NEAR(quality.source_to_target.flipped, 0.125, 0.125 * margin / 0.25);
    EXPECT_EQ(quality.target_to_source.flipped, 0.0);
    EXPECT_TRUE(std::ranges::any_of(quality.worst, [&](const Place& place) {
        return place.flaw == Flaw::kFolded && std::abs(p(place.source, 0) - 0.125) < 0.125 + margin;
    }));
    for (const Place& place : quality.worst) EXPECT_GT(p(place.source, 0), -0.25 - margin);
}

TEST(Quality, AMirroredMapIsSaidToBeOneAsAWhole) {
    const auto mirror = [](const Vector3& p) { return Vector3(p.x(), -p.y(), p.z()); };
    Case one = plane(mirror, mirror);
    one.pairs.clear();
    const Quality quality = one.measure();
    EXPECT_EQ(quality.source_to_target.flipped, 1.0);
    EXPECT_LT(quality.source.distortion.maxCoeff(), 1e-6);
    ASSERT_EQ(quality.worst.size(), 1u);
    EXPECT_EQ(quality.worst[0].flaw, Flaw::kMirrored);
}

TEST(Quality, AMirroredPatchIsFoldedThereOnly) {
    const auto inside = [](const Vector3& p) { return p.head<2>().norm() < 0.3; };
    const auto mirror = [&](const Vector3& p) -> Vector3 {
        return inside(p) ? Vector3(p.x(), -p.y(), p.z()) : p;
    };
    const Quality quality = plane(mirror, mirror).measure();
    const double share = std::numbers::pi * 0.3 * 0.3 / 4.0;
    EXPECT_NEAR(quality.source_to_target.flipped, share, 0.3 * share);
    EXPECT_NEAR(quality.source_to_target.coverage, 1.0, 0.01);
    ASSERT_FALSE(quality.worst.empty());
    EXPECT_EQ(quality.worst[0].flaw, Flaw::kFolded);
    EXPECT_GT(quality.worst[0].share, 0.2 * share);  // what lies close to the worst point
    EXPECT_LT(quality.worst[0].share, 1.2 * share);
    const auto row = quality.worst[0].source;
    EXPECT_LT(shapes::grid(kSide).row(row).norm(), 0.4);
}

TEST(Quality, ADiscThatCollapsesToALineIsLostOnTheOtherSide) {
    const auto inside = [](const Vector3& p) { return p.head<2>().norm() < 0.5; };
    const auto flat = [&](const Vector3& p) -> Vector3 {
        return inside(p) ? Vector3(p.x(), 0.0, 0.0) : p;
    };
    const Quality quality = plane(flat, stay).measure();
    const double share = std::numbers::pi * 0.25 / 4.0;
    const double rim = 2.0 * std::numbers::pi * 0.5 * 4.0 / (kSide - 1) / 4.0;
    EXPECT_NEAR(quality.source_to_target.collapsed, share, rim);
    EXPECT_NEAR(quality.source_to_target.coverage, 1.0 - share, rim + 0.06);
    EXPECT_EQ(quality.target_to_source.collapsed, 0.0);
    ASSERT_FALSE(quality.worst.empty());
    const auto& sheet = shapes::grid(kSide);
    for (const Place& place : quality.worst)
        EXPECT_LT(std::min(sheet.row(place.source).norm(), sheet.row(place.target).norm()), 0.6);
}

TEST(Quality, TheRoundTripIsTheDistanceInRootsOfTheArea) {
    const auto shift = [](const Vector3& p) { return Vector3(p.x(), p.y() + 0.2, p.z()); };
    const Quality quality = plane(stay, shift).measure();
    // neighbors that the border lacks make the area seem a tenth larger
    EXPECT_NEAR(quality.source_to_target.round_trip_mean, 0.2 / 2.0, 0.006);
    EXPECT_NEAR(quality.target_to_source.round_trip_mean, 0.2 / 2.0, 0.006);
    EXPECT_NEAR(quality.source_to_target.round_trip_p99, 0.2 / 2.0, 0.006);
    ASSERT_FALSE(quality.worst.empty());
    EXPECT_EQ(quality.worst[0].flaw, Flaw::kLost);
}

TEST(Quality, PlacesNameTheModelThatTheyAreOn) {
    const auto half = [](const Vector3& p) { return Vector3(0.5 * (p.x() - 1.0), p.y(), p.z()); };
    const auto lost_on = [](const Quality& quality, bool on_source) {
        return std::ranges::count_if(quality.worst, [&](const Place& place) {
            return place.flaw == Flaw::kLost && place.on_source == on_source;
        });
    };
    const Quality there = plane(half, stay).measure(), back = plane(stay, half).measure();
    EXPECT_GT(lost_on(there, false), 0);
    EXPECT_GT(lost_on(back, true), 0);
}

TEST(Quality, OnlyAllOfItIs100Percent) {
    EXPECT_EQ(percent(0.994), "99 %");
    EXPECT_EQ(percent(0.996), "99.6 %");
    EXPECT_EQ(percent(0.9996), "99.96 %");
    EXPECT_EQ(percent(0.99999), "over 99.99 %");
    EXPECT_EQ(percent(1.0 - 1e-12), "100 %");
    EXPECT_EQ(percent(1.0), "100 %");
    EXPECT_EQ(percent(0.0), "0 %");
}

TEST(Quality, CoverageIsTheShareThatIsReached) {
    const auto half = [](const Vector3& p) { return Vector3(0.5 * (p.x() - 1.0), p.y(), p.z()); };
    const Quality quality = plane(half, stay).measure();
    const double two_spacings = 2.0 * 2.0 / (kSide - 1);
    EXPECT_NEAR(quality.source_to_target.coverage, (1.0 + two_spacings) / 2.0, 0.03);
    EXPECT_EQ(quality.target_to_source.coverage, 1.0);
}

TEST(Quality, WhatLiesAtAnEndOfTheOtherIsNoBadPlace) {
    // The left half of a sheet, to which the right half of the whole one can only go by its border.
    const Positions whole = shapes::grid(kSide);
    const Index half = row_at(0.0, 1.0) + 1;
    const auto clamped = [](const Vector3& p) {
        return Vector3(std::min(p.x(), 0.0), p.y(), p.z());
    };
    Case one{cloud("Half", whole.topRows(half), up),
             cloud("Whole", whole, up),
             whole.topRows(half),
             mapped(whole, clamped),
             {},
             {}};
    const auto on_the_right = [&](const Quality& quality) {
        return std::ranges::count_if(
            quality.worst, [&](const Place& place) { return whole(place.target, 0) > 0.1; });
    };
    EXPECT_GT(on_the_right(one.measure()), 0);
    std::vector<Index> border;
    for (Index v = 0; v < kSide; ++v) border.push_back(half - kSide + v);
    TwoWayMap map = one.map();
    map.source_ends = border;
    Progress progress;
    EXPECT_EQ(on_the_right(measure_quality(map, {}, progress)), 0);
    // Elsewhere, places are as bad as before.
    one.target_images = mapped(
        whole, [&](const Vector3& p) { return fold(clamped(p) * 0.5 + Vector3(0.25, 0, 0)); });
    EXPECT_FALSE(one.measure().worst.empty());
    map.source_ends = border;
    EXPECT_FALSE(measure_quality(map, {}, progress).worst.empty());
}

TEST(Quality, BothSidesOfAThinSheetAreToldApartByTheirPairs) {
    // A sheet with two sides a tenth of a spacing apart, and images a little off the wrong way.
    const Positions upper = shapes::grid(41);
    const double gap = 0.1 * 2.0 / 40.0;
    Positions p(2 * upper.rows(), 3);
    p << upper, upper.rowwise() - Eigen::RowVector3d(0.0, 0.0, gap);
    Cloud thin{"Leaf", p, Positions::Zero(p.rows(), 3), {}, {}};
    Positions images = p;
    for (Eigen::Index i = 0; i < p.rows(); ++i) {
        const bool top = i < upper.rows();
        thin.normals(i, 2) = top ? 1.0 : -1.0;
        images(i, 2) += top ? -0.8 * gap : 0.8 * gap;
    }
    Case one = of_same_rows(thin, thin, images, images);
    EXPECT_EQ(one.measure().source_to_target.flipped, 0.0);
}

TEST(Quality, AdviceNamesTheFeaturesAround) {
    Case one = plane(fold, stay);
    one.features = {point_feature("nose", row_at(-0.3, 0.0), row_at(-0.3, 0.0)),
                    point_feature("ear", row_at(0.5, 0.0), row_at(0.5, 0.0)),
                    point_feature("heel", row_at(-0.9, 0.9), row_at(-0.9, 0.9))};
    // only the middle of the band is folded
    for (Eigen::Index i = 0; i < one.source_images.rows(); ++i)
        if (std::abs(one.source.positions(i, 1)) > 0.2)
            one.source_images.row(i) = one.source.positions.row(i);
    const Quality quality = one.measure();
    ASSERT_FALSE(quality.worst.empty());
    const std::string& advice = quality.worst[0].advice;
    for (const char* words : {"Between ", "\"nose\"", "\"ear\""})
        EXPECT_NE(advice.find(words), std::string::npos) << advice;
    EXPECT_NE(advice.find("mark a feature there on both models"), std::string::npos) << advice;

    one.features = {point_feature("cheek", quality.worst[0].source, quality.worst[0].target)};
    const std::string there = one.measure().worst[0].advice;
    EXPECT_NE(there.find("At \"cheek\""), std::string::npos) << there;

    one.features.clear();
    const std::string without = one.measure().worst[0].advice;
    EXPECT_NE(without.find("of Sheet"), std::string::npos) << without;
}

TEST(Quality, IsTheSameForAnyNumberOfThreadsScalePlaceAndOrientation) {
    const Case one = plane(fold, stay);
    const Quality quality = one.measure();
    for (const int count : {1, 3}) {
        const ThreadCount threads(count);
        const Quality again = one.measure();
        EXPECT_EQ(again.source.distortion, quality.source.distortion);
        EXPECT_EQ(again.source.round_trip, quality.source.round_trip);
        EXPECT_EQ(again.target.stretch, quality.target.stretch);
        EXPECT_EQ(again.source_to_target.dirichlet, quality.source_to_target.dirichlet);
        EXPECT_EQ(again.worst.size(), quality.worst.size());
    }
    const Matrix3 turn = shapes::rotation(5);
    const auto move = [&](const Positions& p) -> Positions {
        return (1e-3 * p * turn.transpose()).rowwise() + Eigen::RowVector3d(3.0, 4.0, 5.0);
    };
    Case moved = one;
    moved.target.positions = move(one.target.positions);
    moved.target.normals = one.target.normals * turn.transpose();
    moved.source_images = move(one.source_images);
    const Quality there = moved.measure();
    EXPECT_LT((there.source.stretch - quality.source.stretch).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_LT((there.source.round_trip - quality.source.round_trip).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_EQ(there.source.flipped, quality.source.flipped);
}

TEST(Quality, DuplicatesAndLinesGiveNumbersToo) {
    Positions p = shapes::grid(21);
    p.topRows(60).rowwise() = p.row(0).eval();                       // coincident
    for (Index i = 0; i < 40; ++i) p.row(400 + i) << 9.0 + i, 0, 0;  // on a line
    const Quality quality = of_same_rows(cloud("Odd", p, up), cloud("Odd", p, up), p, p).measure();
    EXPECT_TRUE(quality.source.distortion.allFinite());
    EXPECT_TRUE(quality.source.stretch.allFinite());
    EXPECT_EQ(quality.source.measured[0], 0);
    EXPECT_EQ(quality.source.measured[425], 0);
    EXPECT_TRUE(std::isfinite(quality.source_to_target.dirichlet));
}

TEST(Quality, IsTheSameWithKnownNeighborsAndInAnyOrderOfThePoints) {
    const Case one = plane(fold, stay);
    const Quality found = one.measure();
    Progress progress;
    const auto near_source = ordered_neighbors(one.source.positions, 24, progress);
    const auto near_target = ordered_neighbors(one.target.positions, 16, progress);
    TwoWayMap map = one.map();
    map.source_neighbors = &near_source;
    map.target_neighbors = &near_target;
    const Quality known = measure_quality(map, {}, progress);
    EXPECT_EQ(known.source.distortion, found.source.distortion);
    EXPECT_EQ(known.target.reached, found.target.reached);

    const auto order = shapes::permutation(one.source.size(), 3);
    const auto moved = [&](const Cloud& cloud) {
        return Cloud{
            cloud.name, gather(cloud.positions, order), gather(cloud.normals, order), {}, {}};
    };
    const Case shuffled =
        of_same_rows(moved(one.source), moved(one.target), gather(one.source_images, order),
                     gather(one.target_images, order));
    const Quality again = shuffled.measure();
    EXPECT_EQ(again.source.flipped, gather(found.source.flipped, order));
    EXPECT_EQ(again.source.reached, gather(found.source.reached, order));
    EXPECT_LT((again.source.stretch - gather(found.source.stretch, order)).cwiseAbs().maxCoeff(),
              1e-9);
}

TEST(Quality, ReachedIsAsBruteForceSays) {
    const Case one =
        plane([](const Vector3& p) { return Vector3(0.7 * p.x(), p.y(), p.z()); }, stay);
    const Quality quality = one.measure();
    Progress progress;
    const Positions& p = one.source.positions;
    const Values spacing = local_spacing(p, nearest_neighbors(KdTree<3>(p), 16, progress));
    Index reached = 0;
    for (Index i = 0; i < p.rows(); ++i) {
        Index nearest = 0;
        const double distance =
            (one.source_images.rowwise() - p.row(i)).rowwise().norm().minCoeff(&nearest);
        const bool near = distance <= 2.0 * std::max(spacing[i], spacing[nearest]);
        EXPECT_EQ(quality.target.reached[to_size(i)], near ? 1 : 0) << i;
        reached += near;
    }
    EXPECT_LT(reached, p.rows());
    EXPECT_GT(reached, 0);
}

TEST(Quality, TheNearestPointToAnImageIsAsBruteForceSays) {
    // Images lie on the surface, off it, and far from what they are paired with.
    const Positions p = shapes::sphere(3000);
    Positions images = p + 0.02 * Positions::Random(p.rows(), 3);
    for (Eigen::Index i = 0; i < p.rows(); i += 3) images.row(i) = p.row((i + 700) % p.rows());
    for (Eigen::Index i = 1; i < p.rows(); i += 30) images.row(i) *= 1.3;
    const Case one = of_same_rows(cloud("A", p, stay), cloud("B", p, stay), images, p);
    Progress progress;
    const OrderedNeighbors near = ordered_neighbors(p, 16, progress);
    MeasuredCloud from(one.source, near), to(one.target, near);
    const MeasuredMaps maps = measure_maps(from, to, one.map(), progress);
    Index compared = 0;
    for (Index i = 0; i < from.size(); ++i) {
        Index nearest = 0;
        (to.positions.rowwise() - maps.there.images.row(i))
            .rowwise()
            .squaredNorm()
            .minCoeff(&nearest);
        if (!(to.normals.row(nearest).dot(to.normals.row(i)) > 0.0)) continue;
        EXPECT_EQ(maps.there.foot[to_size(i)], nearest) << i;
        ++compared;
    }
    EXPECT_GT(compared, 2000);
}

TEST(Quality, QuantilesAreNumbersInOrder) {
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> even(-1.0, 1.0);
    const std::vector<std::function<double(std::size_t)>> kinds{
        [&](std::size_t) { return even(random); },
        [&](std::size_t) { return std::exp(20.0 * even(random)); },
        [&](std::size_t) { return std::floor(3.0 * even(random)); },
        [](std::size_t i) { return i % 32 == 0 ? 1e3 : static_cast<double>(i); },  // few mislead
        [](std::size_t) { return 2.0; }};
    for (const auto& kind : kinds)
        for (const std::size_t count : {1U, 2U, 1000U, 3201U, 50000U}) {
            std::vector<double> values;
            for (std::size_t i = 0; i < count; ++i) values.push_back(kind(i));
            std::vector<double> sorted = values;
            std::ranges::sort(sorted);
            for (const double share : {0.0, 0.01, 0.5, 0.99, 1.0})
                EXPECT_EQ(quantile(values, share),
                          sorted[static_cast<std::size_t>(share * (count - 1.0))]);
        }
    EXPECT_EQ(quantile({}, 0.5), 0.0);
}

TEST(Quality, CanBeStopped) {
    Progress progress([](std::string_view, double) { return false; });
    const Case one = plane(stay, stay);
    EXPECT_THROW(
        {
            progress.enter("quality");
            measure_quality(one.map(), {}, progress);
        },
        Cancelled);
}

TEST(Example, Quality) {
    const Case folded = plane(fold, stay);
    const auto& [source, target, source_images, target_images, pairs, features] = folded;
    Progress progress;
    // --- example
    const TwoWayMap map{source, target, source_images, target_images, pairs};
    const Quality quality = measure_quality(map, features, progress);
    const double flipped = quality.source_to_target.flipped;
    std::string advice;
    for (const Place& place : quality.worst) advice += place.advice + "\n";
    // --- end of the example
    EXPECT_NEAR(flipped, 0.125, 0.03);  // x from 0 to ¼ of −1 to 1
    EXPECT_FALSE(advice.empty());
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/measures/local_confidence.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "measures/mapped.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// Two clouds whose rows are pairs, a map between them, and what is known of it.
struct DiagnosedCase {
    Cloud source, target;
    Positions source_images, target_images;
    Pairing pairs;
    Diagnostics diagnostics;

    TwoWayMap map() const { return {source, target, source_images, target_images, pairs}; }

    LocalConfidence measure(const std::vector<Feature>& features = {}) const {
        Progress progress;
        const TwoWayMap both = map();
        const Quality quality = measure_quality(both, features, progress);
        return measure_local_confidence({both, quality, diagnostics}, features, progress);
    }
};

DiagnosedCase pairs_of_rows(Cloud source, Cloud target) {
    DiagnosedCase result{std::move(source), std::move(target), {}, {}, {}, {}};
    result.source_images = result.target.positions;
    result.target_images = result.source.positions;
    for (Index i = 0; i < result.source.size(); ++i) result.pairs.push_back({i, i});
    return result;
}

Cloud ball(const std::string& name, Index count) {
    const Positions p = shapes::sphere(count);
    return {name, p, p, {}, {}};
}

DiagnosedCase itself(Index count = 3000) {
    return pairs_of_rows(ball("Ball", count), ball("Moon", count));
}

/// From [−1, 1]² to what is left of it where all beyond x = ½ has been cut off: that is squeezed
/// onto the border.
DiagnosedCase cut() {
    const Positions sheet = shapes::grid(61);
    const auto there = [](const Vector3& p) {
        return Vector3(p.x() < 0.5 ? p.x() : 0.5 + 0.02 * (p.x() - 0.5), p.y(), 0.0);
    };
    const Normals up = Normals::Zero(sheet.rows(), 3).rowwise() + Eigen::RowVector3d(0, 0, 1);
    return pairs_of_rows({"Sheet", sheet, up, {}, {}}, {"Rest", mapped(sheet, there), up, {}, {}});
}

/// Another map that costs as little, and takes one half of the source `distance` elsewhere.
Alternatives other_half(const DiagnosedCase& one, double distance, double ratio) {
    Alternatives others;
    for (Index i = 0; i < one.source.size(); i += 20) {
        others.source_rows.push_back(i);
        others.target_rows.push_back(i);
    }
    const auto places = static_cast<Eigen::Index>(others.source_rows.size());
    for (OtherMaps* maps : {&others.finished, &others.trials}) {
        maps->ratios = Values::Constant(1, ratio);
        maps->source = maps->target = Eigen::MatrixXd::Zero(1, places);
        for (Eigen::Index k = 0; k < places; ++k) {
            const bool moves =
                one.source.positions(others.source_rows[static_cast<std::size_t>(k)], 0) > 0.0;
            maps->source(0, k) = maps->target(0, k) = moves ? distance : 0.0;
        }
    }
    return others;
}

/// The mean over the points with `is_there(position)`.
template <class IsThere>
double mean_where(const Cloud& cloud, const Values& values, IsThere&& is_there) {
    double sum = 0.0;
    Index count = 0;
    for (Index i = 0; i < cloud.size(); ++i) {
        if (!is_there(Vector3(cloud.positions.row(i).transpose()))) continue;
        sum += values[i];
        ++count;
    }
    return sum / count;
}

TEST(LocalConfidence, AShapeOntoItselfIsSureEverywhere) {
    const LocalConfidence found = itself().measure();
    EXPECT_GT(found.source.minCoeff(), 0.98);
    EXPECT_GT(found.target.minCoeff(), 0.98);
    EXPECT_LT(found.source.maxCoeff(), 1.0);
    EXPECT_TRUE(found.doubtful.empty());
    EXPECT_GT(found.right, 0.98);
    EXPECT_EQ(found.warning, "");
}

TEST(LocalConfidence, AMapThatTearsAllApartIsWarnedOf) {
    DiagnosedCase one = itself(1500);
    const auto order = shapes::permutation(one.source.size(), 3);
    one.source_images = gather(one.target.positions, order);
    one.target_images = gather(one.source.positions, order);
    const LocalConfidence found = one.measure();
    EXPECT_LT(found.right, 0.2);
    EXPECT_NE(found.warning.find("of the map from Ball to Moon"), std::string::npos)
        << found.warning;
}

TEST(LocalConfidence, WhatLiesAroundAPartThatWasCutAwayIsInDoubtAndNamed) {
    const DiagnosedCase one = cut();
    const LocalConfidence found = one.measure();
    const double away =
        mean_where(one.source, found.source, [](const Vector3& p) { return p.x() < 0.2; });
    const double lost =
        mean_where(one.source, found.source, [](const Vector3& p) { return p.x() > 0.6; });
    EXPECT_GT(away, 0.9);
    EXPECT_LT(lost, 0.3);
    ASSERT_FALSE(found.doubtful.empty());
    EXPECT_LE(found.doubtful.size(), 5u);
    for (const DoubtfulPlace& place : found.doubtful) {
        EXPECT_GT(one.source.positions(place.source, 0), 0.3);
        EXPECT_LT(place.confidence, 0.5);
        EXPECT_GT(place.share, 0.0);
        EXPECT_NE(place.advice.find("oward +X"), std::string::npos) << place.advice;
        EXPECT_EQ(place.advice.find("point"), std::string::npos) << place.advice;
        EXPECT_NE(place.where.find("toward +X"), std::string::npos) << place.where;
        EXPECT_FALSE(place.unreached);
    }
}

TEST(LocalConfidence, WhatIsKnownToHaveNoCounterpartIsInNoDoubt) {
    DiagnosedCase one = cut();
    for (Index i = 0; i < one.source.size(); ++i)
        if (one.source.positions(i, 0) > 0.3) one.diagnostics.source_loose.push_back(i);
    const LocalConfidence found = one.measure();
    const LocalConfidence unknown = cut().measure();
    EXPECT_GT(found.right, unknown.right + 0.05);
    const auto of_sheet = [](const LocalConfidence& confidence) {
        return std::ranges::count_if(confidence.doubtful, [](const DoubtfulPlace& place) {
            return place.advice.find("% of Sheet)") != std::string::npos;
        });
    };
    EXPECT_GT(of_sheet(unknown), 0);
    EXPECT_EQ(of_sheet(found), 0);
}

TEST(LocalConfidence, WhatNoImageComesNearIsInDoubtAndNamed) {
    // The source keeps out of a cap of the target, all of which has images nevertheless.
    constexpr double kHighest = 0.6;
    DiagnosedCase one = itself();
    one.source_images = mapped(one.source.positions, [&](const Vector3& p) {
        if (p.z() <= kHighest) return p;
        const double across = std::hypot(p.x(), p.y());
        const double ring = std::sqrt(1.0 - kHighest * kHighest) / std::max(across, 1e-9);
        return Vector3(ring * p.x(), ring * p.y(), kHighest);
    });
    const LocalConfidence found = one.measure();
    EXPECT_LT(mean_where(one.target, found.target, [](const Vector3& p) { return p.z() > 0.9; }),
              0.31);
    EXPECT_GT(mean_where(one.target, found.target, [](const Vector3& p) { return p.z() < 0.2; }),
              0.9);
    const auto says = [](const DoubtfulPlace& place) {
        return place.advice.find("nothing of Ball comes near a part of Moon") != std::string::npos;
    };
    const auto place = std::ranges::find_if(found.doubtful, says);
    ASSERT_NE(place, found.doubtful.end());
    EXPECT_GT(one.target.positions(place->target, 2), kHighest);
    EXPECT_NE(place->advice.find("no counterpart"), std::string::npos) << place->advice;
    EXPECT_TRUE(place->unreached);
    EXPECT_FALSE(place->on_source);
    EXPECT_EQ(std::ranges::count_if(found.doubtful,
                                    [](const DoubtfulPlace& other) {
                                        return other.advice.find("comes near a part of Ball") !=
                                               std::string::npos;
                                    }),
              0);
}

TEST(LocalConfidence, FallsWhereAnotherMapThatFitsAsWellGoesElsewhere) {
    DiagnosedCase one = itself();
    const Values alone = one.measure().source;
    const auto right = [](const Vector3& p) { return p.x() > 0.3; };
    const auto left = [](const Vector3& p) { return p.x() < -0.3; };
    double before = 0.0;
    for (const double ratio : {1.2, 1.05, 1.0}) {
        one.diagnostics.alternatives = other_half(one, 0.3, ratio);
        const LocalConfidence found = one.measure();
        const double here = 1.0 - mean_where(one.source, found.source, right);
        const double there = 1.0 - mean_where(one.source, found.source, left);
        EXPECT_GT(here, there);
        EXPECT_GT(here, before) << "the better the other map fits, the less sure";
        before = here;
        EXPECT_GT(1.0 - mean_where(one.target, found.target, right),
                  1.0 - mean_where(one.target, found.target, left));
    }
    EXPECT_GT(before, 1.5 * (1.0 - mean_where(one.source, alone, left)));
}

TEST(LocalConfidence, OfMapsThatFitAlikeAndHaveNothingInCommonEachIsAsLikely) {
    DiagnosedCase one = itself();
    const double alone = one.measure().right;
    const auto with = [&](double ratio, int others) {
        Alternatives& maps = one.diagnostics.alternatives;
        maps = other_half(one, 0.5, ratio);
        maps.finished.ratios = Values::Constant(others, ratio);
        maps.finished.source = maps.finished.target =
            Eigen::MatrixXd::Constant(others, maps.finished.source.cols(), 0.5);
        maps.trials = {Values(), Eigen::MatrixXd(0, maps.trials.source.cols()),
                       Eigen::MatrixXd(0, maps.trials.target.cols())};
        return one.measure().right;
    };
    EXPECT_LE(with(1.0, 1), 0.5);
    EXPECT_GT(with(1.0, 1), 0.45);
    EXPECT_LE(with(1.0, 3), 0.25);
    EXPECT_GT(with(1.5, 1), 0.99 * alone);
}

TEST(LocalConfidence, ARolledMapIsAsLikelyWhereItDiffers) {
    DiagnosedCase one = itself();
    Alternatives& maps = one.diagnostics.alternatives;
    maps = other_half(one, 0.5, 1.0);
    maps.trials = {Values(), Eigen::MatrixXd(0, maps.trials.source.cols()),
                   Eigen::MatrixXd(0, maps.trials.target.cols())};
    const auto right = [](const Vector3& p) { return p.x() > 0.3; };
    const auto left = [](const Vector3& p) { return p.x() < -0.3; };
    const LocalConfidence as_one_of_a_limb = one.measure();
    maps.finished.rolled = 0;
    const LocalConfidence rolled = one.measure();
    for (const auto confidence : {&LocalConfidence::source, &LocalConfidence::target}) {
        EXPECT_GT(mean_where(one.source, as_one_of_a_limb.*confidence, right), 0.7);
        EXPECT_LE(mean_where(one.source, rolled.*confidence, right), 0.5);
        EXPECT_GT(mean_where(one.source, rolled.*confidence, right), 0.4);
        EXPECT_NEAR(mean_where(one.source, rolled.*confidence, left),
                    mean_where(one.source, as_one_of_a_limb.*confidence, left), 0.01);
    }
}

TEST(LocalConfidence, AMarkSettlesWhatItSpeaksAgainst) {
    DiagnosedCase one = itself();
    one.diagnostics.alternatives = other_half(one, 0.3, 1.0);
    const Index front = 0, end = [&] {
        Index row;
        one.source.positions.col(0).maxCoeff(&row);
        return row;
    }();
    ASSERT_LT(std::abs(one.source.positions(front, 0)), 0.3);
    const auto doubt = [&](const std::vector<Feature>& marks) {
        return 1.0 - mean_where(one.source, one.measure(marks).source,
                                [](const Vector3& p) { return p.x() > 0.3; });
    };
    const double open = doubt({});
    EXPECT_LT(doubt({point_feature("end", end, end)}), 0.8 * open);
    Index other_end;
    one.source.positions.col(0).minCoeff(&other_end);
    EXPECT_EQ(doubt({point_feature("other end", other_end, other_end)}), open);
}

/// From [−1, 1]² to what is left of it where all beyond x = ½ was cut off: that joins the border.
DiagnosedCase cut_off() {
    const Positions sheet = shapes::grid(61);
    const auto up = [](Eigen::Index count) -> Normals {
        return Normals::Zero(count, 3).rowwise() + Eigen::RowVector3d(0, 0, 1);
    };
    constexpr double kBorder = 0.5, kSame = 1e-9;
    std::vector<Index> kept;
    for (Index i = 0; i < to_index(sheet.rows()); ++i)
        if (sheet(i, 0) < kBorder + kSame) kept.push_back(i);
    const Positions rest = gather(sheet, kept);
    DiagnosedCase result{{"Sheet", sheet, up(sheet.rows()), {}, {}},
                         {"Rest", rest, up(rest.rows()), {}, {}},
                         sheet,
                         rest,
                         {},
                         {}};
    result.source_images.col(0) = sheet.col(0).cwiseMin(kBorder);
    for (Index j = 0; j < to_index(kept.size()); ++j)
        for (Index i = 0; i < to_index(sheet.rows()); ++i)
            if ((result.source_images.row(i) - rest.row(j)).norm() < kSame)
                result.pairs.push_back({i, j});
    return result;
}

TEST(LocalConfidence, DoesNotCountWhatHasNoCounterpart) {
    DiagnosedCase one = cut_off();
    const LocalConfidence unknown = one.measure();
    for (Index j = 0; j < one.target.size(); ++j)
        if (one.target.positions(j, 0) > 0.49) one.diagnostics.target_ends.push_back(j);
    const LocalConfidence known = one.measure();
    EXPECT_FALSE(unknown.doubtful.empty());
    EXPECT_TRUE(known.doubtful.empty());
    EXPECT_GT(known.right, unknown.right + 0.1);
    // What is beyond is as sure as the border where it lies.
    const auto beyond = [](const Vector3& p) { return p.x() > 0.6; };
    const auto at_border = [](const Vector3& p) { return p.x() > 0.49; };
    EXPECT_LT(mean_where(one.source, unknown.source, beyond), 0.5);
    EXPECT_NEAR(mean_where(one.source, known.source, beyond),
                mean_where(one.target, known.target, at_border), 0.05);
    // What is wrong elsewhere still is.
    const auto order = shapes::permutation(one.target.size(), 3);
    for (Index j = 0; j < one.target.size(); ++j)
        if (one.target.positions(j, 0) < 0.0)
            one.target_images.row(j) = one.source.positions.row(order[to_size(j)]);
    EXPECT_FALSE(one.measure().doubtful.empty());
}

TEST(LocalConfidence, IsTheSameToTheBitForAnyNumberOfThreadsAndWithKnownNeighbors) {
    SKIP_WHERE_WATCHED();
    DiagnosedCase one = cut();
    one.diagnostics.alternatives = other_half(one, 0.3, 1.0);
    const LocalConfidence found = one.measure();
    for (const int count : {1, 3}) {
        const ThreadCount threads(count);
        const LocalConfidence again = one.measure();
        EXPECT_EQ(again.source, found.source);
        EXPECT_EQ(again.target, found.target);
        ASSERT_EQ(again.doubtful.size(), found.doubtful.size());
        for (std::size_t k = 0; k < found.doubtful.size(); ++k)
            EXPECT_EQ(again.doubtful[k].advice, found.doubtful[k].advice);
    }
    Progress progress;
    const auto near_source = ordered_neighbors(one.source.positions, 16, progress);
    const auto near_target = ordered_neighbors(one.target.positions, 16, progress);
    TwoWayMap map = one.map();
    map.source_neighbors = &near_source;
    map.target_neighbors = &near_target;
    const Quality quality = measure_quality(map, {}, progress);
    const LocalConfidence known =
        measure_local_confidence({map, quality, one.diagnostics}, {}, progress);
    EXPECT_EQ(known.source, found.source);
    EXPECT_EQ(known.target, found.target);
}

TEST(LocalConfidence, DoesNotDependOnScalePlaceAndOrientation) {
    SKIP_WHERE_WATCHED();
    // Each point by itself, and several together: those that lie together in space.
    for (const auto& [count, tolerance] : {std::pair(2500, 1e-6), std::pair(20000, 0.05)}) {
        DiagnosedCase one = itself(count);
        one.target.positions.col(0) *= 1.5;
        one.source_images = one.target.positions;
        one.diagnostics.alternatives = other_half(one, 0.3, 1.0);
        const LocalConfidence found = one.measure();
        const Matrix3 turn = shapes::rotation(5);
        const auto move = [&](const Positions& p) -> Positions {
            return (1e-3 * p * turn.transpose()).rowwise() + Eigen::RowVector3d(3.0, 4.0, 5.0);
        };
        DiagnosedCase moved = one;
        moved.target.positions = move(one.target.positions);
        moved.target.normals = one.target.normals * turn.transpose();
        moved.source_images = move(one.source_images);
        const LocalConfidence again = moved.measure();
        EXPECT_LT((again.source - found.source).cwiseAbs().maxCoeff(), tolerance);
        EXPECT_LT((again.target - found.target).cwiseAbs().maxCoeff(), tolerance);
    }
}

TEST(LocalConfidence, IsAProbabilityForAnyCloud) {
    Positions two = Positions::Zero(2, 3), line = Positions::Zero(40, 3), heap(60, 3);
    two(1, 0) = 1.0;
    line.col(0).setLinSpaced(0.0, 1.0);
    heap << Positions::Zero(40, 3), shapes::sphere(20);  // most in one place
    Positions dense = shapes::sphere(400);
    dense.topRows(300) *= 1e-4;
    for (const Positions& p : {two, line, heap, dense}) {
        const Normals normals =
            Normals::Zero(p.rows(), 3).rowwise() + Eigen::RowVector3d(0.0, 0.0, 1.0);
        const LocalConfidence found =
            pairs_of_rows({"Odd", p, normals, {}, {}}, {"Strange", p, normals, {}, {}}).measure();
        ASSERT_EQ(found.source.size(), p.rows());
        ASSERT_EQ(found.target.size(), p.rows());
        for (const Values* values : {&found.source, &found.target})
            for (const double value : *values) {
                EXPECT_GE(value, 0.0);
                EXPECT_LE(value, 1.0);
            }
    }
}

TEST(LocalConfidence, CanBeStopped) {
    const DiagnosedCase one = itself(500);
    Progress silent;
    const TwoWayMap map = one.map();
    const Quality quality = measure_quality(map, {}, silent);
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(
        {
            progress.enter("confidence");
            measure_local_confidence({map, quality, one.diagnostics}, {}, progress);
        },
        Cancelled);
}

TEST(Example, LocalConfidence) {
    const DiagnosedCase sheet = cut();
    const TwoWayMap map = sheet.map();
    const Diagnostics& diagnostics = sheet.diagnostics;
    const std::vector<Feature> features;
    Progress progress;
    // --- example
    const Quality quality = measure_quality(map, features, progress);
    const JudgedMap judged{map, quality, diagnostics};
    const LocalConfidence confidence = measure_local_confidence(judged, features, progress);
    const double mean = confidence.source.mean();
    std::string advice;
    for (const DoubtfulPlace& place : confidence.doubtful) advice += place.advice + "\n";
    // --- end of the example
    EXPECT_GT(mean, 0.5);
    EXPECT_LT(mean, 0.95);
    EXPECT_FALSE(advice.empty());
}

}  // namespace
}  // namespace pointmorph

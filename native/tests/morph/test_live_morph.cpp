#include "pointmorph/morph/live_morph.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "checks.hpp"
#include "joined_shapes.hpp"
#include "mesh_shapes.hpp"
#include "morph/morphs.hpp"
#include "pointmorph/base/error.hpp"
#include "registration/watched_options.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// Points of the two eggs: fewer where every access is watched.
const Index kSource = is_watched() ? 700 : 3000, kTarget = is_watched() ? 600 : 2500;
const Index kFewer = is_watched() ? 500 : 1500, kFewest = is_watched() ? 450 : 1200;

/// Two eggs without a loop; six marks.
MorphInput eggs(Index source_count = kSource, Index target_count = kTarget) {
    MorphInput input = two_eggs(source_count, target_count);
    input.loop.clear();
    return input;
}

MorphOptions lighter() {
    MorphOptions options;
    options.refinement = lighter_where_watched();
    return options;
}

/// A morph of eggs, and what it takes to follow their marks.
struct Followed {
    Morph morph;
    LiveMorph live;

    Followed(Index source_count, Index target_count, Progress progress = {})
        : morph(eggs(source_count, target_count), lighter(), progress), live(morph, progress) {}
};

// Computed once: no test changes them.
const Followed& followed() {
    static const Followed all(kSource, kTarget);
    return all;
}

const Followed& fewer_followed() {
    static const Followed fewer(kFewer, kFewest);
    return fewer;
}

std::vector<Feature> with_top_at(std::vector<Feature> features, const Cloud& target, double x) {
    for (Feature& f : features)
        if (f.name == "top")
            f.target.rows = {row_near(target, x, 0.0, std::sqrt(1.0 - x * x / 2.56))};
    return features;
}

double distance_of_maps(const Positions& a, const Positions& b) {
    return std::sqrt((a - b).rowwise().squaredNorm().mean());
}

TEST(LiveMorph, TheSameFeaturesAreTheSameMapToTheBit) {
    Progress progress;
    const Morph& morph = followed().morph;
    const std::vector<Feature> features = eggs().features;
    const LiveMorph& live = followed().live;
    EXPECT_EQ(live.source_to_target(features, progress), morph.source_to_target(progress));
    const Morph updated = live.updated(features, progress);
    EXPECT_EQ(updated.source_to_target(progress), morph.source_to_target(progress));
    EXPECT_EQ(updated.target_to_source(progress), morph.target_to_source(progress));
    EXPECT_EQ(updated.report().update, "updated");
    EXPECT_EQ(morph.report().update, "");
    EXPECT_TRUE(checks::is_total(updated.pairs(), kSource, kTarget));
}

TEST(LiveMorph, AMovedMarkMeetsAndTheRestIsAsFromScratch) {
    Progress progress;
    const MorphInput input = eggs();
    const Morph& morph = followed().morph;
    const LiveMorph& live = followed().live;
    const std::vector<Feature> changed = with_top_at(input.features, input.target, -0.2);
    const Morph updated = live.updated(changed, progress);
    EXPECT_EQ(updated.report().update, "updated");
    EXPECT_TRUE(checks::are_paired(changed, updated.pairs()));
    const Positions images = updated.source_to_target(progress),
                    roughly = live.source_to_target(changed, progress);
    for (const Feature& f : changed)
        for (const Positions& found : {images, roughly})
            EXPECT_LT(
                (found.row(f.source.rows[0]) - input.target.positions.row(f.target.rows[0])).norm(),
                1e-12)
                << f.name;
    MorphInput again = eggs();
    again.features = changed;
    const Positions scratch =
        Morph(std::move(again), lighter(), progress).source_to_target(progress);
    const double area_root = 4.2;  // of an ellipsoid with these axes, about
    EXPECT_LT(distance_of_maps(images, scratch), 0.015 * area_root);
    EXPECT_LT(distance_of_maps(roughly, scratch), 0.02 * area_root);
    EXPECT_EQ(morph.updated(changed, progress).source_to_target(progress), images);
}

TEST(LiveMorph, AFarMarkIsLookedForFromScratchWithAWord) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    const MorphInput input = eggs();
    const LiveMorph& live = followed().live;
    std::vector<Feature> changed = input.features;
    std::swap(changed[0].target, changed[2].target);  // front and back
    const Morph found = live.updated(changed, progress);
    const std::string& why = found.report().update;
    EXPECT_TRUE(why.starts_with("Computed from scratch: \"front\" moved too far") ||
                why.starts_with("Computed from scratch: \"back\" moved too far"))
        << why;
    EXPECT_TRUE(checks::mentions(found.report().warnings, why));
    EXPECT_TRUE(checks::are_paired(changed, found.pairs()));
}

TEST(LiveMorph, MarksComeAndGo) {
    Progress progress;
    const MorphInput input = eggs();
    const LiveMorph& live = followed().live;
    std::vector<Feature> features(input.features.begin(), input.features.end() - 1);
    EXPECT_EQ(live.updated(features, progress).report().update, "updated");
    features.push_back(point_feature("new", row_near(input.source, 0.9, 0.4, 0.7),
                                     row_near(input.target, 0.9, 0.4, 0.7)));
    const Morph updated = live.updated(features, progress);
    EXPECT_TRUE(checks::are_paired(features, updated.pairs()));
    EXPECT_GT(live.updated({}, progress).pairs().size(), 0u);
}

TEST(LiveMorph, SameBitsForAnyNumberOfThreads) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    const MorphInput input = eggs(kFewer, kFewest);
    const std::vector<Feature> changed = with_top_at(input.features, input.target, 0.0);
    std::optional<Positions> images, roughly;
    for (const int threads : {1, 2, 5}) {
        MorphOptions options;
        options.threads = threads;
        const Morph morph(eggs(kFewer, kFewest), options, progress);
        const LiveMorph live(morph, progress);
        const Positions found = live.updated(changed, progress).source_to_target(progress);
        if (!images) {
            images = found;
            roughly = live.source_to_target(changed, progress);
        }
        EXPECT_EQ(found, *images) << threads;
        EXPECT_EQ(live.source_to_target(changed, progress), *roughly) << threads;
    }
}

TEST(LiveMorph, VerticesOfMeshesFollow) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    MorphInput input;
    input.source = input.target = mesh_shapes::icosphere(4);
    input.target.positions.col(0) *= 1.6;
    const Vector3 turned = Vector3(1.0, 1.0, 0.0).normalized();
    input.features = {
        point_feature("x", row_near(input.source, 1, 0, 0), row_near(input.target, 1.6, 0, 0)),
        point_feature("y", row_near(input.source, 0, 1, 0), row_near(input.target, 0, 1, 0)),
        point_feature("z", row_near(input.source, 0, 0, 1), row_near(input.target, 0, 0, 1)),
        point_feature("mark", row_near(input.source, turned[0], turned[1], 0),
                      row_near(input.target, 1.6 * turned[0], turned[1], 0))};
    std::vector<Feature> changed = input.features;
    const double angle = 0.95;  // instead of 0.79
    changed[3].target.rows = {row_near(input.target, 1.6 * std::cos(angle), std::sin(angle), 0.0)};
    ASSERT_NE(changed[3].target.rows, input.features[3].target.rows);
    MorphInput copy = input;
    const Morph morph(std::move(copy), {}, progress);
    const LiveMorph live(morph, progress);
    EXPECT_EQ(live.updated(input.features, progress).source_to_target(progress),
              morph.source_to_target(progress));
    const Morph updated = live.updated(changed, progress);
    EXPECT_EQ(updated.report().update, "updated");
    const Positions images = updated.source_to_target(progress);
    for (const Feature& f : changed)
        EXPECT_EQ(images.row(f.source.rows[0]), input.target.positions.row(f.target.rows[0]));
    ASSERT_TRUE(updated.has_mesh());
    const Positions ends = updated.wrapped(1.0, progress);
    const Positions on_ball = ends.array().rowwise() / Eigen::RowVector3d(1.6, 1, 1).array();
    EXPECT_LT((on_ball.rowwise().norm().array() - 1.0).abs().maxCoeff(), 0.02);
}

TEST(LiveMorph, ShapesInSeveralPartsKeepThemApart) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    const auto two_balls = [](double apart) {
        Cloud small = mesh_shapes::icosphere(2);
        small.positions *= 0.4;
        small.positions.col(0).array() += apart;
        return mesh_shapes::together(mesh_shapes::icosphere(3), small);
    };
    MorphInput input;
    input.source = two_balls(2.0);
    input.target = two_balls(1.8);
    input.features = {
        point_feature("top", row_near(input.source, 0, 0, 1), row_near(input.target, 0, 0, 1)),
        point_feature("side", row_near(input.source, 0, 1, 0), row_near(input.target, 0, 1, 0)),
        point_feature("back", row_near(input.source, -1, 0, 0), row_near(input.target, -1, 0, 0))};
    const MorphInput given = input;
    const Morph morph(std::move(input), {}, progress);
    std::vector<Feature> changed = given.features;
    changed[0].target.rows = {row_near(given.target, 0.2, 0, 0.98)};
    const Morph updated = morph.updated(changed, progress);
    EXPECT_EQ(updated.report().update, "updated");
    const Positions images = updated.source_to_target(progress);
    for (Index i = 0; i < given.source.size(); ++i)
        EXPECT_EQ(given.source.positions(i, 0) > 1.3, images(i, 0) > 1.2) << i;
}

TEST(LiveMorph, LoosePiecesGoWithTheWarningsThatTellOfThem) {
    SKIP_WHERE_WATCHED();
    // An egg with a hat, and dust beside it; and another one without either.
    constexpr Index kHat = 100, kDust = 3;
    MorphInput input = eggs(kFewer, kFewest);
    Positions hat = shapes::sphere(kHat) * 0.35;
    hat.col(2) =
        0.05 * hat.col(2).array() + 1.08 - 0.5 * hat.leftCols(2).rowwise().squaredNorm().array();
    const Positions dust =
        (shapes::sphere(kDust) * 0.01).rowwise() + Eigen::RowVector3d(0.0, 0.0, -1.05);
    input.source.positions = shapes::together({input.source.positions, hat, dust});
    input.source_parts.assign(to_size(kFewer), 0);
    input.source_parts.insert(input.source_parts.end(), to_size(kHat), 1);
    input.source_parts.insert(input.source_parts.end(), to_size(kDust), 2);
    std::vector<Index> of_hat(to_size(kHat));
    std::iota(of_hat.begin(), of_hat.end(), kFewer);
    const auto expect_told = [&](const MorphReport& report) {
        EXPECT_TRUE(checks::mentions(report.warnings, "% of it) has no counterpart"));
        std::vector<Index> rows = report.diagnostics.source_loose;
        std::ranges::sort(rows);
        EXPECT_EQ(rows, of_hat);
        EXPECT_TRUE(report.diagnostics.target_loose.empty());
    };
    Progress progress;
    const Morph morph(MorphInput(input), {}, progress);
    ASSERT_EQ(morph.report().source_topology.main().size(), 2u);
    ASSERT_EQ(morph.report().source_topology.strays, 1);
    expect_told(morph.report());
    const auto changed = with_top_at(input.features, input.target, 0.35);
    const Morph updated = morph.updated(changed, progress);
    ASSERT_EQ(updated.report().update, "updated");
    expect_told(updated.report());
    // Of a map that was given, pieces and warnings are found again.
    input.start = {morph.source_to_target(progress), morph.target_to_source(progress)};
    const Morph given = LiveMorph(std::move(input), {}, progress).updated(changed, progress);
    ASSERT_EQ(given.report().update, "updated");
    expect_told(given.report());
}

TEST(LiveMorph, OtherMethodsAndMissingMapsAreRefusedInWords) {
    Progress progress;
    MorphOptions options = paper();
    MorphInput input;
    input.source = plane_cloud(20);
    input.target = bump_cloud(20);
    input.features = grid_features(20, 20);
    const Morph by_paper(std::move(input), options, progress);
    EXPECT_THROW(by_paper.updated({}, progress), OptionError);
    options = {};
    options.domain = Domain::kDisk;
    EXPECT_THROW(LiveMorph(eggs(), options, progress), OptionError);
    EXPECT_THROW(LiveMorph(eggs(), {}, progress), CloudError);
    const LiveMorph& live = fewer_followed().live;
    EXPECT_THROW(live.updated({point_feature("beyond", 99999, 0)}, progress), FeatureError);
    EXPECT_THROW(live.source_to_target({point_feature("beyond", 99999, 0)}, progress),
                 FeatureError);
}

TEST(LiveMorph, MarksNextToEachOtherMeetInAnyOrder) {
    Progress progress;
    const MorphInput input = eggs(kFewer, kFewest);
    const LiveMorph& live = fewer_followed().live;
    std::vector<Feature> changed = with_top_at(input.features, input.target, 0.3);
    // Two spacings beside the top, and left behind by it.
    const Index beside = row_near(input.source, 0.15, 0.1, 1.0);
    changed.push_back(point_feature("beside", beside, row_near(input.target, 0.1, 0.15, 1.0)));
    changed.push_back(point_feature("beyond", row_near(input.source, -0.15, -0.1, 1.0),
                                    row_near(input.target, -0.2, 0.0, 1.0)));
    const Positions images = live.source_to_target(changed, progress);
    for (const Feature& f : changed)
        EXPECT_EQ(images.row(f.source.rows[0]), input.target.positions.row(f.target.rows[0]))
            << f.name;
    std::ranges::reverse(changed);
    EXPECT_EQ(live.source_to_target(changed, progress), images);
    std::swap(changed[0], changed[3]);
    EXPECT_EQ(live.source_to_target(changed, progress), images);
}

TEST(LiveMorph, EstimatedNormalsOfGivenMapsAreReversedAsTheMorphDoes) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    const std::vector<Feature> features = grid_features(30, 30);
    const auto agreement = [](const Normals& a, const Normals& b) {
        return a.cwiseProduct(b).rowwise().sum().mean();
    };
    int reversed = 0;
    for (const bool turned : {false, true}) {
        MorphInput input{.source = plane_cloud(30), .target = bump_cloud(30), .features = features};
        if (turned) input.target.positions.rightCols(2) *= -1.0;  // by half a turn
        const Cloud target = input.target;
        const Morph morph(MorphInput(input), {}, progress);
        const Morph alone = make(target, target, {});
        reversed += agreement(alone.target().normals, morph.target().normals) < 0.0;
        input.start = {morph.source_to_target(progress), morph.target_to_source(progress)};
        const LiveMorph live(std::move(input), {}, progress);
        const Morph updated = live.updated(features, progress);
        EXPECT_EQ(updated.report().update, "updated");
        EXPECT_EQ(updated.source().normals, morph.source().normals) << turned;
        EXPECT_EQ(updated.target().normals, morph.target().normals) << turned;
    }
    EXPECT_EQ(reversed, 1);
}

TEST(LiveMorph, WhatIsKnownOfTheMapIsKept) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    MorphInput input = eggs(kFewer, kFewest);
    const std::vector<Feature> marks = std::exchange(input.features, {});
    const Morph sure(eggs(kFewer, kFewest), {}, progress);
    input.source.normals = -sure.source().normals;
    const Morph morph(MorphInput(input), {}, progress);
    const MorphReport& before = morph.report();
    ASSERT_LT(before.diagnostics.confidence, 1.0);
    ASSERT_TRUE(checks::mentions(before.warnings, "pointed inward"));

    const Positions images = morph.source_to_target(progress);
    const Index row = marks[0].source.rows[0];
    const Vector3 place = images.row(row).transpose();
    const std::vector<Feature> marked = {
        point_feature("new", row, row_near(input.target, place[0], place[1], place[2]))};
    const Morph updated = morph.updated(marked, progress), again = updated.updated({}, progress);
    for (const Morph* const one : {&updated, &again}) {
        const MorphReport& after = one->report();
        ASSERT_EQ(after.update, "updated");
        EXPECT_EQ(after.diagnostics.confidence, before.diagnostics.confidence);
        EXPECT_EQ(after.diagnostics.margin, before.diagnostics.margin);
        EXPECT_EQ(after.diagnostics.rivals.size(), before.diagnostics.rivals.size());
        EXPECT_TRUE(checks::mentions(after.warnings, "pointed inward"));
        EXPECT_EQ(checks::mentions(after.warnings, "wrong place"),
                  checks::mentions(before.warnings, "wrong place"));
        EXPECT_EQ(after.warnings.size(), before.warnings.size());
    }

    // Of a map that was given, nobody knows how sure it is.
    input.start = {images, morph.target_to_source(progress)};
    const Morph given = LiveMorph(std::move(input), {}, progress).updated(marked, progress);
    EXPECT_TRUE(std::isnan(given.report().diagnostics.confidence));
    EXPECT_TRUE(checks::mentions(given.report().warnings, "pointed inward"));
    EXPECT_FALSE(checks::mentions(given.report().warnings, "wrong place"));
}

TEST(LiveMorph, CanBeCanceledAnywhereAndAskedAgain) {
    Progress progress;
    const MorphInput input = eggs(kFewer, kFewest);
    const std::vector<Feature> changed = with_top_at(input.features, input.target, 0.0);
    const LiveMorph& live = fewer_followed().live;
    const Positions roughly = live.source_to_target(changed, progress);
    const Positions whole = live.updated(changed, progress).source_to_target(progress);
    int canceled = 0;
    for (const int last : {1, 2, 3, 5, 8, 13, 21, 34}) {
        if (is_watched() && last % 2 == 0) continue;  // canceled in the same places, about
        for (const bool is_whole : {false, true}) {
            std::atomic<int> polls = 0;
            Progress stopping([&](std::string_view, double) { return ++polls < last; },
                              std::chrono::milliseconds(0));
            try {
                if (is_whole)
                    live.updated(changed, stopping);
                else
                    live.source_to_target(changed, stopping);
                EXPECT_LT(polls, last);
            } catch (const Cancelled&) {
                ++canceled;
            }
        }
        EXPECT_EQ(live.source_to_target(changed, progress), roughly) << last;
    }
    EXPECT_GE(canceled, is_watched() ? 4 : 6);
    EXPECT_EQ(live.updated(changed, progress).source_to_target(progress), whole);
}

}  // namespace
}  // namespace pointmorph

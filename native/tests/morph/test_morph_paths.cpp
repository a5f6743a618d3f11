// The ways that pairs take between the two shapes, and when.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <span>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "checks.hpp"
#include "morph/morphs.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/frames/motion.hpp"
#include "pointmorph/morph/morph.hpp"
#include "registration/watched_options.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

TEST(MorphPaths, EveryPathEndsAtTheInputsAndKeepsToTheSurface) {
    const Matrix3 turn = Eigen::AngleAxisd(2.5, Vector3::UnitX()).toRotationMatrix();
    Cloud source = bump_cloud(29), target = bump_cloud(25);
    target.positions = 3.0 * target.positions * turn.transpose();
    for (const PathKind kind : {PathKind::kSimilarity, PathKind::kRigid}) {
        if (kind == PathKind::kSimilarity && is_watched()) continue;  // the rigid one begins so
        MorphOptions options;
        options.path = kind;
        options.refinement = lighter_where_watched();
        auto features = grid_features(29, 25);
        features.push_back(point_feature("corner", 0, 0));
        const Morph morph = make(source, target, features, options);
        const auto m = morph.pairs().size();
        std::vector<double> positions(3 * m), normals(3 * m), colors(4 * m), radii(m);
        for (const double t : {0.0, 1.0}) {
            morph.frame<double>(t, {positions, normals, colors, radii});
            const auto& end = t == 0.0 ? morph.source().positions : morph.target().positions;
            for (std::size_t i = 0; i < m; ++i)
                for (int d = 0; d < 3; ++d)
                    ASSERT_EQ(positions[3 * i + to_size(d)],
                              end(t == 0.0 ? morph.pairs()[i].source : morph.pairs()[i].target, d));
        }
        // Half way: turned by half and grown by the square root, not shrunk.
        morph.frame<double>(0.5, {positions, normals, {}, {}});
        const Eigen::Map<Positions> half(positions.data(), static_cast<Eigen::Index>(m), 3);
        Positions expected(half.rows(), 3);
        for (std::size_t i = 0; i < m; ++i)
            expected.row(static_cast<Eigen::Index>(i)) =
                source.positions.row(morph.pairs()[i].source);
        const Similarity onto = fit_similarity(half, expected);
        EXPECT_NEAR(onto.scale, 1 / std::sqrt(3.0), 0.02);
        EXPECT_LT((onto.apply(half) - expected).rowwise().norm().mean(), 0.03);
        EXPECT_THROW(morph.frame<double>(0.5, {std::span(positions).first(3), {}, {}, {}}),
                     OptionError);
    }
}

/// Positions and normals of all pairs at t.
std::vector<double> at(const Morph& morph, double t) {
    std::vector<double> numbers(6 * morph.pairs().size());
    const std::span<double> all(numbers);
    morph.frame<double>(t, {all.first(all.size() / 2), all.subspan(all.size() / 2), {}, {}});
    return numbers;
}

TEST(MorphPaths, FramesThatWereExpectedHaveTheSameBits) {
    Cloud inward = hemisphere(1200), patch = hemisphere(1000);
    inward.normals = -inward.positions;  // estimated ones of the other are turned over by the map
    const auto marks = std::vector{point_feature("top", 0, 0)};
    for (const int threads : {1, 2, 3})
        for (const PathKind path : {PathKind::kRigid, PathKind::kSimilarity, PathKind::kLinear}) {
            if (is_watched() && (threads != 2 || path != PathKind::kRigid)) continue;
            MorphOptions options;
            options.path = path;
            options.threads = threads;
            options.refinement = lighter_where_watched();
            const Morph plain = make(patch, inward, marks, options);
            options.expects_frames = true;
            const Morph expected = make(patch, inward, marks, options);
            EXPECT_EQ(expected.pairs(), plain.pairs());
            EXPECT_EQ(at(expected, 0.4), at(plain, 0.4));
            EXPECT_EQ(at(expected, 0.8), at(plain, 0.8));
        }
}

/// Of a patch, once there was so much time for what frames take of the shapes alone.
Morph with_frames_expected(std::chrono::milliseconds idle) {
    MorphOptions options;
    options.threads = 2;
    options.expects_frames = true;
    options.refinement = lighter_where_watched();
    Progress progress([&](std::string_view stage, double) {
        if (stage == "registration")
            std::this_thread::sleep_for(std::exchange(idle, std::chrono::milliseconds(0)));
        return true;
    });
    return {{hemisphere(1200), hemisphere(1000), {point_feature("top", 0, 0)}, {}, {}, {}},
            options,
            progress};
}

/// How often the callback is called while paths are laid out, up to `most`, when it cancels.
int calls_of_paths(const Morph& morph, int most) {
    int calls = 0;
    Progress progress([&](std::string_view, double) { return ++calls < most; },
                      std::chrono::milliseconds(0));
    try {
        morph.lay_out_paths(progress);
    } catch (const Cancelled&) {
    }
    return calls;
}

TEST(MorphPaths, WhatWasMadeForExpectedFramesIsNotMadeAgain) {
    constexpr int kAll = std::numeric_limits<int>::max();
    MorphOptions options;
    options.threads = 2;
    options.refinement = lighter_where_watched();
    const int plain = calls_of_paths(
        make(hemisphere(1200), hemisphere(1000), {point_feature("top", 0, 0)}, options), kAll);
    int fewest = plain;
    for (int idle = 100; idle < 20'000 && fewest > plain / 2; idle *= 4)  // on a busy machine
        fewest = std::min(
            fewest, calls_of_paths(with_frames_expected(std::chrono::milliseconds(idle)), kAll));
    EXPECT_LE(fewest, plain / 2);
}

TEST(MorphPaths, FramesThatWereExpectedAreTheSameAfterPathsThatWereCanceled) {
    MorphOptions options;
    options.threads = 2;
    options.refinement = lighter_where_watched();
    const std::vector<double> plain =
        at(make(hemisphere(1200), hemisphere(1000), {point_feature("top", 0, 0)}, options), 0.4);
    for (int most = 1; most < 100'000; most = is_watched() ? 16 * most : 2 * most) {
        const Morph morph = with_frames_expected(std::chrono::milliseconds(100));
        const int calls = calls_of_paths(morph, most);
        EXPECT_EQ(at(morph, 0.4), plain) << most;
        if (calls < most) break;
    }
}

TEST(MorphPaths, FramesMayBeExpectedOfAMorphThatIsCanceled) {
    MorphOptions options;
    options.threads = 2;
    options.expects_frames = true;
    options.refinement = lighter_where_watched();
    for (const char* const last : {"topology", "coarse shapes", "registration", "landing"}) {
        Progress cancel([&](std::string_view stage, double) { return stage != last; });
        EXPECT_THROW(Morph({bump_cloud(41), bump_cloud(37), grid_features(41, 37), {}, {}, {}},
                           options, cancel),
                     Cancelled)
            << last;
    }
}

TEST(MorphPaths, SourcePointsGoTheWayOfTheFrames) {
    const Matrix3 turn = Eigen::AngleAxisd(1.5, Vector3::UnitX()).toRotationMatrix();
    Cloud target = bump_cloud(25);
    target.positions = target.positions * turn.transpose();
    Progress progress;
    for (const PathKind kind : {PathKind::kLinear, PathKind::kRigid}) {
        MorphOptions options;
        options.path = kind;
        options.refinement = lighter_where_watched();
        const Morph morph = make(bump_cloud(29), target, grid_features(29, 25), options);
        const Positions &start = morph.source().positions, end = morph.source_to_target(progress);
        EXPECT_EQ(morph.source_at(0.0, progress), start);
        EXPECT_EQ(morph.source_at(1.0, progress), end);
        const GradualSimilarity similarity{fit_similarity(start, end),
                                           start.colwise().mean().transpose()};
        const Motion motion(start, morph.source().normals.rowwise().normalized(), end, similarity,
                            kind, progress);
        const auto m = morph.pairs().size();
        std::vector<double> positions(3 * m);
        for (const double t : {0.3, 0.8, 0.3}) {
            // Whatever frame was asked for before.
            EXPECT_LT((morph.source_at(t, progress) - motion.at(t).positions).norm(), 1e-9);
            morph.frame<double>(t, {positions, {}, {}, {}});
            EXPECT_LT((morph.source_at(t, progress) - motion.at(t).positions).norm(), 1e-9);
            morph.frame<double>(0.5, {positions, {}, {}, {}});
        }
        EXPECT_THROW(morph.source_at(1.5, progress), OptionError);
    }
}

TEST(MorphPaths, StraightPathsOfWhatIsTurnedAreWarnedOf) {
    const Matrix3 turn = Eigen::AngleAxisd(2.0, Vector3::UnitX()).toRotationMatrix();
    Cloud target = bump_cloud(25);
    target.positions = target.positions * turn.transpose();
    auto features = grid_features(29, 25);
    features.push_back(point_feature("corner", 0, 0));
    MorphOptions options;
    options.refinement = lighter_where_watched();
    if (!is_watched()) {
        EXPECT_FALSE(checks::mentions(
            make(bump_cloud(29), target, features, options).report().warnings, "straight"));
    }
    options.path = PathKind::kLinear;
    EXPECT_TRUE(checks::mentions(make(bump_cloud(29), target, features, options).report().warnings,
                                 "bump is rotated 115° relative to bump"));
    if (is_watched()) return;
    EXPECT_FALSE(checks::mentions(
        make(bump_cloud(29), bump_cloud(25), features, options).report().warnings, "straight"));
}

/// Sheets, the target turned; with `path` and `stagger`.
Morph staggered_morph(PathKind path, const StaggerOptions& stagger, const Values& delays = {},
                      int threads = 0) {
    const Matrix3 turn = Eigen::AngleAxisd(1.5, Vector3::UnitX()).toRotationMatrix();
    Cloud target = bump_cloud(25);
    target.positions = target.positions * turn.transpose();
    MorphOptions options;
    options.path = path;
    options.stagger = stagger;
    options.threads = threads;
    Progress progress;
    MorphInput input{bump_cloud(29), target, grid_features(29, 25)};
    input.delays = delays;
    return Morph(std::move(input), options, progress);
}

struct Arrays {
    std::vector<float> positions, normals, colors, radii;

    Arrays(const Morph& morph, double t)
        : positions(3 * morph.pairs().size()),
          normals(3 * morph.pairs().size()),
          colors(4 * morph.pairs().size()),
          radii(morph.pairs().size()) {
        morph.frame<float>(t, {positions, normals, colors, radii});
    }
    bool operator==(const Arrays&) const = default;
};

TEST(MorphPaths, StaggeredPairsAreWhereTheyAreAtTheirOwnTime) {
    SKIP_WHERE_WATCHED();
    for (const PathKind path : {PathKind::kLinear, PathKind::kRigid}) {
        const Morph plain = staggered_morph(path, {});
        StaggerOptions stagger;
        stagger.kind = StaggerKind::kY;
        const Morph morph = staggered_morph(path, stagger);
        ASSERT_EQ(morph.pairs(), plain.pairs());
        for (const double t : {0.0, 1.0}) EXPECT_EQ(Arrays(morph, t), Arrays(plain, t));

        const Values late = delays(plain.source().positions, {}, stagger);
        const Arrays found(morph, 0.4);
        for (std::size_t i = 0; i < morph.pairs().size(); i += 97) {
            const Arrays there(plain, local_time(0.4, late[morph.pairs()[i].source], stagger));
            EXPECT_NEAR(found.radii[i], there.radii[i], 1e-6F);
            for (std::size_t d = 3 * i; d < 3 * i + 3; ++d) {
                EXPECT_NEAR(found.positions[d], there.positions[d], 1e-4F);
                EXPECT_NEAR(found.normals[d], there.normals[d], 1e-3F);
            }
        }
        Progress progress;
        EXPECT_GE(morph.resampled_frame<float>(0.4, progress).ids.size(), morph.pairs().size());
        EXPECT_EQ(Arrays(staggered_morph(path, stagger, {}, 1), 0.4), found);
    }
}

TEST(MorphPaths, GivenDelaysAreThoseOfTheSource) {
    SKIP_WHERE_WATCHED();
    StaggerOptions stagger;
    stagger.kind = StaggerKind::kDelay;
    stagger.overlap = 1.0;
    stagger.falloff = 0.0;
    EXPECT_THROW(staggered_morph(PathKind::kLinear, stagger), CloudError);
    // All at once is as without.
    const Values given = Values::LinSpaced(29 * 29, 0.0, 1.0);
    const Morph plain = staggered_morph(PathKind::kLinear, {});
    const Arrays together(staggered_morph(PathKind::kLinear, stagger, given), 0.3);
    EXPECT_EQ(together.positions, Arrays(plain, 0.3).positions);

    stagger.overlap = 0.01;
    const Morph morph = staggered_morph(PathKind::kRigid, stagger, given);
    const Arrays found(morph, 0.5), start(plain, 0.0), end(plain, 1.0);
    Progress progress;
    MorphOptions options = morph.options();
    const Morph again(
        {.source = morph.source(),
         .target = morph.target(),
         .pairs = morph.pairs(),
         .images = {morph.source_to_target(progress), morph.target_to_source(progress)},
         .delays = given},
        options);
    EXPECT_EQ(Arrays(again, 0.5), found);
    for (std::size_t i = 0; i < morph.pairs().size(); ++i) {
        const double late = given[morph.pairs()[i].source];
        if (std::abs(late - 0.5) < 0.02) continue;
        const Arrays& there = late > 0.5 ? start : end;
        for (std::size_t d = 3 * i; d < 3 * i + 3; ++d)
            ASSERT_EQ(found.positions[d], there.positions[d]);
    }
}

}  // namespace
}  // namespace pointmorph

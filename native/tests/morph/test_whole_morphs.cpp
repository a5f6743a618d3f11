// Whole morphs of a few hundred points, by every way through the library. The thread sanitizer
// watches them on several threads, the leak sanitizer those that end early.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <iostream>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/thread_engine.hpp"
#include "mesh_shapes.hpp"
#include "morph/morphs.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/morph/cut_preview.hpp"
#include "pointmorph/morph/live_morph.hpp"
#include "pointmorph/morph/loop_suggestion.hpp"
#include "pointmorph/morph/network_preview.hpp"
#include "registration/watched_options.hpp"
#include "watched.hpp"

#ifdef __linux__
/// Null where no sanitizer watches. Returns whether it found leaks, which it prints.
extern "C" int __lsan_do_recoverable_leak_check() __attribute__((weak));
#else
static int (*const __lsan_do_recoverable_leak_check)() = nullptr;
#endif

namespace pointmorph {
namespace {

MorphOptions options_for(Method method, Domain domain) {
    MorphOptions options;
    options.method = method;
    options.domain = domain;
    options.refinement = lighter_refinement();
    return options;
}

MorphInput sheets() {
    return {bump_cloud(14), hemisphere(220), {}, {}, {}, {}};
}

MorphInput eggs_without_loop() {
    MorphInput input = two_eggs(420, 360);
    input.loop.clear();
    return input;
}

MorphInput balls_in_parts(double apart) {
    MorphInput input;
    for (Cloud* cloud : {&input.source, &input.target}) {
        Cloud small = mesh_shapes::icosphere(1);
        small.positions *= 0.4;
        small.positions.col(0).array() += apart;
        const Cloud large = mesh_shapes::icosphere(2);
        Parts& parts = cloud == &input.source ? input.source_parts : input.target_parts;
        parts.assign(to_size(large.size()), 0);
        parts.resize(to_size(large.size() + small.size()), 1);
        *cloud = mesh_shapes::together(large, small);
        cloud->faces = {};
        apart *= 1.2;
    }
    return input;
}

/// All that is asked of a morph, as numbers.
Positions answers(const MorphInput& input, const MorphOptions& options, Progress& progress) {
    const Morph morph(input, options, progress);
    const ResampledFrame<double> frame = morph.resampled_frame<double>(0.4, progress);
    const Positions image = morph.source_to_target(progress);
    Positions all(image.rows() + 2, 3);
    all.topRows(image.rows()) = image;
    all.row(image.rows()) << morph.quality(progress).source_to_target.stretch_p99,
        morph.local_confidence(progress).source.mean(), static_cast<double>(morph.pairs().size());
    all.row(image.rows() + 1) << frame.positions.front(), frame.positions.back(),
        static_cast<double>(frame.ids.size());
    return all;
}

Positions wrapped_mesh(Progress& progress) {
    MorphInput input{mesh_shapes::icosphere(1), mesh_shapes::cylinder(12), {}, {}, {}, {}};
    MorphOptions options = options_for(Method::kAuto, Domain::kAuto);
    options.wrapping.iterations = 1;
    options.wrapping.coarse_places = 500;
    const Morph morph(input, options, progress);
    return morph.wrapped(0.5, progress);
}

Positions followed_marks(Progress& progress) {
    const MorphInput input = eggs_without_loop();
    const LiveMorph live(Morph(input, options_for(Method::kAuto, Domain::kAuto), progress),
                         progress);
    std::vector<Feature> moved = input.features;
    moved[4].target.rows = {row_near(input.target, 0.1, 0.0, 1.0)};
    Positions all = live.source_to_target(moved, progress);
    all += live.updated(moved, progress).source_to_target(progress);
    return all;
}

Positions previewed(Progress& progress) {
    const MorphInput input = eggs_without_loop();
    const MorphOptions options = options_for(Method::kPaper, Domain::kAuto);
    std::vector<Index> rows;
    std::vector<std::string> names = suggest_loop(input, options, progress);
    for (const std::string& name : names)
        for (const Feature& feature : input.features)
            if (feature.name == name) rows.push_back(feature.source.rows[0]);
    const CutPreview cut = preview_cut(input.source, rows, names, options, progress);
    const NamedNetwork network = preview_network(input, options, progress);
    const Positions& curve = network.network.curves.front().on[0].points;
    Positions all(cut.curve.points.rows() + curve.rows(), 3);
    all << cut.curve.points, curve;
    return all;
}

struct Way {
    const char* name;
    std::function<Positions(Progress&)> go;
};

void PrintTo(const Way& way, std::ostream* out) {
    *out << way.name;
}

std::vector<Way> ways() {
    const auto by = [](auto input, Method method, Domain domain) {
        return [=](Progress& p) { return answers(input(), options_for(method, domain), p); };
    };
    const auto parts = [] { return balls_in_parts(2.0); };
    const auto cut = [] { return two_eggs(420, 360); };
    return {{"automatic", by(sheets, Method::kAuto, Domain::kAuto)},
            {"disk", by(sheets, Method::kPaper, Domain::kDisk)},
            {"cut", by(cut, Method::kPaper, Domain::kCut)},
            {"sphere", by(eggs_without_loop, Method::kPaper, Domain::kSphere)},
            {"parts", by(parts, Method::kAuto, Domain::kAuto)},
            {"wrapped", wrapped_mesh},
            {"live", followed_marks},
            {"previews", previewed}};
}

class WholeMorph : public testing::TestWithParam<Way> {};

INSTANTIATE_TEST_SUITE_P(Ways, WholeMorph, testing::ValuesIn(ways()),
                         [](const auto& info) { return std::string(info.param.name); });

/// Notes the stages, and asks for the end a little after the start of that one, counted from 1, 0
/// for never. How many reports there are says nothing: who waits for another thread reports, too.
struct Reports {
    std::set<std::string, std::less<>> stages;
    int later = 0;
    Progress progress;

    explicit Reports(std::size_t last)
        : progress(
              [this, last](std::string_view stage, double) {
                  stages.emplace(stage);
                  return last == 0 || stages.size() < last || ++later < 3;
              },
              std::chrono::milliseconds(0)) {}

    /// The stage in the middle, after which others come.
    std::size_t middle() const { return (stages.size() + 1) / 2; }
};

bool looks_for_leaks() {
    return __lsan_do_recoverable_leak_check != nullptr;
}

TEST_P(WholeMorph, IsTheSameOnThreeThreads) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    const auto on = [&](int threads) {
        const ThreadCount scope(threads);
        return GetParam().go(progress);
    };
    const Positions alone = on(1);
    EXPECT_TRUE(alone.allFinite());
    for (const ThreadEngine* engine : thread_engines()) {
        const EngineScope scope(*engine);
        EXPECT_EQ(on(3), alone) << engine->name;
    }
}

TEST_P(WholeMorph, CanBeCancelledOnThreeThreads) {
    if (is_watched() && looks_for_leaks()) GTEST_SKIP() << "the tests of leaks run the same code";
    const EngineScope engine(kPoolEngine);
    const ThreadCount three(3);
    Reports whole(0);
    GetParam().go(whole.progress);
    EXPECT_GT(whole.stages.size(), 3u);
    Reports early(whole.middle());
    EXPECT_THROW(GetParam().go(early.progress), Cancelled);
}

TEST(Previews, RefuseAStartOfOtherClouds) {
    MorphInput input = eggs_without_loop();
    input.start = {shapes::sphere(7), shapes::sphere(9)};
    const MorphOptions options = options_for(Method::kPaper, Domain::kAuto);
    Progress progress;
    EXPECT_THROW(suggest_loop(input, options, progress), CloudError);
    EXPECT_THROW(preview_network(input, options, progress), CloudError);
}

/// What can't be reached any more: no pointer to it stays, on the stack neither.
[[gnu::noinline]] std::vector<std::uintptr_t> lost_blocks() {
    std::vector<std::uintptr_t> hidden;
    for (int k = 0; k < 16; ++k) hidden.push_back(~reinterpret_cast<std::uintptr_t>(new int(k)));
    return hidden;
}

TEST(Leaks, AreSeen) {
    if (!looks_for_leaks()) GTEST_SKIP() << "no sanitizer looks for leaks";
    const std::vector<std::uintptr_t> hidden = lost_blocks();
    EXPECT_NE(__lsan_do_recoverable_leak_check(), 0);
    for (const std::uintptr_t block : hidden) delete reinterpret_cast<int*>(~block);
}

TEST(Leaks, AreNotLeftByMorphsThatEndAnyWay) {
    if (!looks_for_leaks()) GTEST_SKIP() << "no sanitizer looks for leaks";
    const ThreadCount two(2);
    for (const Way& way : ways()) {
        Reports whole(0);
        way.go(whole.progress);
        EXPECT_EQ(__lsan_do_recoverable_leak_check(), 0) << way.name;
        Reports early(whole.middle());
        EXPECT_THROW(way.go(early.progress), Cancelled) << way.name;
        EXPECT_EQ(__lsan_do_recoverable_leak_check(), 0) << way.name << ", cancelled";
    }
    Progress silent;
    MorphInput wrong = sheets();
    wrong.features = {point_feature("nose", 5, 1), point_feature("chin", 5, 2)};
    EXPECT_THROW(Morph(wrong, {}, silent), FeatureError);
    EXPECT_THROW(answers(sheets(), options_for(Method::kPaper, Domain::kSphere), silent), Error);
    EXPECT_EQ(__lsan_do_recoverable_leak_check(), 0) << "failed";
}

}  // namespace
}  // namespace pointmorph

// What features do to whole morphs, by both methods.
#include "pointmorph/morph/morph.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

#include "checks.hpp"
#include "marked_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "registration/belted.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

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
        EXPECT_NE(std::string(error.what()).find("Use method auto, which supports regions"),
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

}  // namespace
}  // namespace pointmorph

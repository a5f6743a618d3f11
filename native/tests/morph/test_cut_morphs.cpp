#include "pointmorph/morph/morph.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "checks.hpp"
#include "morph/morphs.hpp"
#include "pointmorph/base/error.hpp"
#include "registration/watched_options.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

TEST(Morph, ClosedShapesAreCutAlongTheLoop) {
    Progress progress;
    const Index from = is_watched() ? 1500 : 3000, to = is_watched() ? 1100 : 2200;
    const Morph morph(two_eggs(from, to), paper(), progress);
    EXPECT_EQ(morph.report().domain, "cut");
    EXPECT_EQ(morph.source_domain().cols(), 3);
    EXPECT_LT((morph.source_domain().rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-9);

    EXPECT_TRUE(checks::is_total(morph.pairs(), from, to));
    double misfit = 0.0;
    for (const IndexPair& pair : morph.pairs()) {
        Eigen::RowVector3d expected = morph.source().positions.row(pair.source);
        if (expected.z() < 0.0) expected.z() *= 1.4;
        misfit += (expected - morph.target().positions.row(pair.target)).norm();
    }
    EXPECT_LT(misfit / static_cast<double>(morph.pairs().size()), 0.25);
    EXPECT_TRUE(checks::are_paired(two_eggs(from, to).features, morph.pairs()));
    // No seam: next to the curve as gentle as elsewhere.
    const std::vector<double> middle{0.5};
    EXPECT_LT(morph.cracks(middle, progress).front().share, 0.002);
    EXPECT_TRUE(morph.source_to_target(progress).allFinite());
}

TEST(Morph, ACutDoesNotDependOnOrderOrThreads) {
    Progress progress;
    MorphOptions options = paper();
    options.threads = 1;
    const Morph one(two_eggs(1500, 1200), options, progress);
    options.threads = 3;
    const Morph three(two_eggs(1500, 1200), options, progress);
    EXPECT_EQ(one.pairs(), three.pairs());
    EXPECT_EQ(one.pairs(), pairs_in_another_order(two_eggs(1500, 1200), options));
}

TEST(Morph, ALoopInTheOtherSenseOnOneModelIsNoticed) {
    Progress progress;
    MorphInput swapped = two_eggs(1500, 1200);
    std::swap(swapped.features[1].target, swapped.features[3].target);  // left and right
    try {
        Morph(std::move(swapped), paper(), progress);
        FAIL() << "taken";
    } catch (const FeatureError& error) {
        EXPECT_NE(std::string(error.what()).find("left and right"), std::string::npos);
    }
    MorphInput astray = two_eggs(1500, 1200);
    astray.features[4].target.rows = {row_near(astray.target, 0.6, 0, -1.3)};
    EXPECT_THROW(Morph(std::move(astray), paper(), progress), FeatureError);
}

TEST(Morph, LeadsTheCutRoundAFeatureBesideIt) {
    Progress progress;
    // A mark just above the loop on one model and just below it on the other.
    const auto height = [](const Cloud& cloud, Index row) { return cloud.positions(row, 2); };
    MorphInput input = two_eggs(4000, 3000);
    const auto beside = [&](const Cloud& cloud, double z) {
        const double x = cloud.positions.col(0).maxCoeff(), y = cloud.positions.col(1).maxCoeff();
        return row_near(cloud, 0.7 * x, 0.7 * y, z);
    };
    const Index s = beside(input.source, 0.1), t = beside(input.target, -0.1);
    ASSERT_GT(height(input.source, s) * -height(input.target, t), 0.0);
    input.features.push_back(point_feature("beside", s, t));
    const Morph morph(std::move(input), paper(), progress);
    EXPECT_TRUE(checks::mentions(morph.report().warnings, "goes around \"beside\""));
    EXPECT_TRUE(std::ranges::binary_search(morph.pairs(), IndexPair{s, t}));
}

TEST(Morph, DomainCutProposesALoopAndSaysSo) {
    Progress progress;
    MorphOptions options = paper();
    options.domain = Domain::kCut;
    MorphInput input = two_eggs(1200, 1000);
    input.loop.clear();
    const Morph morph(std::move(input), options, progress);
    EXPECT_EQ(morph.report().domain, "cut");
    EXPECT_GE(morph.report().loop.size(), 3u);
    ASSERT_FALSE(morph.report().warnings.empty());
    EXPECT_NE(morph.report().warnings.front().find(morph.report().loop.front()), std::string::npos);

    MorphInput few = two_eggs(600, 500);
    few.loop.clear();
    few.features.resize(2);
    EXPECT_THROW(Morph(std::move(few), options, progress), FeatureError);
}

TEST(Morph, StartsFromTheCutWhenAskedTo) {
    Progress progress;
    MorphOptions options;
    options.refinement = lighter_where_watched();
    options.domain = Domain::kCut;
    const Morph morph(two_eggs(800, 700), options, progress);
    EXPECT_EQ(morph.report().domain, "product");
    EXPECT_TRUE(std::ranges::any_of(morph.report().stages, [](const StageTime& time) {
        return time.stage == "decomposition";
    }));
}

TEST(Morph, SmallHolesDoNotMakeAnOpenPatch) {
    MorphInput input = two_eggs(3000, 2200);
    // A hole on the source's shoulder.
    std::vector<Index> kept, rank(3000, -1);
    for (Index i = 0; i < 3000; ++i)
        if ((input.source.positions.row(i) - Eigen::RowVector3d(0.9, 0.3, 0.75)).norm() > 0.3) {
            rank[to_size(i)] = to_index(kept.size());
            kept.push_back(i);
        }
    input.source.positions = gather(input.source.positions, kept);
    for (Feature& feature : input.features)
        feature.source.rows[0] = rank[to_size(feature.source.rows[0])];
    Progress progress;
    EXPECT_EQ(Morph(std::move(input), paper(), progress).report().domain, "cut");
}

}  // namespace
}  // namespace pointmorph

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

MorphOptions on_sphere() {
    MorphOptions options = paper();
    options.domain = Domain::kSphere;
    return options;
}

TEST(Morph, ClosedShapesMeetOnTheSphere) {
    const Index from = is_watched() ? 1500 : 3000, to = is_watched() ? 1100 : 2200;
    Progress progress;
    MorphInput input = two_eggs(from, to);
    input.loop.clear();
    const std::vector<Feature> features = input.features;
    const Morph morph(std::move(input), on_sphere(), progress);
    EXPECT_EQ(morph.report().domain, "sphere");
    EXPECT_EQ(morph.report().feature_residual, 0.0);
    EXPECT_LT((morph.source_domain().rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-9);
    EXPECT_TRUE(checks::is_total(morph.pairs(), from, to));
    EXPECT_TRUE(checks::are_paired(features, morph.pairs()));
    const auto expected = [](Positions p, double below) {
        for (Index i = 0; i < p.rows(); ++i)
            if (p(i, 2) < 0.0) p(i, 2) *= below;
        return p;
    };
    const auto mean_distance = [](const Positions& a, const Positions& b) {
        return (a - b).rowwise().norm().mean();
    };
    EXPECT_LT(
        mean_distance(morph.source_to_target(progress), expected(morph.source().positions, 1.4)),
        0.15);
    EXPECT_LT(mean_distance(morph.target_to_source(progress),
                            expected(morph.target().positions, 1.0 / 1.4)),
              0.15);
    const std::vector<double> middle{0.5};
    EXPECT_LT(morph.cracks(middle, progress).front().share, 0.002);
}

TEST(Morph, TheSphereDoesNotDependOnOrderOrThreads) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    MorphOptions options = on_sphere();
    const auto eggs = [] {
        MorphInput input = two_eggs(1000, 800);
        input.loop.clear();
        return input;
    };
    options.threads = 1;
    const Morph one(eggs(), options, progress);
    options.threads = 3;
    const Morph three(eggs(), options, progress);
    EXPECT_EQ(one.pairs(), three.pairs());
    EXPECT_EQ(one.source_domain(), three.source_domain());
    EXPECT_EQ(one.pairs(), pairs_in_another_order(eggs(), options));

    MorphInput moved = eggs();
    moved.target.positions =
        (8.0 * moved.target.positions).rowwise() + Eigen::RowVector3d(64, 0, 8);
    EXPECT_EQ(one.pairs(), Morph(std::move(moved), options, progress).pairs());
}

TEST(Morph, TheSphereRefusesWhatIsNone) {
    Progress progress;
    const auto with_source = [](Positions positions) {
        MorphInput input = two_eggs(1500, 1200);
        input.loop.clear();
        input.features.clear();
        input.source = Cloud{};
        input.source.positions = std::move(positions);
        return input;
    };
    EXPECT_THROW(
        Morph(with_source(shapes::sphere(is_watched() ? 1000 : 2500, 0.0)), on_sphere(), progress),
        TopologyError);
    EXPECT_THROW(
        Morph(with_source(shapes::torus(is_watched() ? 2000 : 4000, 0.4)), on_sphere(), progress),
        TopologyError);
}

TEST(Morph, NormalsThatPointInwardsAreTurnedBeforeTheSphere) {
    Progress progress;
    MorphInput inward = is_watched() ? two_eggs(700, 600) : two_eggs(1500, 1200);
    inward.loop.clear();
    inward.features.clear();
    inward.source.normals = -inward.source.positions;
    const Morph morph(std::move(inward), on_sphere(), progress);
    EXPECT_TRUE(checks::mentions(morph.report().warnings, "inward"));
    EXPECT_TRUE(
        ((morph.source().normals.array() * morph.source().positions.array()).rowwise().sum() > 0.0)
            .all());
}

TEST(Morph, TheSphereSaysWhenItIsStretchedMuch) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    const auto warned = [&](double side) {
        MorphInput input = two_eggs(1500, 1250);
        input.loop.clear();
        input.features.clear();
        for (const double x : {-1.0, 0.0, 1.0})
            for (const double y : {-0.7, 0.7})
                for (const double z : {-0.6, 0.6})
                    input.features.push_back(
                        point_feature("f" + std::to_string(input.features.size()),
                                      row_near(input.source, x, y, z),
                                      row_near(input.target, x, side * y, z < 0.0 ? 1.4 * z : z)));
        try {
            const Morph morph(std::move(input), on_sphere(), progress);
            return checks::mentions(morph.report().warnings, "heavily stretched");
        } catch (const ConvergenceError&) {
            return true;  // it may also give up
        }
    };
    EXPECT_FALSE(warned(1.0));
    EXPECT_TRUE(warned(-1.0));  // left and right exchanged
}

TEST(Morph, StartsFromTheSphereWhenAskedTo) {
    Progress progress;
    MorphOptions options;
    options.refinement = lighter_where_watched();
    options.domain = Domain::kSphere;
    MorphInput input = two_eggs(800, 700);
    input.loop.clear();
    const Morph morph(std::move(input), options, progress);
    EXPECT_EQ(morph.report().domain, "product");
    EXPECT_TRUE(std::ranges::any_of(morph.report().stages, [](const StageTime& time) {
        return time.stage == "spherical alignment";
    }));
}

}  // namespace
}  // namespace pointmorph

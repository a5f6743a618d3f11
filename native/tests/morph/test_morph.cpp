#include "pointmorph/morph/morph.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/thread_engine.hpp"
#include "checks.hpp"
#include "mesh_shapes.hpp"
#include "morph/morphs.hpp"
#include "morph/words.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/mesh/closest_point.hpp"
#include "registration/watched_options.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// What must hold for every method.
class AnyMorph : public testing::TestWithParam<Method> {
protected:
    static MorphOptions options() {
        MorphOptions options;
        options.method = GetParam();
        options.refinement = lighter_where_watched();
        return options;
    }
};
INSTANTIATE_TEST_SUITE_P(Methods, AnyMorph, testing::Values(Method::kAuto, Method::kPaper),
                         [](const auto& method) {
                             return method.param == Method::kPaper ? "paper" : "automatic";
                         });

TEST_P(AnyMorph, EveryPointOfBothIsInAPairAndEndsAreExact) {
    const Morph morph = make(plane_cloud(41), bump_cloud(33), grid_features(41, 33), options());
    EXPECT_TRUE(checks::is_total(morph.pairs(), 41 * 41, 33 * 33));

    const auto m = morph.pairs().size();
    std::vector<double> positions(3 * m);
    for (const double t : {0.0, 1.0}) {
        morph.straight_path<double>().frame(t, {positions, {}, {}, {}});
        const auto& end = t == 0.0 ? morph.source().positions : morph.target().positions;
        for (std::size_t i = 0; i < m; ++i) {
            const Index row = t == 0.0 ? morph.pairs()[i].source : morph.pairs()[i].target;
            for (int d = 0; d < 3; ++d) ASSERT_EQ(positions[3 * i + d], end(row, d));
        }
    }
}

TEST_P(AnyMorph, FeaturesMeetAndArePaired) {
    SKIP_WHERE_WATCHED();
    const auto features = grid_features(41, 33);
    const Morph morph = make(plane_cloud(41), bump_cloud(33), features, options());
    EXPECT_LE(morph.report().feature_residual, MorphOptions{}.alignment.error);
    EXPECT_TRUE(checks::are_paired(features, morph.pairs()));
}

TEST_P(AnyMorph, OfAShapeToItselfMovesNothingFar) {
    SKIP_WHERE_WATCHED();
    const Morph morph = make(bump_cloud(41), bump_cloud(41), grid_features(41, 41), options());
    Progress progress;
    const Positions image = morph.source_to_target(progress);
    const double spacing = 2.0 / 40;
    const Values moved = (image - morph.source().positions).rowwise().norm();
    EXPECT_LT(moved.mean(), 0.1 * spacing);
    EXPECT_LT(moved.maxCoeff(), spacing);  // in the square's corners, which the circle rounds
    for (const auto& [s, t] : morph.pairs())
        EXPECT_LT((morph.source().positions.row(s) - morph.target().positions.row(t)).norm(),
                  1.6 * spacing);
}

TEST_P(AnyMorph, SmoothMapLandsOnTheOtherSurface) {
    SKIP_WHERE_WATCHED();
    const Morph morph = make(plane_cloud(41), bump_cloud(51), grid_features(41, 51), options());
    Progress progress;
    const Positions image = morph.source_to_target(progress);
    const double spacing = 2.0 / 50;
    for (Index i = 0; i < image.rows(); ++i)
        EXPECT_NEAR(image(i, 2), bump(image(i, 0), image(i, 1)), spacing);
    const Positions back = morph.target_to_source(progress);
    for (Index i = 0; i < back.rows(); ++i) EXPECT_NEAR(back(i, 2), 0.0, 1e-6);
}

TEST_P(AnyMorph, SameBitsForAnyNumberOfThreadsOfAnyEngine) {
    SKIP_WHERE_WATCHED();
    MorphOptions one = options(), two = options();
    one.threads = 1;
    two.threads = 2;
    const Morph a = make(plane_cloud(41), hemisphere(1500), {}, one);
    for (const ThreadEngine* engine : thread_engines()) {
        const EngineScope scope(*engine);
        const Morph b = make(plane_cloud(41), hemisphere(1500), {}, two);
        EXPECT_EQ(a.pairs(), b.pairs());
        EXPECT_EQ(a.source_domain(), b.source_domain());
        EXPECT_EQ(a.target_domain(), b.target_domain());
    }
}

TEST_P(AnyMorph, DoesNotDependOnTheOrderOfThePoints) {
    SKIP_WHERE_WATCHED();
    const Cloud source = bump_cloud(41);
    const auto order = shapes::permutation(source.size(), 7);
    Cloud shuffled = source;
    shuffled.positions = gather(source.positions, order);
    const auto rank = inverse_order(order);
    auto features = grid_features(41, 33);
    const Morph a = make(source, plane_cloud(33), features, options());
    for (Feature& f : features) f.source.rows = {rank[to_size(f.source.rows.front())]};
    const Morph b = make(shuffled, plane_cloud(33), features, options());

    EXPECT_LT((gather(a.source_domain(), order) - b.source_domain()).cwiseAbs().maxCoeff(), 1e-9);
    Pairing renamed = b.pairs();
    for (IndexPair& pair : renamed) pair.source = order[to_size(pair.source)];
    std::ranges::sort(renamed);
    EXPECT_EQ(a.pairs(), renamed);
}

TEST(Words, HeadAndTailAreNotSaidOfThings) {
    Cloud gear = mesh_shapes::icosphere(1);
    gear.name = "gear";
    Diagnostics found;
    found.rivals.emplace_back();
    found.rivals.back().swap = Swap::kEnds;
    const std::string text = doubts(found, gear, gear, {});
    EXPECT_NE(text.find("one end and the other"), std::string::npos) << text;
    EXPECT_EQ(text.find("head"), std::string::npos) << text;
}

TEST(Words, PartsThatAreMatchedDifferentlyAreNamedOnceOrNotAtAll) {
    Cloud ball = mesh_shapes::icosphere(2);
    ball.name = "ball";
    Diagnostics found;
    found.rivals.emplace_back();
    found.rivals.back().swap = Swap::kPlaces;
    const std::string none = doubts(found, ball, ball, {});
    EXPECT_NE(none.find("matched differently. Mark"), std::string::npos) << none;
    Eigen::Index row = 0, corner = 0;
    ball.positions.col(0).maxCoeff(&row);
    (ball.positions.col(0) + ball.positions.col(1)).maxCoeff(&corner);
    // The words of the one are part of those of the other.
    found.rivals.back().places = {to_index(corner), to_index(row), to_index(row)};
    const std::string two = doubts(found, ball, ball, {});
    EXPECT_NE(two.find("(toward +X, +Y; toward +X)"), std::string::npos) << two;
}

TEST(Words, TellTwoPlacesOnOneSideApart) {
    Cloud ball = mesh_shapes::icosphere(4);
    ball.name = "ball";
    Diagnostics found;
    found.rivals.emplace_back();
    Rival& rival = found.rivals.back();
    rival.swap = Swap::kTurned;
    rival.ratio = 1.0;
    const auto nearest = [&](double x, double y, double z) {
        Eigen::Index row = 0;
        (ball.positions.rowwise() - Eigen::RowVector3d(x, y, z)).rowwise().norm().minCoeff(&row);
        return to_index(row);
    };
    rival.target = nearest(1.0, 0.05, 0.0);
    rival.rival_target = nearest(1.0, -0.05, 0.0);
    const std::string text = doubts(found, ball, ball, {});
    EXPECT_NE(text.find("ball fits ball just as well, but rotated differently"), std::string::npos)
        << text;
    const auto now = text.find(" (at 1, 0.0"), otherwise = text.find(" (at 1, -0.0");
    EXPECT_NE(now, std::string::npos) << text;
    EXPECT_NE(otherwise, std::string::npos) << text;
}

TEST(Morph, DoesNotDependOnPlaceTurnOrSize) {
    const Cloud target = hemisphere(2500);
    Cloud moved = target;
    const Matrix3 turn = shapes::rotation(3);
    moved.positions = ((target.positions * turn.transpose()) * 1e-4).rowwise() +
                      Eigen::RowVector3d(1000.0, -2000.0, 500.0);
    const auto features = std::vector<Feature>{point_feature("top", grid_row(41, 0, 0), 0)};
    const Morph a = make(plane_cloud(41), target, features, paper());
    const Morph b = make(plane_cloud(41), moved, features, paper());
    // the order in memory differs, and with it rounding and the choice between equals
    const DomainPoints& p = a.target_domain();
    const DomainPoints& q = b.target_domain();
    const Values apart = (p.rowwise().norm() - q.rowwise().norm()).cwiseAbs();
    EXPECT_LT(apart.mean(), 0.02);
    EXPECT_LT(apart.maxCoeff(), 0.1);
}

TEST_P(AnyMorph, MissingNormalsAreFoundAndGivenOnesKept) {
    SKIP_WHERE_WATCHED();
    Cloud target = bump_cloud(33);
    target.normals = Normals::Constant(target.size(), 3, 0.0);
    target.normals.col(2).setConstant(2.0);
    const Morph morph = make(plane_cloud(33), target, {}, options());
    for (Index i = 0; i < morph.source().size(); ++i)
        EXPECT_NEAR(std::abs(morph.source().normals(i, 2)), 1.0, 1e-6);
    EXPECT_EQ(morph.target().normals, target.normals);
}

TEST(Morph, FeaturesOnBothBoundariesArePinned) {
    const Index side = 41;
    const auto border = shapes::grid_border(side);
    std::vector<Feature> features;
    for (const std::size_t i : {0UL, 40UL, 80UL, 120UL})
        features.push_back(
            point_feature("c" + std::to_string(i), border[i], border[(i + 10) % border.size()]));
    const Morph morph = make(plane_cloud(side), bump_cloud(side), features, paper());
    for (const Feature& f : features)
        EXPECT_LT((morph.source_domain().row(f.source.rows.front()) -
                   morph.target_domain().row(f.target.rows.front()))
                      .norm(),
                  1e-9);
}

TEST(Morph, ReversedBoundaryFeaturesAreRefused) {
    const Index side = 31;
    const auto border = shapes::grid_border(side);
    const auto up = [](Cloud cloud) {
        cloud.normals = Normals::Zero(cloud.size(), 3);
        cloud.normals.col(2).setOnes();
        return cloud;
    };
    std::vector<Feature> features;
    for (const std::size_t i : {0UL, 30UL, 60UL, 90UL})
        features.push_back(point_feature("c" + std::to_string(i), border[i],
                                         border[(border.size() - i) % border.size()]));
    EXPECT_THROW(make(up(plane_cloud(side)), up(bump_cloud(side)), features, paper()),
                 FeatureError);
}

TEST(Morph, BadInputIsRefusedInWords) {
    const auto refuse = [](Cloud source, std::vector<Feature> features) {
        return [=] { make(source, bump_cloud(21), features, paper()); };
    };
    Cloud empty;
    EXPECT_THROW(refuse(empty, {})(), CloudError);
    EXPECT_THROW(refuse(plane_cloud(2), {})(), CloudError);
    EXPECT_THROW(refuse(plane_cloud(21), {point_feature("nose", 441, 0)})(), FeatureError);
    EXPECT_THROW(refuse(plane_cloud(21), {point_feature("nose", -1, 0)})(), FeatureError);
    EXPECT_THROW(
        refuse(plane_cloud(21), {point_feature("nose", 5, 1), point_feature("chin", 5, 2)})(),
        FeatureError);
    EXPECT_THROW(refuse(plane_cloud(21), {point_feature("nose", 20, 220)})(),
                 FeatureError);  // on one boundary
    Cloud closed;
    closed.positions = shapes::sphere(2000);
    EXPECT_THROW(refuse(closed, {})(), TopologyError);
    Cloud apart = plane_cloud(21);
    apart.positions.conservativeResize(882, 3);
    apart.positions.bottomRows(441) = shapes::grid(21).rowwise() + Eigen::RowVector3d(50, 0, 0);
    EXPECT_THROW(refuse(apart, {})(), TopologyError);
    try {
        refuse(plane_cloud(21), {point_feature("nose", 5, 1), point_feature("chin", 5, 2)})();
    } catch (const FeatureError& error) {
        EXPECT_NE(std::string(error.what()).find("\"nose\""), std::string::npos);
        EXPECT_NE(std::string(error.what()).find("plane"), std::string::npos);
    }
}

TEST_P(AnyMorph, CancelWorksInEveryStage) {
    SKIP_WHERE_WATCHED();
    std::vector<std::string> stages;
    Progress watch([&](std::string_view stage, double) {
        if (std::ranges::find(stages, stage) == stages.end()) stages.emplace_back(stage);
        return true;
    });
    const MorphInput input{bump_cloud(25), hemisphere(600), {}, {}, {}, {}};
    const Morph whole(input, options(), watch);
    ASSERT_GE(stages.size(), 6u);
    for (const std::string& last : stages) {
        Progress cancel([&](std::string_view stage, double) { return stage != last; });
        EXPECT_THROW(Morph(input, options(), cancel), Cancelled) << last;
    }
}

TEST_P(AnyMorph, ProgressNeverFallsWithinAStage) {
    SKIP_WHERE_WATCHED();
    std::pair<std::string, double> last;
    std::map<std::string, std::vector<double>> said;
    Progress watch(
        [&](std::string_view stage, double fraction) {
            if (stage == last.first) {
                EXPECT_GE(fraction, last.second) << stage;
            }
            last = {std::string(stage), fraction};
            said[last.first].push_back(fraction);
            return true;
        },
        std::chrono::milliseconds(0));
    const ThreadCount one(1);  // which says all there is to say
    const Morph morph({bump_cloud(25), hemisphere(600), {}, {}, {}, {}}, options(), watch);
    // What is said once isn't taken back: a step may not say the end before it is near.
    constexpr std::ptrdiff_t kMany = 15;
    int long_stages = 0;
    for (const auto& [stage, fractions] : said) {
        if (std::ssize(fractions) < kMany) continue;
        ++long_stages;
        const auto between = [](double fraction) { return fraction > 0.1 && fraction < 0.9; };
        EXPECT_GE(std::ranges::count_if(fractions, between), 3) << stage;
        EXPECT_LT(3 * std::ranges::count(fractions, fractions.back()), 2 * std::ssize(fractions))
            << stage;
    }
    EXPECT_GE(long_stages, 4);
}

TEST(Morph, AnExceptionOfTheCallbackReachesTheCaller) {
    struct Own {};
    Progress progress([](std::string_view, double) -> bool { throw Own(); });
    EXPECT_THROW(Morph({plane_cloud(21), bump_cloud(21), {}, {}, {}, {}}, {}, progress), Own);
}

TEST_P(AnyMorph, CracksOfAGentleMorphAreFew) {
    SKIP_WHERE_WATCHED();
    const Morph morph = make(plane_cloud(61), bump_cloud(51), grid_features(61, 51), options());
    Progress progress;
    const std::vector<double> times{0.0, 0.5, 1.0};
    const auto cracks = morph.cracks(times, progress);
    ASSERT_EQ(cracks.size(), times.size());
    for (const Cracks& at : cracks) EXPECT_LT(at.share, 0.002) << at.t;
}

TEST(Morph, ClosedShapesMorphWithoutAnyMark) {
    SKIP_WHERE_WATCHED();
    Cloud sphere, ellipsoid;
    sphere.positions = sphere.normals = shapes::sphere(1250);
    ellipsoid.positions = shapes::sphere(1500) * Vector3(2.0, 1.0, 0.7).asDiagonal();
    ellipsoid.normals = shapes::sphere(1500) * Vector3(0.5, 1.0, 1 / 0.7).asDiagonal();
    const Morph morph = make(sphere, ellipsoid, {});
    Progress progress;
    const Positions image = morph.source_to_target(progress);
    for (Index i = 0; i < image.rows(); ++i) {
        const Vector3 p = image.row(i).transpose().cwiseQuotient(Vector3(2.0, 1.0, 0.7));
        EXPECT_NEAR(p.norm(), 1.0, 0.05);
    }
    EXPECT_EQ(morph.report().domain, "product");
}

TEST(Morph, AnOpenPatchTakesNoLoopByAnyMethod) {
    const auto features = grid_features(41, 33);
    Progress progress;
    for (const MorphOptions& options : {MorphOptions{}, paper()}) {
        MorphInput input{plane_cloud(41), bump_cloud(33), features, {}, {}, {}};
        for (const Feature& f : features) input.loop.push_back(f.name);
        EXPECT_THROW(Morph(input, options, progress), FeatureError);
    }
}

TEST(Morph, PointsAtOnePlaceGoTogether) {
    // A soup of triangles has every vertex several times, which says nothing about its shape.
    Progress progress;
    for (const Method method : {Method::kAuto, Method::kPaper}) {
        if (method == Method::kPaper && is_watched()) continue;  // joins them in the same way
        MorphOptions options;
        options.method = method;
        options.refinement = lighter_where_watched();
        const MorphInput once = two_eggs(900, 800);
        MorphInput thrice = two_eggs(900, 800);
        thrice.source.positions =
            once.source.positions.replicate(3, 1)(shapes::permutation(2700, 4), Eigen::all).eval();
        for (Feature& f : thrice.features)
            f.source.rows[0] = row_near(thrice.source, once.source.positions(f.source.rows[0], 0),
                                        once.source.positions(f.source.rows[0], 1),
                                        once.source.positions(f.source.rows[0], 2));
        const auto order = shapes::permutation(2700, 4);
        const Morph one(MorphInput(once), options, progress);
        const Morph three(std::move(thrice), options, progress);
        const Positions expected = one.source_to_target(progress);
        const Positions found = three.source_to_target(progress);
        EXPECT_TRUE(checks::is_total(three.pairs(), 2700, three.target().size()));
        for (const IndexPair& pair : three.pairs()) {
            const Index row = order[to_size(pair.source)] % 900;
            EXPECT_TRUE(std::ranges::binary_search(one.pairs(), IndexPair{row, pair.target}));
            EXPECT_EQ(found.row(pair.source), expected.row(row));
        }
    }
}

TEST(Morph, SpecksAndOutliersDoNotBendTheRest) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    const MorphInput clean = two_eggs(2000, 1800);
    MorphInput dusty = two_eggs(2000, 1800);
    dusty.source.positions.conservativeResize(2002, 3);
    dusty.source.positions.row(2000) << 300, 200, -100;
    dusty.source.positions.row(2001) << -5, 0, 9;
    MorphOptions options;
    const Morph one(MorphInput(clean), options, progress);
    const Morph other(std::move(dusty), options, progress);
    const Positions expected = one.source_to_target(progress);
    const Positions found = other.source_to_target(progress);
    EXPECT_EQ(found.topRows(2000), expected);
    for (const Index speck : {2000, 2001}) {
        const Index nearest =
            shapes::nearest_row(clean.source.positions, other.source().positions.row(speck));
        EXPECT_EQ(found.row(speck), expected.row(nearest));
    }
    EXPECT_TRUE(checks::is_total(other.pairs(), 2002, 1800));
    EXPECT_EQ(other.report().source_topology.main().size(), 1u);
    EXPECT_TRUE(checks::mentions(other.report().warnings, "stray point"));
}

TEST(Morph, InwardNormalsOfAClosedModelAreTurned) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    MorphInput input = two_eggs(900, 800);
    const Morph outward(two_eggs(900, 800), {}, progress);
    input.target.normals = -outward.target().normals;
    const Morph morph(std::move(input), {}, progress);
    EXPECT_LT((morph.target().normals - outward.target().normals).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_TRUE(checks::mentions(morph.report().warnings, "pointed inward"));
}

TEST(Morph, FacesThatShowBothSidesPointNowhere) {
    const auto two_sided = [](double size) {
        const Cloud ball = mesh_shapes::icosphere(2);
        const Cloud back = mesh_shapes::reversed(ball, [](Index) { return true; });
        return mesh_shapes::together(
            mesh_shapes::together(back, ball),
            mesh_shapes::moved(mesh_shapes::cube(), size * Matrix3::Identity(),
                               Vector3(2.0, 0.0, 0.0)));
    };
    Progress progress;
    MorphOptions options;
    options.refinement = lighter_where_watched();
    const Morph morph({.source = two_sided(0.5), .target = two_sided(0.6)}, options, progress);
    EXPECT_FALSE(checks::mentions(morph.report().warnings, "inward"));
    const Positions images = morph.source_to_target(progress).bottomRows(8);
    const Positions expected = morph.target().positions.bottomRows(8);
    EXPECT_LT((images - expected).cwiseAbs().maxCoeff(), 0.05);
}

TEST(Morph, StartsFromTheDiskWhenAskedTo) {
    MorphOptions options;
    options.domain = Domain::kDisk;
    options.refinement = lighter_where_watched();
    const Morph morph = make(plane_cloud(41), hemisphere(2500), {}, options);
    EXPECT_EQ(morph.report().domain, "product");
    EXPECT_GT(morph.report().source_parameterization.unknowns, 0);
    Progress progress;
    const Positions image = morph.source_to_target(progress);
    EXPECT_LT((image.rowwise().norm().array() - 1.0).abs().maxCoeff(), 0.05);
}

TEST(Morph, StartsFromAnEarlierOne) {
    SKIP_WHERE_WATCHED();
    const Cloud source = hemisphere(1000), target = bump_cloud(29);
    const Morph first = make(source, target, {point_feature("top", 0, grid_row(29, 0, 0))});
    Progress progress;
    MorphInput input{source, target, {point_feature("top", 0, grid_row(29, 0, 0))}, {}, {}, {}};
    input.start = {first.source_to_target(progress), first.target_to_source(progress)};
    std::vector<std::string> stages;
    Progress watch([&](std::string_view stage, double) {
        stages.emplace_back(stage);
        return true;
    });
    const Morph again(input, {}, watch);
    EXPECT_EQ(std::ranges::count(stages, "pose"), 0);
    const Values moved =
        (again.source_to_target(progress) - input.start.source_images).rowwise().norm();
    EXPECT_LT(moved.mean(), 0.05);

    input.start.target_images.conservativeResize(7, 3);
    EXPECT_THROW(Morph(input, {}, progress), CloudError);
}

TEST(Morph, EstimatedNormalsTurnWhereTheyFaceTheOtherWay) {
    SKIP_WHERE_WATCHED();
    Cloud inward = hemisphere(1200);
    inward.normals = -inward.positions;
    const Morph morph = make(hemisphere(1000), inward, {point_feature("top", 0, 0)});
    EXPECT_EQ(morph.target().normals, inward.normals);
    EXPECT_LT(morph.source().normals.cwiseProduct(morph.source().positions).sum(), 0.0);
}

TEST(Morph, QualityIsMeasuredOnceForBothMethods) {
    SKIP_WHERE_WATCHED();
    for (const Method method : {Method::kAuto, Method::kPaper}) {
        MorphOptions options;
        options.method = method;
        const Morph morph = make(plane_cloud(41), bump_cloud(33), grid_features(41, 33), options);
        Progress progress;
        const Quality& quality = morph.quality(progress);
        EXPECT_EQ(&morph.quality(progress), &quality);
        EXPECT_EQ(quality.source.distortion.size(), 41 * 41);
        EXPECT_EQ(quality.target.distortion.size(), 33 * 33);
        for (const auto& figures : {quality.source_to_target, quality.target_to_source}) {
            EXPECT_GT(figures.dirichlet, 0.95);
            EXPECT_LT(figures.dirichlet, 1.5);
            EXPECT_LT(figures.flipped, 0.01);
            EXPECT_LT(figures.round_trip_p99, 0.1);
            EXPECT_GT(figures.coverage, 0.98);
        }
    }
}

TEST(Example, Morph) {
    SKIP_WHERE_WATCHED();
    const Cloud source = plane_cloud(21), target = bump_cloud(23);
    const Index source_tip = grid_row(21, 0, 0), target_tip = grid_row(23, 0, 0);
    // --- example
    pointmorph::Progress progress;
    const pointmorph::Morph morph({source, target, {point_feature("tip", source_tip, target_tip)}},
                                  {}, progress);
    std::vector<float> positions(3 * morph.pairs().size());
    morph.frame<float>(0.5, {positions, {}, {}, {}});
    // --- end of the example
    EXPECT_TRUE(checks::is_total(morph.pairs(), 21 * 21, 23 * 23));
    double highest = 0.0;
    for (std::size_t i = 2; i < positions.size(); i += 3)
        highest = std::max(highest, static_cast<double>(positions[i]));
    EXPECT_NEAR(highest, 0.5 * bump(0.0, 0.0), 0.04);
}

TEST(Morph, ImagesThatNoMapCanHaveAreRefused) {
    Progress progress;
    for (const double size : {1e-30, 1.0, 1e30}) {
        KeptMorph kept;
        for (Cloud* cloud : {&kept.source, &kept.target}) {
            *cloud = plane_cloud(4);
            cloud->positions *= size;
            cloud->normals = Normals::Constant(16, 3, 1.0 / std::sqrt(3.0));
            cloud->radii = Values::Constant(16, 0.1 * size);
        }
        for (Index i = 0; i < 16; ++i) kept.pairs.push_back({i, i});
        const Positions images = kept.target.positions, away = images.array() + 100.0 * size;
        kept.images = {images, away};
        MorphOptions options;
        options.path = PathKind::kRigid;
        std::vector<double> positions(48);
        Morph(kept, options).frame<double>(0.58, {positions, {}, {}, {}});
        EXPECT_TRUE(std::ranges::all_of(positions, [](double x) { return std::isfinite(x); }));
        const MorphInput input{.source = kept.source, .target = kept.target};
        for (const double far : {1e11 * size, std::numeric_limits<double>::max()}) {
            kept.images.target_images(7, 1) = far;
            EXPECT_THROW(Morph(kept, options), CloudError);
            MorphInput started = input;
            started.start = kept.images;
            EXPECT_THROW(Morph(started, options, progress), CloudError);
        }
    }
}

TEST(Morph, ATorusCoversABall) {
    SKIP_WHERE_WATCHED();
    MorphInput input{.source = mesh_shapes::torus(48, 12, 0.25),
                     .target = mesh_shapes::icosphere(3)};
    Triangles faces(2 * input.source.faces.size(), 3);
    for (Index f = 0; f < input.source.faces.size(); ++f) {
        const auto corners = input.source.faces[f];
        faces.row(2 * f) << corners[0], corners[1], corners[2];
        faces.row(2 * f + 1) << corners[0], corners[2], corners[3];
    }
    Progress progress;
    const Morph morph(std::move(input), {}, progress);
    const Positions end = morph.wrapped(1.0, progress);
    const TriangleTree tree(end, faces, progress);
    const Positions ball = shapes::sphere(2000);
    Index bare = 0;
    for (Index i = 0; i < ball.rows(); ++i)
        bare += tree.closest(ball.row(i).transpose(), 0.1).triangle < 0;
    EXPECT_LT(bare, 20);
}

}  // namespace
}  // namespace pointmorph

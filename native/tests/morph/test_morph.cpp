#include "pointmorph/morph/morph.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

#include "base/thread_engine.hpp"
#include "checks.hpp"
#include "pointmorph/base/error.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// z of a soft bump over the square [−1, 1]².
double bump(double x, double y) {
    return 0.8 * std::exp(-3.0 * (x * x + y * y));
}

Cloud plane_cloud(Index side) {
    Cloud cloud;
    cloud.name = "plane";
    cloud.positions = shapes::grid(side);
    return cloud;
}

Cloud bump_cloud(Index side) {
    Cloud cloud = plane_cloud(side);
    cloud.name = "bump";
    for (Index i = 0; i < cloud.size(); ++i)
        cloud.positions(i, 2) = bump(cloud.positions(i, 0), cloud.positions(i, 1));
    return cloud;
}

Cloud hemisphere(Index count) {
    Cloud cloud;
    cloud.name = "hemisphere";
    cloud.positions = shapes::sphere(count, 0.0);
    return cloud;
}

/// Source rows near where they should be: the row of the grid nearest to (x, y).
Index grid_row(Index side, double x, double y) {
    const auto cell = [&](double c) {
        return static_cast<Index>(std::lround((c + 1) / 2 * (side - 1)));
    };
    return cell(x) * side + cell(y);
}

std::vector<Feature> grid_features(Index source_side, Index target_side) {
    std::vector<Feature> features;
    int number = 0;
    for (const auto& [x, y] : {std::pair{0.0, 0.0}, {0.5, 0.5}, {-0.5, 0.5}, {0.5, -0.25}})
        features.push_back(point_feature("f" + std::to_string(number++),
                                         grid_row(source_side, x, y), grid_row(target_side, x, y)));
    return features;
}

Morph make(Cloud source, Cloud target, std::vector<Feature> features, MorphOptions options = {}) {
    Progress progress;
    return Morph({std::move(source), std::move(target), std::move(features), {}, {}, {}}, options,
                 progress);
}

MorphOptions paper() {
    MorphOptions options;
    options.method = Method::kPaper;
    return options;
}

/// What must hold for every method.
class AnyMorph : public testing::TestWithParam<Method> {
protected:
    static MorphOptions options() {
        MorphOptions options;
        options.method = GetParam();
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
        morph.path<double>().frame(t, {positions, {}, {}, {}});
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

/// A closed egg with a belly, seen differently on both ends.
Cloud egg(Index count, double belly) {
    Cloud cloud;
    cloud.name = "egg";
    cloud.positions = shapes::sphere(count);
    for (Index i = 0; i < count; ++i) {
        const Eigen::RowVector3d p = cloud.positions.row(i);
        cloud.positions.row(i) << 1.6 * p.x(), p.y() * (1.0 + 0.2 * p.x()),
            p.z() * (p.z() < 0.0 ? belly : 1.0);
    }
    return cloud;
}

Index row_near(const Cloud& cloud, double x, double y, double z) {
    Index row;
    (cloud.positions.rowwise() - Eigen::RowVector3d(x, y, z))
        .rowwise()
        .squaredNorm()
        .minCoeff(&row);
    return row;
}

/// Two eggs with four features around them, the loop, one on top and one below.
MorphInput two_eggs(Index source_count, Index target_count) {
    MorphInput input{egg(source_count, 1.0), egg(target_count, 1.4), {}, {}, {}, {}};
    const auto mark = [&](const char* name, double x, double y, double z) {
        input.features.push_back(
            point_feature(name, row_near(input.source, x, y, z),
                          row_near(input.target, x, y, z < 0.0 ? 1.4 * z : z)));
    };
    mark("front", 1.6, 0, 0);
    mark("left", 0, 1, 0);
    mark("back", -1.6, 0, 0);
    mark("right", 0, -1, 0);
    input.loop = {"front", "left", "back", "right"};
    mark("top", 0.3, 0, 0.95);
    mark("bottom", -0.2, 0, -0.95);
    return input;
}

TEST(Morph, ClosedShapesAreCutAlongTheLoop) {
    Progress progress;
    const Morph morph(two_eggs(3000, 2200), paper(), progress);
    EXPECT_EQ(morph.report().domain, "cut");
    EXPECT_EQ(morph.source_domain().cols(), 3);
    EXPECT_LT((morph.source_domain().rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-9);

    EXPECT_TRUE(checks::is_total(morph.pairs(), 3000, 2200));
    double misfit = 0.0;
    for (const IndexPair& pair : morph.pairs()) {
        Eigen::RowVector3d expected = morph.source().positions.row(pair.source);
        if (expected.z() < 0.0) expected.z() *= 1.4;
        misfit += (expected - morph.target().positions.row(pair.target)).norm();
    }
    EXPECT_LT(misfit / static_cast<double>(morph.pairs().size()), 0.25);
    EXPECT_TRUE(checks::are_paired(two_eggs(3000, 2200).features, morph.pairs()));
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

    MorphInput shuffled = two_eggs(1500, 1200);
    const auto order = shapes::permutation(1500, 3);
    const auto rank = inverse_order(order);
    shuffled.source.positions = gather(shuffled.source.positions, order);
    for (Feature& feature : shuffled.features)
        feature.source.rows[0] = rank[to_size(feature.source.rows[0])];
    Pairing pairs = Morph(std::move(shuffled), options, progress).pairs();
    for (IndexPair& pair : pairs) pair.source = order[to_size(pair.source)];
    std::ranges::sort(pairs);
    EXPECT_EQ(one.pairs(), pairs);
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

TEST(Morph, PointsAtOnePlaceGoTogether) {
    // A soup of triangles has every vertex several times, which says nothing about its shape.
    Progress progress;
    for (const Method method : {Method::kAuto, Method::kPaper}) {
        MorphOptions options;
        options.method = method;
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
    constexpr double kSpacing = 0.09;  // of 2,000 points on the egg
    EXPECT_LT((found.topRows(2000) - expected).rowwise().norm().mean(), kSpacing);
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
    EXPECT_TRUE(checks::mentions(morph.report().warnings, "pointed inwards"));
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
    EXPECT_TRUE(checks::mentions(morph.report().warnings, "led round \"beside\""));
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
    options.domain = Domain::kCut;
    const Morph morph(two_eggs(800, 700), options, progress);
    EXPECT_EQ(morph.report().domain, "product");
    EXPECT_TRUE(std::ranges::any_of(morph.report().stages, [](const StageTime& time) {
        return time.stage == "decomposition";
    }));
}

MorphOptions on_sphere() {
    MorphOptions options = paper();
    options.domain = Domain::kSphere;
    return options;
}

TEST(Morph, ClosedShapesMeetOnTheSphere) {
    Progress progress;
    MorphInput input = two_eggs(3000, 2200);
    input.loop.clear();
    const std::vector<Feature> features = input.features;
    const Morph morph(std::move(input), on_sphere(), progress);
    EXPECT_EQ(morph.report().domain, "sphere");
    EXPECT_EQ(morph.report().feature_residual, 0.0);
    EXPECT_LT((morph.source_domain().rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-9);
    EXPECT_TRUE(checks::is_total(morph.pairs(), 3000, 2200));
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

    MorphInput shuffled = eggs();
    const auto order = shapes::permutation(1000, 3);
    const auto rank = inverse_order(order);
    shuffled.source.positions = gather(shuffled.source.positions, order);
    for (Feature& feature : shuffled.features)
        feature.source.rows[0] = rank[to_size(feature.source.rows[0])];
    Pairing pairs = Morph(std::move(shuffled), options, progress).pairs();
    for (IndexPair& pair : pairs) pair.source = order[to_size(pair.source)];
    std::ranges::sort(pairs);
    EXPECT_EQ(one.pairs(), pairs);

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
    EXPECT_THROW(Morph(with_source(shapes::sphere(2500, 0.0)), on_sphere(), progress),
                 TopologyError);
    EXPECT_THROW(Morph(with_source(shapes::torus(4000, 0.4)), on_sphere(), progress),
                 TopologyError);
}

TEST(Morph, NormalsThatPointInwardsAreTurnedBeforeTheSphere) {
    Progress progress;
    MorphInput inward = two_eggs(1500, 1200);
    inward.loop.clear();
    inward.features.clear();
    inward.source.normals = -inward.source.positions;
    const Morph morph(std::move(inward), on_sphere(), progress);
    EXPECT_TRUE(checks::mentions(morph.report().warnings, "inwards"));
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
            return checks::mentions(morph.report().warnings, "stretched much");
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
    options.domain = Domain::kSphere;
    MorphInput input = two_eggs(800, 700);
    input.loop.clear();
    const Morph morph(std::move(input), options, progress);
    EXPECT_EQ(morph.report().domain, "product");
    EXPECT_TRUE(std::ranges::any_of(morph.report().stages, [](const StageTime& time) {
        return time.stage == "spherical alignment";
    }));
}

TEST(Morph, SmallHolesDoNotMakeAnOpenPatch) {
    MorphInput input = two_eggs(3000, 2200);
    // A hole on the source's shoulder.
    std::vector<Index> kept, rank(3000, -1);
    for (Index i = 0; i < 3000; ++i)
        if ((input.source.positions.row(i) - Eigen::RowVector3d(0.9, 0.3, 0.75)).norm() > 0.3) {
            rank[to_size(i)] = static_cast<Index>(kept.size());
            kept.push_back(i);
        }
    input.source.positions = gather(input.source.positions, kept);
    for (Feature& feature : input.features)
        feature.source.rows[0] = rank[to_size(feature.source.rows[0])];
    Progress progress;
    EXPECT_EQ(Morph(std::move(input), paper(), progress).report().domain, "cut");
}

TEST(Morph, StartsFromTheDiskWhenAskedTo) {
    MorphOptions options;
    options.domain = Domain::kDisk;
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

TEST(Morph, EveryPathEndsAtTheInputsAndKeepsToTheSurface) {
    const Matrix3 turn = Eigen::AngleAxisd(2.5, Vector3::UnitX()).toRotationMatrix();
    Cloud source = bump_cloud(29), target = bump_cloud(25);
    target.positions = 3.0 * target.positions * turn.transpose();
    for (const PathKind kind : {PathKind::kSimilarity, PathKind::kRigid}) {
        MorphOptions options;
        options.path = kind;
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

}  // namespace
}  // namespace pointmorph

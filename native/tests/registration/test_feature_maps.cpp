// What features do to the maps of a refinement.
#include "pointmorph/registration/refinement.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "checks.hpp"
#include "registration/belted.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

TEST(Features, AClosedCurveFollowsTheLengthAroundATwist) {
    SKIP_WHERE_WATCHED();
    const Belted belted(kTwist);
    EXPECT_GT(belted.error(belted.refined({})), 5.0);
    const std::vector<Feature> soft{belted.belt};
    EXPECT_LT(belted.error(belted.refined(soft)), 0.2);
    std::vector<Feature> hard{belted.belt};
    hard[0].hard = true;
    const Refinement r = belted.refined(hard);
    EXPECT_LT(belted.error(r), 0.1);
    EXPECT_EQ(r.source_images.row(0), belted.positions[1].row(0));
    EXPECT_EQ(r.target_images.row(0), belted.positions[0].row(0));
}

TEST(Features, MoreWeightLeavesLessResidual) {
    SKIP_WHERE_WATCHED();
    const Belted belted(kTwist);
    double last = HUGE_VAL;
    for (const double weight : {0.003, 0.03, 0.3, 3.0}) {
        std::vector<Feature> features{belted.belt};
        features[0].weight = weight;
        const double error = belted.error(belted.refined(features));
        EXPECT_LT(error, last) << weight;
        last = error;
    }
    EXPECT_LT(last, 0.1);

    // A point that is asked to go 20 degrees, while the six ends of the axes stay.
    const auto nearest = [&](int side, const Vector3& direction) {
        Index row;
        (belted.directions[side] * direction).maxCoeff(&row);
        return row;
    };
    std::vector<Feature> features;
    for (int axis = 0; axis < 6; ++axis) {
        const Vector3 end = (axis % 2 ? -1.0 : 1.0) * Vector3::Unit(axis / 2);
        features.push_back(point_feature(std::to_string(axis), nearest(0, end), nearest(1, end)));
    }
    const Vector3 here = Vector3(1, 1, 1).normalized(), there = Vector3(1, 1, 2).normalized();
    features.push_back(point_feature("pulled", nearest(0, here), nearest(1, there)));
    const auto offset = [&](const Refinement& r) {
        return (r.source_images.row(features.back().source.rows[0]) -
                belted.positions[1].row(features.back().target.rows[0]))
                   .norm() /
               belted.spacing();
    };
    EXPECT_EQ(offset(belted.refined(features)), 0.0);
    features.back().hard = false;
    last = HUGE_VAL;
    for (const double weight : {0.01, 0.1, 1.0, 10.0}) {
        features.back().weight = weight;
        const double now = offset(belted.refined(features));
        EXPECT_GT(now, 0.0);
        EXPECT_LT(now, 0.8 * last) << weight;
        last = now;
    }
    EXPECT_LT(last, 0.1);
}

TEST(Features, SparseMarksOnACurveDoAsWell) {
    const Belted belted(kTwist);
    std::vector<Feature> features{belted.belt};
    features[0].hard = true;
    features[0].source.rows = {0, 10, 20, 30, 40};
    features[0].target.rows = {0, 9, 18, 27};
    EXPECT_LT(belted.error(belted.refined(features)), 0.5);
}

TEST(Features, AnOpenCurveTakesItsEndsAlong) {
    // Half of the belt onto three eighths of the other.
    const Belted belted(0.0);
    std::vector<Feature> features{curve("arc", rows_from(0, 26), rows_from(0, 15), false, true)};
    const Refinement r = belted.refined(features);
    EXPECT_EQ(r.source_images.row(0), belted.positions[1].row(0));
    EXPECT_EQ(r.source_images.row(25), belted.positions[1].row(14));
    for (Index k = 0; k < 26; ++k) {
        const Vector3 direction =
            (r.source_images.row(k).transpose().array() / Eigen::Array3d(1.0, 0.7, 0.9)).matrix();
        EXPECT_LT(std::abs(direction.normalized().z()), 0.2 * belted.spacing());
    }
}

TEST(Features, ARegionGoesIntoItsPartner) {
    SKIP_WHERE_WATCHED();
    const Capped moved(Vector3(0.55, 0.0, 1.0), 0.4, 0.4);
    EXPECT_LT(moved.share(moved.refined(moved.points())), 0.3);
    EXPECT_GE(moved.share(moved.refined(moved.features)), 0.95);

    const Capped grown(Vector3::UnitZ(), 0.35, 0.6);
    EXPECT_LT(grown.share(grown.refined(grown.points())), 0.5);
    EXPECT_GE(grown.share(grown.refined(grown.features)), 0.93);
}

TEST(Features, NoPointOfAHardRegionLeavesIt) {
    Capped moved(Vector3(0.55, 0.0, 1.0), 0.4, 0.5);
    moved.features.back().hard = true;
    EXPECT_EQ(moved.share(moved.refined(moved.features)), 1.0);
}

TEST(Features, MoreWeightBringsMoreOfARegionOver) {
    SKIP_WHERE_WATCHED();
    Capped moved(Vector3(0.55, 0.0, 1.0), 0.4, 0.4);
    double last = moved.share(moved.refined(moved.points()));
    for (const double weight : {0.03, 0.1, 0.5}) {
        moved.features.back().weight = weight;
        const double share = moved.share(moved.refined(moved.features));
        EXPECT_GT(share, last) << weight;
        last = share;
    }
}

TEST(Features, APaintedGradientIsCarriedOntoItself) {
    const Capped faded(Vector3(0.55, 0.0, 1.0), 0.6, 0.6, [](double r) { return 1.0 - r; });
    const Feature& f = faded.features.back();
    const auto mean_difference = [&](const Refinement& r) {
        Values weight = Values::Zero(faded.positions[1].rows());
        for (std::size_t i = 0; i < f.target.rows.size(); ++i)
            weight[f.target.rows[i]] = f.target.weight(i);
        const KdTree<3> tree(faded.positions[1]);
        double sum = 0.0;
        for (std::size_t i = 0; i < f.source.rows.size(); ++i) {
            Index nearest;
            double squared;
            tree.nearest(r.source_images.row(f.source.rows[i]).data(), {&nearest, 1},
                         {&squared, 1});
            sum += std::abs(weight[nearest] - f.source.weight(i));
        }
        return sum / static_cast<double>(f.source.rows.size());
    };
    if (!is_watched()) {
        EXPECT_GT(mean_difference(faded.refined(faded.points())), 0.2);
    }
    // What is watched has fewer points.
    EXPECT_LT(mean_difference(faded.refined(faded.features)), is_watched() ? 0.07 : 0.05);
}

TEST(Features, RegionsTellThePose) {
    SKIP_WHERE_WATCHED();
    // A ball with nothing on it but three regions, turned.
    const Positions s = shapes::sphere(1500), t = shapes::sphere(1200) * shapes::rotation(9);
    const Matrix3 turn = shapes::rotation(7);
    std::vector<Feature> features;
    for (int k = 0; k < 3; ++k) {
        const Vector3 center = Vector3(k == 0, k == 1, 0.3 * k).normalized();
        const auto whole = [](double) { return 1.0; };
        features.push_back(region(std::to_string(k), cap(s, center, 0.3, whole),
                                  cap(t, turn * center, 0.3, whole)));
    }
    Progress progress;
    const Refinement r = refine({s, s}, {t, t}, features, {}, progress);
    EXPECT_LT((r.source_images - s * turn.transpose()).rowwise().norm().mean(), 0.1);
}

TEST(Features, MarksOnHopelessCloudsStillGiveFiniteMaps) {
    Positions line = Positions::Zero(40, 3);
    line.col(0).setLinSpaced(40, 0.0, 1.0);
    const Normals up = Vector3::UnitZ().transpose().replicate(40, 1);
    const Positions same = Positions::Constant(40, 3, 7.0), noise = shapes::cube_noise(40);
    const std::vector<Feature> features{point_feature("a", 0, 0), curve("b", {1, 9, 5}, {4, 2}),
                                        curve("c", {6, 7, 8}, {5, 6, 7}, true, true),
                                        region("d", {{10, 11}, {}}, {{12}, {}}, true)};
    Progress progress;
    for (const Positions& p : {line, noise})
        for (const Positions& q : {line, noise}) {
            const Refinement r = refine({p, up}, {q, up}, features, {}, progress);
            EXPECT_TRUE(r.source_images.allFinite());
            EXPECT_TRUE(r.target_images.allFinite());
        }
    const std::vector<Feature> without{features[0], features[3]};
    const Refinement r = refine({same, up}, {same, up}, without, {}, progress);
    EXPECT_TRUE(r.source_images.allFinite());
}

}  // namespace
}  // namespace pointmorph

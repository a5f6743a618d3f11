#include "registration/marks.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "registration/eggs.hpp"

namespace pointmorph {
namespace {

constexpr Index kSide = 21;

/// A square on both shapes, the target twice as large; marks of every kind.
struct Squares {
    Positions source = shapes::grid(kSide), target = 2.0 * shapes::grid(kSide);
    Normals up = Eigen::RowVector3d(0, 0, 1).replicate(source.rows(), 1);
    std::vector<Feature> features;

    static Index row(Index u, Index v) { return u * kSide + v; }

    Marks marks() const {
        Progress progress;
        return marks_of(features, {source, up}, {target, up}, progress);
    }
};

Feature curve(Index from, Index to, bool hard) {
    return {"curve", FeatureKind::kCurve, {{from, to}, {}}, {{from, to}, {}}, false, hard, 0.5};
}

Feature region(std::vector<Index> rows, std::vector<double> weights, bool hard) {
    return {"region", FeatureKind::kRegion, {rows, weights}, {rows, weights}, false, hard, 2.0};
}

TEST(Marks, PointsArePinnedOrPull) {
    Squares squares;
    squares.features = {point_feature("hard", 3, 4), point_feature("soft", 5, 6)};
    squares.features[1].hard = false;
    const Marks marks = squares.marks();
    EXPECT_EQ(marks.pinned, (std::vector<IndexPair>{{3, 4}}));
    ASSERT_EQ(marks.soft_points.size(), 1u);
    EXPECT_EQ(marks.soft_points[0], &squares.features[1]);
    EXPECT_EQ(marks.pose_pairs, (std::vector<IndexPair>{{3, 4}, {5, 6}}));
    EXPECT_EQ(marks.pose_points, 2);
    EXPECT_EQ(marks.source_members.rows(), 0);
}

TEST(Marks, ACurveShowsThePoseAtEvenShares) {
    Squares squares;
    const Index middle = kSide / 2;
    squares.features = {curve(Squares::row(middle, 2), Squares::row(middle, 18), true)};
    const Marks marks = squares.marks();
    ASSERT_EQ(marks.curves.size(), 1u);
    EXPECT_NEAR(marks.curves[0].source.length(), 1.6, 1e-9);
    EXPECT_NEAR(marks.curves[0].target.length(), 3.2, 1e-9);
    ASSERT_EQ(marks.pose_pairs.size(), 9u);
    EXPECT_EQ(marks.pose_points, 0);
    for (Index k = 0; k < 9; ++k) {
        const Index row = Squares::row(middle, 2 + 2 * k);
        EXPECT_EQ(marks.pose_pairs[to_size(k)], (IndexPair{row, row}));
    }
    const CurvePlaces places = places_along(marks.curves[0], 0.4);
    ASSERT_EQ(places.source.rows(), 9);  // no further apart on the longer one
    for (Index k = 0; k < 9; ++k)
        EXPECT_LT((2.0 * places.source.row(k) - places.target.row(k)).norm(), 1e-9);

    const Similarity grown{3.0, Matrix3::Identity(), Vector3(1, 2, 3)};
    const auto moved = with_target_moved(marks.curves, grown);
    EXPECT_NEAR(moved[0].target.length(), 9.6, 1e-9);
    EXPECT_EQ(moved[0].source.length(), marks.curves[0].source.length());
}

TEST(Marks, ARegionHasAMiddleOfItsOwnAndMembers) {
    Squares squares;
    std::vector<Index> rows;
    std::vector<double> weights;
    for (Index u = 4; u <= 8; ++u)
        for (Index v = 4; v <= 8; ++v) {
            rows.push_back(Squares::row(u, v));
            weights.push_back(u == 6 && v == 6 ? 0.1 : 1.0);  // the middle hardly belongs to it
        }
    squares.features = {region(rows, weights, true)};
    const Marks marks = squares.marks();
    ASSERT_EQ(marks.regions.size(), 1u);
    const IndexPair centers = marks.regions[0].centers;
    EXPECT_NE(centers.source, Squares::row(6, 6));
    EXPECT_LT((squares.source.row(centers.source) - squares.source.row(Squares::row(6, 6))).norm(),
              0.11);
    EXPECT_EQ(marks.pose_pairs, std::vector<IndexPair>{centers});
    EXPECT_EQ(marks.source_members.rows(), squares.source.rows());
    EXPECT_EQ(marks.source_members(Squares::row(4, 4), 0), 1.0);
    EXPECT_EQ(marks.source_members(Squares::row(6, 6), 0), 0.1);
    EXPECT_NEAR(marks.source_members.col(0).sum(), 24.1, 1e-9);
}

TEST(Marks, SoftPointsAndCurvesGuideAndCentersOnlyShowThePose) {
    Squares squares;
    const Index middle = kSide / 2;
    squares.features = {point_feature("soft", 7, 7),
                        curve(Squares::row(middle, 2), Squares::row(middle, 18), false),
                        region({100, 101, 102}, {}, false)};
    squares.features[0].hard = false;
    squares.features[0].weight = 4.0;
    const Marks marks = squares.marks();
    Progress progress;
    const std::vector<Index> required{7, marks.regions[0].centers.source};
    const CoarseShape source = coarse_shape(KdTree<3>(squares.source), squares.up, required,
                                            {200, {40}, {}}, progress),
                      target = coarse_shape(KdTree<3>(squares.target), squares.up, required,
                                            {200, {40}, {}}, progress);
    const RegistrationOptions options;
    const auto [on_source, on_target] = guides_of({source, target}, marks, 0.4, options);
    ASSERT_GT(on_source.size(), 10);
    EXPECT_EQ(on_source.size(), on_target.size());
    EXPECT_EQ(on_source.weights, on_target.weights);
    EXPECT_EQ(on_source.coarse_rows[0], 0);
    EXPECT_EQ(on_source.coarse_rows[1], 1);
    EXPECT_EQ(on_source.weights[0], options.soft_weight * 4.0);
    EXPECT_EQ(on_source.weights[1], 0.0);
    for (Index k = 2; k < on_source.size(); ++k) {
        EXPECT_GT(on_source.weights[k], 0.0);
        EXPECT_LE(on_source.weights[k], options.soft_weight * 0.5);
        EXPECT_LT((2.0 * on_source.places.row(k) - on_target.places.row(k)).norm(), 1e-9);
    }
    EXPECT_EQ(guides_of({source, target}, {}, 0.4, options)[0].size(), 0);
}

TEST(Marks, MembersOfARegionPullMoreAndAreFarFromOthers) {
    Squares squares;
    squares.features = {region({0, 1}, {1.0, 0.5}, true), region({2}, {}, false)};
    squares.features[1].weight = 0.25;
    const Marks marks = squares.marks();
    const RegistrationOptions options;
    const RegionLabels found =
        region_labels(marks.source_members.topRows(4), marks.regions, options);
    EXPECT_NEAR(found.pulls[0], 10.0 * options.region_weight, 1e-9);  // a hard one's at least
    EXPECT_NEAR(found.pulls[1], 5.0 * options.region_weight, 1e-9);
    EXPECT_NEAR(found.pulls[2], 0.25 * options.region_weight, 1e-9);
    EXPECT_EQ(found.pulls[3], 0.0);
    EXPECT_NEAR(found.labels(0, 0), options.label_distance, 1e-12);
    EXPECT_NEAR(found.labels(1, 0), 0.5 * options.label_distance, 1e-12);
    EXPECT_NEAR(found.labels(2, 1), 0.25 * options.label_distance, 1e-12);
    EXPECT_EQ(region_labels({}, {}, options).labels.rows(), 0);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/registration/live_map.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "registration/eggs.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

const RefinementOptions kSmall = [] {
    RefinementOptions options;
    options.coarse = {600, {40, 150}, {}};
    return options;
}();

/// Two ellipsoids with a map that keeps to marks at the ends of their axes.
struct MappedEggs {
    Egg source = oriented_egg(is_watched() ? 900 : 1500, 1),
        target = oriented_egg(is_watched() ? 800 : 1200, 2);
    std::vector<Feature> features;
    RefinementStart map;

    MappedEggs() {
        for (int k = 0; k < 6; ++k) {
            const Vector3 mark =
                (k % 2 ? -1.0 : 1.0) * Vector3::Unit(k / 2).cwiseProduct(Vector3(0.42, 0.3, 0.2));
            features.push_back(point_feature("mark " + std::to_string(k),
                                             shapes::nearest_row(source.positions, mark),
                                             shapes::nearest_row(target.positions, mark)));
        }
        Progress progress;
        Refinement found = refine(here(), there(), features, kSmall, progress);
        map = {std::move(found.source_images), std::move(found.target_images)};
    }
    RefinementCloud here() const { return {source.positions, source.normals}; }
    RefinementCloud there() const { return {target.positions, target.normals}; }
    LiveMap live() const {
        Progress progress;
        return {here(), there(), features, map, kSmall, progress};
    }
    /// The features with the mark at the end of the long axis moved sideways on the target.
    std::vector<Feature> changed(double sideways) const {
        std::vector<Feature> result = features;
        result[0].target.rows = {
            shapes::nearest_row(target.positions, {0.42 - 0.2 * sideways, sideways, 0.0})};
        return result;
    }
};

// Found once: no test changes them.
const MappedEggs& mapped_eggs() {
    static const MappedEggs eggs;
    return eggs;
}

const LiveMap& eggs_live() {
    static const LiveMap live = mapped_eggs().live();
    return live;
}

double root_mean_square(const Positions& a, const Positions& b) {
    return std::sqrt((a - b).rowwise().squaredNorm().mean());
}

TEST(LiveMap, TheSameFeaturesChangeNothing) {
    const MappedEggs& eggs = mapped_eggs();
    const LiveMap& live = eggs_live();
    Progress progress;
    const FollowingPoints points =
        live.follow(eggs.source.positions, eggs.source.normals, progress);
    EXPECT_EQ(live.shifts(points, eggs.features, progress).cwiseAbs().maxCoeff(), 0.0);
    const LiveUpdate update = live.updated(eggs.features, progress);
    EXPECT_EQ(update.newly_torn, 0.0);
    // Projected onto the surface once more.
    EXPECT_LT(root_mean_square(update.refinement.source_images, eggs.map.source_images), 1e-3);
    EXPECT_LT(root_mean_square(update.refinement.target_images, eggs.map.target_images), 1e-3);
}

TEST(LiveMap, AMovedMarkTakesItsSurroundingsAlong) {
    const MappedEggs& eggs = mapped_eggs();
    const LiveMap& live = eggs_live();
    const std::vector<Feature> changed = eggs.changed(0.12);
    Progress progress;
    const Index row = changed[0].source.rows[0], to = changed[0].target.rows[0];
    const Eigen::RowVector3d step = eggs.target.positions.row(to) - eggs.map.source_images.row(row);
    ASSERT_GT(step.norm(), 0.05);

    const Positions shifts = live.shifts(
        live.follow(eggs.source.positions, eggs.source.normals, progress), changed, progress);
    EXPECT_LT((shifts.row(row) - step).norm(), 0.25 * step.norm());
    const Index other = changed[1].source.rows[0];  // the other end stays
    EXPECT_LT(shifts.row(other).norm(), 0.1 * step.norm());

    const Refinement found = live.updated(changed, progress).refinement;
    for (const Feature& f : changed) {
        const Index s = f.source.rows[0], t = f.target.rows[0];
        EXPECT_EQ(found.source_images.row(s), eggs.target.positions.row(t));
        EXPECT_EQ(found.target_images.row(t), eggs.source.positions.row(s));
    }
    const Refinement scratch = refine(eggs.here(), eggs.there(), changed, kSmall, progress);
    EXPECT_LT(root_mean_square(found.source_images, scratch.source_images), 0.02);
    EXPECT_LT(root_mean_square(found.target_images, scratch.target_images), 0.02);
    // Neighbors of the mark go with it: no spike.
    const KdTree<3> tree(eggs.source.positions);
    std::vector<std::pair<Index, double>> around;
    tree.within(eggs.source.positions.row(row).data(), 0.05, around);
    for (const auto& [i, squared] : around)
        EXPECT_LT((found.source_images.row(i) - eggs.target.positions.row(to)).norm(), 0.15);
}

TEST(LiveMap, AnUpdateDependsOnTheFeaturesAlone) {
    SKIP_WHERE_WATCHED();
    const MappedEggs& eggs = mapped_eggs();
    const LiveMap& live = eggs_live();
    Progress progress;
    const auto images = [&](double sideways) {
        return live.updated(eggs.changed(sideways), progress).refinement.source_images;
    };
    const Positions first = images(0.06);
    for (const double along : {0.1, 0.14, 0.1}) images(along);
    EXPECT_EQ(images(0.06), first);
    for (const int count : {1, 2, 5}) {
        const ThreadCount threads(count);
        EXPECT_EQ(images(0.06), first) << count;
        EXPECT_EQ(eggs.live().updated(eggs.changed(0.06), progress).refinement.source_images, first)
            << count;
    }
}

TEST(LiveMap, MarksComeAndGo) {
    const MappedEggs& eggs = mapped_eggs();
    const LiveMap& live = eggs_live();
    Progress progress;
    std::vector<Feature> fewer(eggs.features.begin() + 1, eggs.features.end());
    EXPECT_LT(root_mean_square(live.updated(fewer, progress).refinement.source_images,
                               eggs.map.source_images),
              0.02);
    std::vector<Feature> more = eggs.features;
    const Vector3 place = Vector3(1, 1, 1).normalized().cwiseProduct(Vector3(0.42, 0.3, 0.2));
    more.push_back(point_feature("new", shapes::nearest_row(eggs.source.positions, place),
                                 shapes::nearest_row(eggs.target.positions, place)));
    const Feature& added = more.back();
    const Refinement found = live.updated(more, progress).refinement;
    EXPECT_EQ(found.source_images.row(added.source.rows[0]),
              eggs.target.positions.row(added.target.rows[0]));
    EXPECT_EQ(live.updated({}, progress).refinement.pairs.empty(), false);
}

TEST(LiveMap, SoftPointsCurvesAndRegionsPullToo) {
    const MappedEggs& eggs = mapped_eggs();
    const LiveMap& live = eggs_live();
    Progress progress;
    std::vector<Feature> soft = eggs.changed(0.12);
    const Index row = soft[0].source.rows[0], to = soft[0].target.rows[0];
    const auto distance = [&](const std::vector<Feature>& features) {
        return (live.updated(features, progress).refinement.source_images.row(row) -
                eggs.target.positions.row(to))
            .norm();
    };
    const std::vector<Feature> without(soft.begin() + 1, soft.end());
    soft[0].hard = false;
    const double pulled = distance(soft);
    soft[0].weight = 0.01;
    const double hardly = distance(soft);
    EXPECT_LT(pulled, 0.5 * distance(without));
    EXPECT_LT(pulled, hardly);

    std::vector<Feature> curve = without;
    const Index end = eggs.features[2].source.rows[0], end_there = eggs.features[2].target.rows[0];
    curve.push_back(
        {"curve", FeatureKind::kCurve, {{row, end}, {}}, {{to, end_there}, {}}, false, true, 1.0});
    EXPECT_LT(distance(curve), 1e-12);
}

TEST(LiveMap, RegionsPull) {
    const MappedEggs& eggs = mapped_eggs();
    const LiveMap& live = eggs_live();
    Progress progress;
    const auto around = [](const Egg& egg, Index row) {
        std::vector<Index> rows;
        for (Index i = 0; i < to_index(egg.positions.rows()); ++i)
            if ((egg.positions.row(i) - egg.positions.row(row)).norm() < 0.12) rows.push_back(i);
        return rows;
    };
    const Feature moved = eggs.changed(0.12)[0];
    const std::vector<Index> here = around(eggs.source, moved.source.rows[0]),
                             there = around(eggs.target, moved.target.rows[0]);
    const std::vector<Feature> without(eggs.features.begin() + 1, eggs.features.end());
    std::vector<Feature> with = without;
    with.push_back({"region", FeatureKind::kRegion, {here, {}}, {there, {}}, false, false, 1.0});
    const Eigen::RowVector3d wanted = gather(eggs.target.positions, there).colwise().mean();
    const auto distance = [&](const std::vector<Feature>& features) {
        const Positions images = live.updated(features, progress).refinement.source_images;
        return (gather(images, here).colwise().mean() - wanted).norm();
    };
    EXPECT_LT(distance(with), 0.5 * distance(without));
}

TEST(LiveMap, TheFarthestFeatureIsNamed) {
    const MappedEggs& eggs = mapped_eggs();
    const LiveMap& live = eggs_live();
    EXPECT_LT(live.farthest(eggs.features).distance, 1e-12);
    const FarFeature far = live.farthest(eggs.changed(0.14));
    EXPECT_EQ(far.name, "mark 0");
    EXPECT_GT(far.distance, 0.1);
    EXPECT_EQ(live.farthest({}).name, "");
}

TEST(LiveMap, CanBeCanceledAndAskedAgain) {
    const MappedEggs& eggs = mapped_eggs();
    const LiveMap& live = eggs_live();
    Progress stopping([](std::string_view, double) { return false; }, std::chrono::milliseconds(0));
    EXPECT_THROW(live.updated(eggs.changed(0.1), stopping), Cancelled);
    EXPECT_THROW(LiveMap(eggs.here(), eggs.there(), eggs.features, eggs.map, kSmall, stopping),
                 Cancelled);
    Progress progress;
    EXPECT_EQ(live.updated(eggs.changed(0.1), progress).refinement.source_images,
              eggs.live().updated(eggs.changed(0.1), progress).refinement.source_images);
}

TEST(Example, LiveMap) {
    SKIP_WHERE_WATCHED();
    const MappedEggs& eggs = mapped_eggs();
    const Egg &source = eggs.source, &target = eggs.target;
    const std::vector<Feature>& features = eggs.features;
    const std::vector<Feature> changed = eggs.changed(0.1);
    const RefinementStart& map = eggs.map;
    Progress progress;
    // --- example
    const LiveMap live({source.positions, source.normals}, {target.positions, target.normals},
                       features, map, {}, progress);
    const Positions images = live.updated(changed, progress).refinement.source_images;
    // --- end of the example
    EXPECT_EQ(images.rows(), source.positions.rows());
}

}  // namespace
}  // namespace pointmorph

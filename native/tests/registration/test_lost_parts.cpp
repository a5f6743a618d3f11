#include "registration/lost_parts.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/product_space.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

constexpr Index kCount = 4000;
constexpr double kCut = 0.5;

/// A ball that is three times as long as it is wide, and the same up to a height, above which the
/// map back folds it.
struct FoldedBack {
    Positions whole, part;
    Normals whole_normals, part_normals;
    Neighborhoods whole_nearest, part_nearest;
    std::vector<Index> ends;
    double spacing = 0.0;
    Refinement map;

    FoldedBack() {
        whole = shapes::sphere(kCount);
        whole_normals = whole;
        whole.col(2) *= 3.0;
        whole_normals.col(2) /= 3.0;
        whole_normals.rowwise().normalize();
        std::vector<Index> rows, row_of(to_size(kCount), -1);
        for (Index i = 0; i < kCount; ++i)
            if (whole(i, 2) < kCut) {
                row_of[to_size(i)] = to_index(rows.size());
                rows.push_back(i);
            }
        part = gather(whole, rows);
        part_normals = gather(whole_normals, rows);
        Progress progress;
        whole_nearest = nearest_neighbors(KdTree<3>(whole), 16, progress);
        part_nearest = nearest_neighbors(KdTree<3>(part), 16, progress);
        const Values spacings = local_spacing(whole, whole_nearest);
        spacing = spacings.mean();
        for (Index i = 0; i < part.rows(); ++i)
            if (part(i, 2) > kCut - spacing) ends.push_back(i);
        map.source_images = part;
        map.target_images = whole;
        for (Index i = 0; i < kCount; ++i)
            map.target_images(i, 2) = std::min(whole(i, 2), 2.0 * kCut - whole(i, 2));
        const std::vector<Index> feet = nearest_rows(KdTree<3>(part), map.target_images);
        for (Index i = 0; i < kCount; ++i) map.pairs.push_back({feet[to_size(i)], i});
        for (std::size_t k = 0; k < rows.size(); ++k) map.pairs.push_back({to_index(k), rows[k]});
        std::ranges::sort(map.pairs);
        map.pairs.erase(std::unique(map.pairs.begin(), map.pairs.end()), map.pairs.end());
        const OrientedView source{part, part_normals}, target{whole, whole_normals};
        map.source_product = product_points(source, source, 0.02);
        map.target_product = product_points(target, {map.target_images, whole_normals}, 0.02);
    }
    Refinement joined(const std::vector<Index>& at, const std::vector<Feature>& features) const {
        Progress progress;
        const SampledSurface source{part, part_normals, part_nearest},
            target{whole, whole_normals, whole_nearest};
        return with_lost_parts_at_ends(map, {source, at}, {target, {}}, features, progress);
    }
};

TEST(LostParts, JoinTheNearestEnd) {
    const FoldedBack shapes;
    const Refinement joined = shapes.joined(shapes.ends, {});
    const Positions ends = gather(shapes.part, shapes.ends);
    const std::vector<Index> nearest = nearest_rows(KdTree<3>(ends), joined.target_images);
    for (Index i = 0; i < kCount; ++i) {
        const bool is_end = joined.target_images.row(i) == ends.row(nearest[to_size(i)]);
        if (shapes.whole(i, 2) > kCut + 4.0 * shapes.spacing) {
            EXPECT_TRUE(is_end) << i;
        }
        if (shapes.whole(i, 2) > kCut) continue;
        EXPECT_EQ(joined.target_images.row(i), shapes.map.target_images.row(i)) << i;
        EXPECT_EQ(joined.target_product.row(i), shapes.map.target_product.row(i)) << i;
    }
    EXPECT_EQ(joined.source_images, shapes.map.source_images);
    // On the side where they are: the border is a ring.
    for (Index i = 0; i < kCount; ++i) {
        const double from_axis = shapes.whole.row(i).head<2>().norm();
        if (shapes.whole(i, 2) < kCut + 4.0 * shapes.spacing || from_axis < 0.3) continue;
        EXPECT_GT(shapes.whole.row(i).head<2>().dot(joined.target_images.row(i).head<2>()),
                  0.7 * from_axis * joined.target_images.row(i).head<2>().norm())
            << i;
    }
}

TEST(LostParts, EveryPointKeepsAPartner) {
    const FoldedBack shapes;
    const Refinement joined = shapes.joined(shapes.ends, {});
    std::vector<Index> of_source(to_size(shapes.part.rows()), 0), of_target(to_size(kCount), 0);
    for (const IndexPair& pair : joined.pairs) {
        ++of_source[to_size(pair.source)];
        ++of_target[to_size(pair.target)];
    }
    EXPECT_EQ(std::ranges::count(of_source, 0), 0);
    EXPECT_EQ(std::ranges::count(of_target, 0), 0);
    EXPECT_TRUE(std::ranges::is_sorted(joined.pairs));
    EXPECT_EQ(std::ranges::adjacent_find(joined.pairs), joined.pairs.end());
    // What is at an end is paired with it.
    const std::vector<Index> feet = nearest_rows(KdTree<3>(shapes.part), joined.target_images);
    for (Index i = 0; i < kCount; ++i)
        if (shapes.whole(i, 2) > kCut + 4.0 * shapes.spacing) {
            EXPECT_TRUE(std::ranges::binary_search(joined.pairs, IndexPair{feet[to_size(i)], i}));
        }
}

TEST(LostParts, StayWithoutAnEndOrWithAFeature) {
    const FoldedBack shapes;
    EXPECT_EQ(shapes.joined({}, {}).target_images, shapes.map.target_images);
    // The other end of the ball.
    Index lowest = 0;
    shapes.part.col(2).minCoeff(&lowest);
    EXPECT_EQ(shapes.joined({lowest}, {}).pairs, shapes.map.pairs);
    Index highest = 0;
    shapes.whole.col(2).maxCoeff(&highest);
    const Refinement marked =
        shapes.joined(shapes.ends, {point_feature("tip", shapes.ends.front(), highest)});
    EXPECT_EQ(marked.target_images, shapes.map.target_images);
}

}  // namespace
}  // namespace pointmorph

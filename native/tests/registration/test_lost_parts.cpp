#include "registration/lost_parts.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <initializer_list>
#include <numbers>
#include <span>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <vector>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/product_space.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

constexpr Index kCount = 4000;
constexpr double kCut = 0.5;

/// A ball that is three times as long as it is wide, and the same up to a height, above which the
/// map back folds it.
struct FoldedBack {
    Positions whole, part;
    Positions elsewhere;  ///< the whole, moved away
    Normals whole_normals, part_normals;
    Neighborhoods whole_nearest, part_nearest;
    std::vector<Index> ends;
    double spacing = 0.0;
    Refinement map;

    explicit FoldedBack(double cut = kCut) {
        whole = shapes::sphere(kCount);
        whole_normals = whole;
        whole.col(2) *= 3.0;
        whole_normals.col(2) /= 3.0;
        whole_normals.rowwise().normalize();
        std::vector<Index> rows, row_of(to_size(kCount), -1);
        for (Index i = 0; i < kCount; ++i)
            if (whole(i, 2) < cut) {
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
            if (part(i, 2) > cut - spacing) ends.push_back(i);
        elsewhere = whole.rowwise() + Eigen::RowVector3d(5.0, 0.0, 0.0);
        map.source_images = gather(elsewhere, rows);
        map.target_images = whole;
        for (Index i = 0; i < kCount; ++i)
            map.target_images(i, 2) = std::min(whole(i, 2), 2.0 * cut - whole(i, 2));
        const std::vector<Index> feet = nearest_rows(KdTree<3>(part), map.target_images);
        for (Index i = 0; i < kCount; ++i) map.pairs.push_back({feet[to_size(i)], i});
        for (std::size_t k = 0; k < rows.size(); ++k) map.pairs.push_back({to_index(k), rows[k]});
        std::ranges::sort(map.pairs);
        map.pairs.erase(std::unique(map.pairs.begin(), map.pairs.end()), map.pairs.end());
        map.source_product =
            product_points({map.source_images, part_normals}, {part, part_normals}, 0.02);
        map.target_product =
            product_points({elsewhere, whole_normals}, {map.target_images, whole_normals}, 0.02);
    }
    SampledSurface of_part() const { return {part, part_normals, part_nearest}; }
    SampledSurface of_whole() const { return {elsewhere, whole_normals, whole_nearest}; }
    Refinement joined(const std::vector<Index>& at, const std::vector<Feature>& features) const {
        Progress progress;
        Refinement result = map;
        send_lost_parts_to_ends(result, {of_part(), at}, {of_whole(), {}}, features, progress);
        return result;
    }
};

TEST(LostParts, JoinAnEndOnTheirSide) {
    const FoldedBack shapes;
    const Refinement joined = shapes.joined(shapes.ends, {});
    const Positions ends = gather(shapes.part, shapes.ends);
    const std::vector<Index> nearest = nearest_rows(KdTree<3>(ends), joined.target_images);
    for (Index i = 0; i < kCount; ++i) {
        const bool is_end = joined.target_images.row(i) == ends.row(nearest[to_size(i)]);
        if (shapes.whole(i, 2) > kCut + 4.0 * shapes.spacing) {
            EXPECT_TRUE(is_end) << i;
            const Index end = shapes.ends[to_size(nearest[to_size(i)])];
            for (const Eigen::Index column : {3, 9})  // of the source
                EXPECT_EQ(joined.target_product.row(i).segment<3>(column),
                          shapes.map.source_product.row(end).segment<3>(column));
            for (const Eigen::Index column : {0, 6})
                EXPECT_EQ(joined.target_product.row(i).segment<3>(column),
                          shapes.map.target_product.row(i).segment<3>(column));
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
                  0.6 * from_axis * joined.target_images.row(i).head<2>().norm())
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

/// Whether all of the whole from a height on lies at ends.
void expect_at_ends(const FoldedBack& shapes, const Refinement& joined, double height) {
    const Positions ends = gather(shapes.part, shapes.ends);
    const std::vector<Index> nearest = nearest_rows(KdTree<3>(ends), joined.target_images);
    for (Index i = 0; i < kCount; ++i)
        if (shapes.whole(i, 2) > height) {
            EXPECT_EQ(joined.target_images.row(i), ends.row(nearest[to_size(i)])) << i;
        }
}

TEST(LostParts, TakeInWhatAStrayImageComesNear) {
    FoldedBack shapes;
    Index lowest = 0, above = 0;
    shapes.part.col(2).minCoeff(&lowest);
    (shapes.whole.col(2).array() - 4.0 * kCut).abs().minCoeff(&above);
    shapes.map.source_images.row(lowest) = shapes.elsewhere.row(above);
    expect_at_ends(shapes, shapes.joined(shapes.ends, {}), kCut + 4.0 * shapes.spacing);
}

TEST(LostParts, LeaveAMarkThatTheySurround) {
    FoldedBack shapes;
    Index lowest = 0, above = 0;
    shapes.part.col(2).minCoeff(&lowest);
    (shapes.whole.col(2).array() - 4.0 * kCut).abs().minCoeff(&above);
    shapes.map.source_images.row(lowest) = shapes.elsewhere.row(above);
    const Refinement joined = shapes.joined(shapes.ends, {point_feature("spot", lowest, above)});
    EXPECT_EQ(joined.target_images.row(above), shapes.map.target_images.row(above));
    const Positions ends = gather(shapes.part, shapes.ends);
    const std::vector<Index> nearest = nearest_rows(KdTree<3>(ends), joined.target_images);
    constexpr double kFar = 12.0;  // spacings: what is near the image is no farther from it than 2
    int far = 0;
    for (Index i = 0; i < kCount; ++i) {
        const double away = (shapes.whole.row(i) - shapes.whole.row(above)).norm();
        if (shapes.whole(i, 2) < kCut + 4.0 * shapes.spacing || away < kFar * shapes.spacing)
            continue;
        EXPECT_EQ(joined.target_images.row(i), ends.row(nearest[to_size(i)])) << i;
        ++far;
    }
    EXPECT_GT(far, 500);
}

TEST(LostParts, LeaveAllThatIsLeftEvenIfTheySurroundIt) {
    constexpr double kLow = -2.4;  // a small part of the whole
    const FoldedBack shapes(kLow);
    const Refinement joined = shapes.joined(shapes.ends, {});
    for (Index i = 0; i < kCount; ++i)
        if (shapes.whole(i, 2) < kLow) {
            EXPECT_EQ(joined.target_images.row(i), shapes.map.target_images.row(i)) << i;
        }
    expect_at_ends(shapes, joined, kLow + 4.0 * shapes.spacing);
}

/// With no neighbors across heights of the whole, as if it were pieces.
void take_apart(FoldedBack& shapes, std::initializer_list<double> heights) {
    Positions apart = shapes.whole;
    for (Index i = 0; i < kCount; ++i)
        for (const double height : heights)
            if (shapes.whole(i, 2) > height) apart(i, 0) += 10.0;
    Progress progress;
    shapes.whole_nearest = nearest_neighbors(KdTree<3>(apart), 16, progress);
}

/// What lies above that height goes to its own side of the ring, but for what is near the axis.
void expect_on_its_side(const FoldedBack& shapes, const Refinement& joined, double height) {
    for (Index i = 0; i < kCount; ++i) {
        const double from_axis = shapes.whole.row(i).head<2>().norm();
        if (shapes.whole(i, 2) < height || from_axis < 0.3) continue;
        EXPECT_GT(shapes.whole.row(i).head<2>().dot(joined.target_images.row(i).head<2>()), 0.0)
            << i;
    }
}

TEST(LostParts, TakeWhatLiesLooseBesideThem) {
    FoldedBack shapes;
    constexpr double kLoose = 4.0 * kCut;
    take_apart(shapes, {kLoose});
    const Refinement joined = shapes.joined(shapes.ends, {});
    expect_at_ends(shapes, joined, kCut + 4.0 * shapes.spacing);
    expect_on_its_side(shapes, joined, kLoose);
}

TEST(LostParts, LieLooseBesideWhatIsNotLost) {
    FoldedBack shapes;
    // Beneath, points that are too near to be a part.
    const double above = kCut + 3.5 * shapes.spacing;
    take_apart(shapes, {above});
    const Refinement joined = shapes.joined(shapes.ends, {});
    expect_at_ends(shapes, joined, above);
    for (Index i = 0; i < kCount; ++i)
        if (shapes.whole(i, 2) < above) {
            EXPECT_EQ(joined.target_images.row(i), shapes.map.target_images.row(i)) << i;
        }
}

TEST(LostParts, LieLooseBesideOneAnother) {
    FoldedBack shapes;
    constexpr double kLower = 3.0 * kCut, kUpper = 4.0 * kCut;
    take_apart(shapes, {kLower, kUpper});
    // Both are nearer to each other than to the rest.
    for (Index i = 0; i < kCount; ++i)
        if (shapes.whole(i, 2) > kLower) shapes.elsewhere(i, 2) += 5.0 * shapes.spacing;
    const Refinement joined = shapes.joined(shapes.ends, {});
    expect_at_ends(shapes, joined, kCut + 4.0 * shapes.spacing);
    expect_on_its_side(shapes, joined, kLower);
}

TEST(LostParts, JoinEndsOfTheTargetAsThoseOfTheSource) {
    const FoldedBack shapes;
    const Refinement joined = shapes.joined(shapes.ends, {});
    const auto swapped = [](const ProductPoints& product) {
        ProductPoints result = product;
        for (const Eigen::Index column : {0, 6}) {
            result.middleCols<3>(column) = product.middleCols<3>(column + 3);
            result.middleCols<3>(column + 3) = product.middleCols<3>(column);
        }
        return result;
    };
    Refinement back = shapes.map;
    std::swap(back.source_images, back.target_images);
    back.source_product = swapped(shapes.map.target_product);
    back.target_product = swapped(shapes.map.source_product);
    for (IndexPair& pair : back.pairs) std::swap(pair.source, pair.target);
    std::ranges::sort(back.pairs);
    for (const int threads : {1, 4}) {
        const ThreadCount limit(threads);
        Progress progress;
        Refinement there = back;
        const LostPoints lost = send_lost_parts_to_ends(
            there, {shapes.of_whole(), {}}, {shapes.of_part(), shapes.ends}, {}, progress);
        EXPECT_GT(lost.of_source, 0);
        EXPECT_EQ(lost.of_target, 0);
        EXPECT_EQ(there.source_images, joined.target_images);
        EXPECT_EQ(swapped(there.source_product), joined.target_product);
        for (IndexPair& pair : there.pairs) std::swap(pair.source, pair.target);
        std::ranges::sort(there.pairs);
        EXPECT_EQ(there.pairs, joined.pairs);
    }
}

TEST(LostParts, AreAStageOfTheirOwnWhereThereAreEnds) {
    const FoldedBack shapes;
    const auto timed = [&](const std::vector<Index>& ends) {
        Progress progress;
        Refinement map = shapes.map;
        send_lost_parts_to_ends(map, {shapes.of_part(), ends}, {shapes.of_whole(), {}}, {},
                                progress);
        progress.finish();
        return progress.stages();
    };
    const std::vector<StageTime> stages = timed(shapes.ends);
    ASSERT_EQ(stages.size(), 1u);
    EXPECT_EQ(stages[0].stage, "missing parts");
    EXPECT_GT(stages[0].seconds, 0.0);
    EXPECT_TRUE(timed({}).empty());
}

TEST(LostParts, CanBeCanceled) {
    const FoldedBack shapes;
    Progress progress([](std::string_view, double) { return false; }, std::chrono::milliseconds(0));
    Refinement map = shapes.map;
    EXPECT_THROW(send_lost_parts_to_ends(map, {shapes.of_part(), shapes.ends},
                                         {shapes.of_whole(), {}}, {}, progress),
                 Cancelled);
}

/// How often it is asked whether to end, on one thread, if the answer is yes at number `last`.
int times_asked(const FoldedBack& shapes, int last) {
    const ThreadCount one(1);
    int asked = 0;
    Progress progress([&](std::string_view, double) { return ++asked < last; },
                      std::chrono::milliseconds(0));
    Refinement map = shapes.map;
    const auto send = [&] {
        send_lost_parts_to_ends(map, {shapes.of_part(), shapes.ends}, {shapes.of_whole(), {}}, {},
                                progress);
    };
    try {
        send();
        EXPECT_LT(asked, last);
    } catch (const Cancelled&) {
        EXPECT_EQ(asked, last);
        EXPECT_EQ(map.target_images, shapes.map.target_images);
    }
    return asked;
}

TEST(LostParts, CanBeCanceledWhereverTheyAskAndAskAboutEachLoosePiece) {
    constexpr int kNever = 1'000'000;
    FoldedBack shapes;
    const int of_one = times_asked(shapes, kNever);
    // What is below the first cut is deep enough to be lost.
    take_apart(shapes, {3.6 * kCut, 3.9 * kCut, 4.2 * kCut, 4.5 * kCut, 4.8 * kCut, 5.1 * kCut});
    const int all = times_asked(shapes, kNever);
    // When it is found, when its tree is made, and when what lies beside it is looked for.
    EXPECT_GE(all, of_one + 3 * 6);
    for (int last = 1; last <= all; last += is_watched() ? 4 : 1)
        EXPECT_EQ(times_asked(shapes, last), last);
}

TEST(LostParts, WhatTheCallbackThrowsIsThrown) {
    const FoldedBack shapes;
    Progress progress([](std::string_view, double) -> bool { throw std::out_of_range("here"); },
                      std::chrono::milliseconds(0));
    Refinement map = shapes.map;
    EXPECT_THROW(send_lost_parts_to_ends(map, {shapes.of_part(), shapes.ends},
                                         {shapes.of_whole(), {}}, {}, progress),
                 std::out_of_range);
}

/// The share of the lost points whose way to the place that they hang on, at its middle, is farther
/// than two spacings from all points.
double torn_ways(const Positions& whole, const std::vector<Index>& lost, const Positions& places,
                 double spacing) {
    Positions middles(to_index(lost.size()), 3);
    for (Index k = 0; k < middles.rows(); ++k)
        middles.row(k) = (whole.row(lost[to_size(k)]) + places.row(k)) / 2.0;
    const Positions nearest = gather(whole, nearest_rows(KdTree<3>(whole), middles));
    return static_cast<double>(
               ((middles - nearest).rowwise().norm().array() > 2.0 * spacing).count()) /
           static_cast<double>(lost.size());
}

/// A square with a limb that is bent all along it, and the square alone: the limb is a tube around
/// an arc.
struct BentLimb {
    Positions whole, part;
    Normals whole_normals, part_normals;
    Neighborhoods whole_nearest, part_nearest;
    std::vector<Index> ring;  ///< of the part, around the hole
    std::vector<Index> limb;  ///< of the whole
    Positions roots;          ///< where each point of the limb is on the ring, straight along it
    Refinement map;

    static constexpr double kStep = 0.1, kWide = 3.0, kBend = 1.5;

    /// `radius`: of the limb and the hole.
    explicit BentLimb(double radius, double spread = 0.02) {
        std::vector<Eigen::RowVector3d> places, ups;
        for (double x = -kWide; x < kWide; x += kStep)
            for (double y = -kWide; y < kWide; y += kStep) {
                const Eigen::RowVector3d place(x + spread * y, y + spread * x, 0.0);
                if (place.norm() < radius) continue;
                if (place.norm() < radius + kStep) ring.push_back(to_index(places.size()));
                places.push_back(place);
                ups.emplace_back(0.0, 0.0, 1.0);
            }
        const Index flat = to_index(places.size());
        const double around = std::ceil(2.0 * std::numbers::pi * radius / kStep);
        for (double along = kStep; along < 0.75 * std::numbers::pi * kBend; along += kStep)
            for (double k = 0.0; k < around; ++k) {
                const double a = along / kBend, b = 2.0 * std::numbers::pi * k / around;
                const Eigen::RowVector3d out(std::cos(a), 0.0, std::sin(a)), side(0.0, 1.0, 0.0);
                const Eigen::RowVector3d up = std::cos(b) * out + std::sin(b) * side;
                limb.push_back(to_index(places.size()));
                places.push_back(kBend * out - Eigen::RowVector3d(kBend, 0.0, 0.0) + radius * up);
                ups.push_back(up);
            }
        whole.resize(to_index(places.size()), 3);
        whole_normals.resize(whole.rows(), 3);
        for (Index i = 0; i < whole.rows(); ++i) {
            whole.row(i) = places[to_size(i)];
            whole_normals.row(i) = ups[to_size(i)];
        }
        roots.resize(to_index(limb.size()), 3);
        for (Index k = 0; k < roots.rows(); ++k)
            roots.row(k) = whole.row(flat + k % static_cast<Index>(around));
        part = whole.topRows(flat);
        part_normals = whole_normals.topRows(flat);
        Progress progress;
        whole_nearest = nearest_neighbors(KdTree<3>(whole), 16, progress);
        part_nearest = nearest_neighbors(KdTree<3>(part), 16, progress);
        map.source_images = part;
        const std::vector<Index> feet = nearest_rows(KdTree<3>(part), whole);
        map.target_images = gather(part, feet);
        for (Index i = 0; i < whole.rows(); ++i) map.pairs.push_back({feet[to_size(i)], i});
        std::ranges::sort(map.pairs);
        map.source_product = product_points({part, part_normals}, {part, part_normals}, 0.02);
        map.target_product =
            product_points({whole, whole_normals}, {map.target_images, whole_normals}, 0.02);
    }
    std::pair<Refinement, LostPoints> joined(std::span<const Index> ends) const {
        Progress progress;
        Refinement result = map;
        const SampledSurface source{part, part_normals, part_nearest},
            target{whole, whole_normals, whole_nearest};
        LostPoints lost =
            send_lost_parts_to_ends(result, {source, ends}, {target, {}}, {}, progress);
        return {std::move(result), std::move(lost)};
    }
};

TEST(LostParts, HangOnPlacesToWhichTheWayStaysCloseToThem) {
    const BentLimb shapes(0.8);
    const Refinement joined = shapes.joined(shapes.ring).first;
    {
        const ThreadCount one(1);
        const Refinement same = shapes.joined(shapes.ring).first;
        EXPECT_EQ(same.target_images, joined.target_images);
        EXPECT_EQ(same.pairs, joined.pairs);
    }
    const Positions hang_on = gather(joined.target_images, shapes.limb);
    const double torn = torn_ways(shapes.whole, shapes.limb, hang_on, BentLimb::kStep),
                 before = torn_ways(shapes.whole, shapes.limb, shapes.roots, BentLimb::kStep);
    EXPECT_GT(before, 0.1);
    EXPECT_LT(torn, 0.75 * before);
}

TEST(LostParts, LeaveAPartnerThatIsNotLostToWhateverHadOnlyThem) {
    BentLimb shapes(0.8);
    // A point of the square is paired with the limb's end alone.
    const Index first = shapes.ring[0], last = shapes.limb.back();
    std::erase_if(shapes.map.pairs, [&](const IndexPair& pair) { return pair.source == first; });
    shapes.map.pairs.push_back({first, last});
    std::ranges::sort(shapes.map.pairs);
    const auto [joined, lost] = shapes.joined(shapes.ring);
    ASSERT_GT(lost.of_target, 0);
    EXPECT_TRUE(std::ranges::binary_search(joined.pairs, IndexPair{first, first}));
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

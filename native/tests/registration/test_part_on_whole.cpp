#include "registration/part_on_whole.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <span>
#include <vector>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "registration/part_search.hpp"
#include "registration/watched_options.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// A body with a head on it that has a nose and two unlike ears, and arms; and the head alone,
/// larger, turned, and sampled otherwise. Points are the same where directions are.
struct Bust {
    static constexpr double kCut = 0.8, kLarger = 2.5;
    Positions whole, part, truth;  ///< the truth: where the part's points are on the whole
    Normals whole_normals, part_normals;
    std::vector<Index> ends;  ///< of the part
    Matrix3 turn = shapes::rotation(5);
    Vector3 shift{3.0, -2.0, 1.0};

    explicit Bust(Index count = 4000) {
        sample(shapes::sphere(count) * shapes::rotation(1).transpose(), whole, whole_normals);
        Positions all;
        Normals normals;
        sample(shapes::sphere(6 * count) * shapes::rotation(2).transpose(), all, normals);
        std::vector<Index> kept;
        for (Index i = 0; i < all.rows(); ++i)
            if (all(i, 2) > kCut) kept.push_back(i);
        truth = gather(all, kept);
        part = (kLarger * truth * turn.transpose()).rowwise() + shift.transpose();
        part_normals = gather(normals, kept) * turn.transpose();
        for (Index i = 0; i < truth.rows(); ++i)
            if (truth(i, 2) < kCut + 0.025) ends.push_back(i);
    }

    RefinementCloud of_part() const { return {part, part_normals, nullptr, ends}; }
    RefinementCloud of_whole() const { return {whole, whole_normals}; }
    /// Mean distance of images of the part from where they belong, in sizes of the head.
    double off(const Positions& images) const {
        const Positions centered = truth.rowwise() - truth.colwise().mean();
        return (images - truth).rowwise().norm().mean() /
               std::sqrt(centered.squaredNorm() / static_cast<double>(truth.rows()));
    }
    Feature mark(Index row, bool part_is_source) const {
        const Index there = shapes::nearest_row(whole, truth.row(row).transpose());
        return part_is_source ? point_feature("", row, there) : point_feature("", there, row);
    }

private:
    static Vector3 place(const Vector3& d) {
        struct Bump {
            Vector3 along, by;
            double width;
        };
        const Bump bumps[] = {
            {{0, 0, 1}, {0, 0, 0.75}, 0.05},       {{0.1, 0.35, 1}, {0, 0.35, 0.0}, 0.004},
            {{0.35, 0, 1}, {0.2, 0, 0.25}, 0.004}, {{-0.3, -0.1, 1}, {-0.3, -0.1, 0.0}, 0.004},
            {{1, 0, 0}, {0.9, 0.2, -0.2}, 0.02},   {{-1, 0.1, 0.2}, {-0.9, 0.1, 0.1}, 0.02},
            {{0.3, 0.1, -1}, {0.1, 0, -0.9}, 0.02}};
        Vector3 p = 0.5 * d.cwiseProduct(Vector3(1.0, 0.7, 1.2));
        for (const Bump& bump : bumps)
            p += std::exp((d.dot(bump.along.normalized()) - 1.0) / bump.width) * bump.by;
        return p;
    }
    static void sample(const Positions& directions, Positions& positions, Normals& normals) {
        positions.resize(directions.rows(), 3);
        normals.resize(directions.rows(), 3);
        for (Index i = 0; i < directions.rows(); ++i) {
            constexpr double kStep = 1e-4;
            const Vector3 d = directions.row(i).transpose(), a = d.unitOrthogonal(), b = d.cross(a);
            positions.row(i) = place(d).transpose();
            normals.row(i) = (place((d + kStep * a).normalized()) - place(d))
                                 .cross(place((d + kStep * b).normalized()) - place(d))
                                 .normalized()
                                 .transpose();
        }
    }
};

/// For Bust::off(): about a spacing of the body's points. Elsewhere it would be 1 or more.
constexpr double kNear = 0.15;

/// Points enough for a head that is a tenth of a body.
RefinementOptions quick_refinement() {
    RefinementOptions options = lighter_refinement();
    options.coarse = {2500, {120, 500}, {}};
    return options;
}

PartOrWhole mapped(const Bust& bust, bool part_is_source, std::span<const Feature> features = {},
                   const RefinementStart* start = nullptr) {
    Progress progress;
    const RefinementCloud part = bust.of_part(), whole = bust.of_whole();
    return part_is_source
               ? refine_part_or_whole(part, whole, features, quick_refinement(), progress, start)
               : refine_part_or_whole(whole, part, features, quick_refinement(), progress, start);
}

/// Every row of both is in a pair, and what of the whole isn't on the head goes to its end.
void expect_nothing_dragged(const Bust& bust, const Refinement& map, bool part_is_source) {
    std::vector<char> in_pair(to_size(to_index(bust.whole.rows())), 0),
        part_in_pair(to_size(to_index(bust.part.rows())), 0);
    for (const IndexPair& pair : map.pairs) {
        in_pair[to_size(part_is_source ? pair.target : pair.source)] = 1;
        part_in_pair[to_size(part_is_source ? pair.source : pair.target)] = 1;
    }
    EXPECT_EQ(std::ranges::count(in_pair, 0), 0);
    EXPECT_EQ(std::ranges::count(part_in_pair, 0), 0);
    EXPECT_TRUE(std::ranges::is_sorted(map.pairs));
    const Positions& back = part_is_source ? map.target_images : map.source_images;
    const Positions ends = gather(bust.part, std::span<const Index>(bust.ends));
    const KdTree<3> tree(ends);
    const auto nearest = nearest_rows(tree, back);
    for (Index i = 0; i < to_index(bust.whole.rows()); ++i)
        if (bust.whole(i, 2) < 0.5) {
            ASSERT_LT((back.row(i) - ends.row(nearest[to_size(i)])).norm(), 1e-9) << i;
        }
}

/// At about unit area, as find_part() wants it: both have some scale.
Positions at_unit_area(const Positions& positions) {
    return positions / std::sqrt(estimated_area(KdTree<3>(positions)));
}

/// Of positions at unit area.
CoarseShape coarse_of(const Positions& positions, const Normals& normals,
                      const std::vector<Index>& ends = {}) {
    Progress progress;
    CoarseShape shape =
        coarse_shape(KdTree<3>(positions), normals, {}, {3000, {250}, {}}, progress);
    shape.ends.assign(to_size(shape.size()), 0);
    for (Index i = 0; i < shape.size(); ++i)
        shape.ends[to_size(i)] =
            std::ranges::binary_search(ends, shape.cloud_rows[to_size(i)]) ? 1 : 0;
    return shape;
}

TEST(PartOnWhole, ItsPlaceAndSizeAreFound) {
    const Bust bust;
    Progress progress;
    const Positions part = at_unit_area(bust.part), whole = at_unit_area(bust.whole);
    const CoarseShape head = coarse_of(part, bust.part_normals, bust.ends);
    const CoarseShape body = coarse_of(whole, bust.whole_normals);
    const auto find = [&](int threads) {
        const ThreadCount limit(threads);
        return find_part(head, body, {}, {3}, progress);
    };
    const std::vector<PartPlace> places = find(1);
    ASSERT_FALSE(places.empty());
    const Similarity truth =
        fit_similarity(part, bust.truth * (whole.row(0).norm() / bust.whole.row(0).norm()));
    EXPECT_NEAR(places.front().pose.scale / truth.scale, 1.0, 0.1);
    EXPECT_LT((places.front().pose.rotation - truth.rotation).norm(), 0.2);
    EXPECT_LT((places.front().pose.apply(part) - truth.apply(part)).rowwise().norm().mean(),
              0.05 * truth.scale);
    for (std::size_t k = 1; k < places.size(); ++k)
        EXPECT_GE(places[k].misfit, places[k - 1].misfit);
    const std::vector<PartPlace> if_small = find_part(head, body, {}, {3, true}, progress);
    ASSERT_FALSE(if_small.empty());
    EXPECT_EQ(if_small.front().misfit, places.front().misfit);

    const std::vector<char> covered = covered_by_part(head, body, places.front().pose, 0.12);
    Index wrong = 0;
    const double neck = Bust::kCut * whole(0, 2) / bust.whole(0, 2);
    for (Index i = 0; i < body.size(); ++i) {
        const double above = (body.positions(i, 2) - neck) / truth.scale;
        if (above > 0.05 ? covered[to_size(i)] == 0 : above < -0.5 && covered[to_size(i)] != 0)
            ++wrong;
    }
    EXPECT_LT(wrong, body.size() / 100);

    const std::vector<PartPlace> again = find(4);
    ASSERT_EQ(again.size(), places.size());
    for (std::size_t k = 0; k < places.size(); ++k) {
        EXPECT_EQ(again[k].pose.rotation, places[k].pose.rotation);
        EXPECT_EQ(again[k].pose.scale, places[k].pose.scale);
        EXPECT_EQ(again[k].misfit, places[k].misfit);
    }
}

TEST(PartOnWhole, WhatIsAboutAsLargeAsTheWholeHasNoPlaceOnIt) {
    const Bust bust;
    Progress progress;
    std::vector<Index> kept, ends;
    for (Index i = 0; i < to_index(bust.whole.rows()); ++i)
        if (bust.whole(i, 2) > -0.45) {
            if (bust.whole(i, 2) < -0.4) ends.push_back(to_index(kept.size()));
            kept.push_back(i);
        }
    const Positions most = at_unit_area(gather(bust.whole, kept) * shapes::rotation(3));
    const Normals normals = gather(bust.whole_normals, kept) * shapes::rotation(3);
    const CoarseShape body = coarse_of(at_unit_area(bust.whole), bust.whole_normals);
    const CoarseShape part = coarse_of(most, normals, ends);
    EXPECT_TRUE(find_part(part, body, {}, {3}, progress).empty());
    EXPECT_TRUE(find_part(part, body, {}, {3, true}, progress).empty());
}

/// A middle row, 0, and rows in a row along each axis, as many as each arm has; all with an area of
/// 1.
CoarseShape star(const std::array<Index, 3>& arms) {
    std::vector<std::vector<Index>> neighbors(1);
    std::vector<Vector3> places(1, Vector3::Zero());
    for (std::size_t axis = 0; axis < arms.size(); ++axis)
        for (Index k = 0; k < arms[axis]; ++k) {
            const Index row = to_index(neighbors.size()), before = k == 0 ? 0 : row - 1;
            neighbors.push_back({before});
            neighbors[to_size(before)].push_back(row);
            places.push_back((k + 1.0) * Vector3::Unit(static_cast<Eigen::Index>(axis)));
        }
    CoarseShape shape;
    shape.positions.resize(to_index(places.size()), 3);
    for (std::size_t i = 0; i < places.size(); ++i) {
        shape.positions.row(to_index(i)) = places[i].transpose();
        shape.graph.neighbors.insert(shape.graph.neighbors.end(), neighbors[i].begin(),
                                     neighbors[i].end());
        shape.graph.offsets.push_back(static_cast<std::int64_t>(shape.graph.neighbors.size()));
    }
    shape.graph.lengths.assign(shape.graph.neighbors.size(), 1.0);
    shape.areas = Values::Ones(shape.positions.rows());
    return shape;
}

TEST(PartOnWhole, WhatHangsOnAPieceBelongsToIt) {
    using Rows = std::vector<std::size_t>;
    CoarseShape whole = star({2, 4, 10}), part;
    part.positions = Positions::Zero(1, 3);
    const auto covered_with = [&](const Rows& rows) {
        std::vector<char> covered(to_size(whole.size()), 0);
        for (const std::size_t row : rows) covered[row] = 1;
        cover_what_hangs_on(part, whole, {}, covered);
        Rows result;
        for (std::size_t i = 0; i < covered.size(); ++i)
            if (covered[i] != 0) result.push_back(i);
        return result;
    };
    EXPECT_EQ(covered_with({0}), (Rows{0, 1, 2}));                 // 4 are over a third of 10
    EXPECT_EQ(covered_with({0, 3}), (Rows{0, 1, 2, 3, 4, 5, 6}));  // 3 aren't
    EXPECT_EQ(covered_with({5}), (Rows{5, 6}));                    // the middle is the largest
    EXPECT_EQ(covered_with({}), Rows{});
    whole.areas.segment(3, 4).setConstant(0.5);  // areas count, not rows
    EXPECT_EQ(covered_with({0}), (Rows{0, 1, 2, 3, 4, 5, 6}));
    std::vector<char> all(to_size(whole.size()), 1);
    cover_what_hangs_on(part, whole, {}, all);
    EXPECT_EQ(std::ranges::count(all, 1), to_index(all.size()));
}

TEST(PartOnWhole, WhatThePartLacksDoesntHangOnIt) {
    const CoarseShape whole = star({2, 4, 20});
    CoarseShape part;  // half as large, and elsewhere; it ends where the first arm begins
    part.positions = 0.5 * whole.positions.topRows(2);
    part.positions.rowwise() += Eigen::RowVector3d(3.0, 0.0, 0.0);
    part.ends = {0, 1};
    const Similarity pose{2.0, Matrix3::Identity(), {-6.0, 0.0, 0.0}};
    std::vector<char> covered(to_size(whole.size()), 0);
    covered[0] = covered[1] = 1;
    cover_what_hangs_on(part, whole, pose, covered);
    EXPECT_EQ(covered[2], 0);
    EXPECT_EQ(std::ranges::count(covered, 1), 6);  // with the second arm
}

TEST(PartOnWhole, AHeadGoesToTheHeadOfABody) {
    SKIP_WHERE_WATCHED();
    const Bust bust;
    const PartOrWhole there = mapped(bust, true);
    ASSERT_TRUE(there.is_part);
    EXPECT_LT(bust.off(there.map.source_images), kNear);
    expect_nothing_dragged(bust, there.map, true);
    EXPECT_GT(there.map.diagnostics.confidence, 0.5);
    // The target is brought to the source.
    EXPECT_NEAR(there.map.alignment.scale, Bust::kLarger, 0.25);
    EXPECT_LT((there.map.alignment.apply(bust.truth) - bust.part).rowwise().norm().mean(),
              0.1 * Bust::kLarger);
}

TEST(PartOnWhole, StaysOneFromAnEarlierMap) {
    const Bust bust;
    const Positions ends = gather(bust.truth, std::span<const Index>(bust.ends));
    const KdTree<3> tree(bust.truth), tree_of_ends(ends);
    std::vector<Index> partners = nearest_rows(tree, bust.whole);
    const std::vector<Index> rim = nearest_rows(tree_of_ends, bust.whole);
    for (std::size_t i = 0; i < partners.size(); ++i)
        if (bust.whole(to_index(i), 2) < Bust::kCut) partners[i] = bust.ends[to_size(rim[i])];
    const RefinementStart start{bust.truth, gather(bust.part, std::span<const Index>(partners))};
    const std::vector<Feature> marks{bust.mark(to_index(bust.part.rows()) / 2, true)};
    const PartOrWhole later = mapped(bust, true, marks, &start);
    ASSERT_TRUE(later.is_part);
    EXPECT_LT(bust.off(later.map.source_images), kNear);
    expect_nothing_dragged(bust, later.map, true);
    EXPECT_EQ(later.map.source_images.row(marks[0].source.rows[0]),
              bust.whole.row(marks[0].target.rows[0]));
}

TEST(PartOnWhole, ABodyGoesToItsHead) {
    SKIP_WHERE_WATCHED();
    const Bust bust;
    const PartOrWhole back = mapped(bust, false);
    ASSERT_TRUE(back.is_part);
    EXPECT_LT(bust.off(back.map.target_images), kNear);
    expect_nothing_dragged(bust, back.map, false);
}

TEST(PartOnWhole, MarksSayHowSmallItIs) {
    const Bust bust;
    for (const std::size_t count : {1u, 3u, 9u}) {
        if (is_watched() && count != 3) continue;
        std::vector<Feature> marks;
        for (std::size_t k = 0; k < count; ++k)
            marks.push_back(bust.mark(to_index(k * 977 + 300) % to_index(bust.part.rows()), true));
        const PartOrWhole there = mapped(bust, true, marks);
        ASSERT_TRUE(there.is_part) << count;
        EXPECT_LT(bust.off(there.map.source_images), kNear) << count;
        expect_nothing_dragged(bust, there.map, true);
        for (const Feature& mark : marks) {
            EXPECT_EQ(there.map.source_images.row(mark.source.rows[0]),
                      bust.whole.row(mark.target.rows[0]));
            EXPECT_EQ(there.map.target_images.row(mark.target.rows[0]),
                      bust.part.row(mark.source.rows[0]));
        }
    }
}

TEST(PartOnWhole, WhatLacksLittleOrEndsNowhereIsMappedAsAWhole) {
    SKIP_WHERE_WATCHED();
    const Bust bust;
    Progress progress;
    std::vector<Index> kept, ends;
    for (Index i = 0; i < to_index(bust.whole.rows()); ++i)
        if (bust.whole(i, 0) < 0.9) {
            if (bust.whole(i, 0) > 0.86) ends.push_back(to_index(kept.size()));
            kept.push_back(i);
        }
    const Positions positions = gather(bust.whole, kept);
    const Normals normals = gather(bust.whole_normals, kept);
    for (const bool has_ends : {true, false}) {
        const RefinementCloud source{
            positions, normals, nullptr,
            has_ends ? std::span<const Index>(ends) : std::span<const Index>()};
        const PartOrWhole there = refine_part_or_whole(source, bust.of_whole(), {},
                                                       quick_refinement(), progress, nullptr);
        EXPECT_FALSE(there.is_part);
        const Refinement plain = refine(source, bust.of_whole(), {}, quick_refinement(), progress);
        EXPECT_EQ(there.map.source_images, plain.source_images);
        EXPECT_EQ(there.map.pairs, plain.pairs);
    }
}

TEST(PartOnWhole, WhatIsLikeNothingOfTheWholeIsMappedAsAWhole) {
    SKIP_WHERE_WATCHED();
    const Bust bust;
    constexpr double kTube = 0.25;
    const Positions torus = shapes::torus(3000, kTube);
    Normals normals = torus;
    for (Index i = 0; i < torus.rows(); ++i)
        normals.row(i).head<2>() -= torus.row(i).head<2>().normalized();
    normals /= kTube;
    Progress progress;
    EXPECT_FALSE(refine_part_or_whole(bust.of_part(), {torus, normals}, {}, quick_refinement(),
                                      progress, nullptr)
                     .is_part);
}

TEST(PartOnWhole, CanBeCanceled) {
    const Bust bust(1500);
    const ThreadCount one(1);  // which asks as often each time
    const auto asked = [&](int most) {
        int count = 0;
        Progress progress([&](std::string_view, double) { return ++count < most; },
                          std::chrono::milliseconds(0));
        refine_part_or_whole(bust.of_part(), bust.of_whole(), {}, lighter_refinement(), progress,
                             nullptr);
        return count;
    };
    const int all = asked(1 << 30);
    for (const double share : {0.5, 0.2, 0.8}) {
        EXPECT_THROW(asked(static_cast<int>(share * all)), Cancelled) << share;
        if (is_watched()) break;
    }
}

}  // namespace
}  // namespace pointmorph

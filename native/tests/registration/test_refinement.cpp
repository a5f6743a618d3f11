#include "pointmorph/registration/refinement.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "checks.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "registration/watched_options.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

struct Oriented {
    Positions positions;
    Normals normals;
};

/// A body with four legs: a rounded box whose surface is pulled out in four directions. `bend`
/// turns the first leg sideways. Directions are the sphere's, so that points of two of them belong
/// together when their directions are the same.
Vector3 place(const Vector3& direction, double bend) {
    Vector3 p = direction.cwiseProduct(Vector3(1.0, 0.6, 0.5));
    int leg = 0;
    for (const double x : {-1.0, 1.0})
        for (const double y : {-1.0, 1.0}) {
            const Vector3 axis = Vector3(0.7 * x, 0.55 * y, -0.6).normalized();
            const double near = std::exp((direction.dot(axis) - 1.0) / 0.03);
            const Vector3 straight(0.15 * x, 0.1 * y, -1.1);
            const Vector3 swung = straight + bend * Vector3(0.8, 0.0, 0.25);
            p += near * (leg++ == 0 ? swung : straight);
        }
    return p;
}

Oriented animal(const Positions& directions, double bend) {
    Oriented shape{Positions(directions.rows(), 3), Normals(directions.rows(), 3)};
    for (Index i = 0; i < directions.rows(); ++i) {
        const Vector3 d = directions.row(i).transpose();
        const Vector3 u = d.unitOrthogonal(), v = d.cross(u);
        constexpr double kStep = 1e-5;
        const auto along = [&](const Vector3& t) -> Vector3 {
            return place((d + kStep * t).normalized(), bend) -
                   place((d - kStep * t).normalized(), bend);
        };
        shape.positions.row(i) = place(d, bend);
        shape.normals.row(i) = along(u).cross(along(v)).normalized();
    }
    return shape;
}

Positions turned_sphere(Index count, unsigned seed) {
    return shapes::sphere(count) * shapes::rotation(seed).transpose();
}

std::vector<Feature> as_features(std::span<const IndexPair> pairs) {
    std::vector<Feature> features;
    for (const IndexPair& pair : pairs)
        features.push_back(
            point_feature(std::to_string(features.size()), pair.source, pair.target));
    return features;
}

/// Both models, and their feet, head, tail, back and belly as features.
struct Animals {
    Positions source_directions, target_directions;
    Oriented source, target;
    std::vector<IndexPair> features;

    Animals(Index source_points, Index target_points, double bend)
        : source_directions(turned_sphere(source_points, 1)),
          target_directions(turned_sphere(target_points, 2)),
          source(animal(source_directions, 0.0)),
          target(animal(target_directions, bend)) {
        std::vector<Vector3> marks{Vector3::UnitX(), -Vector3::UnitX(), Vector3::UnitZ(),
                                   -Vector3::UnitZ()};
        for (const double x : {-1.0, 1.0})
            for (const double y : {-1.0, 1.0})
                marks.push_back(Vector3(0.7 * x, 0.55 * y, -0.6).normalized());
        for (const Vector3& m : marks)
            features.push_back({shapes::nearest_row(source_directions, m),
                                shapes::nearest_row(target_directions, m)});
    }

    RefinementCloud source_cloud() const { return {source.positions, source.normals}; }
    RefinementCloud target_cloud() const { return {target.positions, target.normals}; }

    Refinement refined(Progress& progress) const {
        return refine(source_cloud(), target_cloud(), as_features(features),
                      lighter_where_watched(), progress);
    }

    /// Mean distance of the source's images from where their direction lies on the target, in
    /// the root of its area.
    double error(const Refinement& r, double bend) const {
        double sum = 0.0;
        for (Index i = 0; i < source_directions.rows(); ++i)
            sum += (r.source_images.row(i).transpose() -
                    place(source_directions.row(i).transpose(), bend))
                       .norm();
        return sum / static_cast<double>(source_directions.rows()) /
               std::sqrt(estimated_area(KdTree<3>(target.positions)));
    }
};

/// Every row of both in a pair; images finite.
void expect_complete(const Refinement& r, Index source_count, Index target_count) {
    EXPECT_TRUE(r.source_images.allFinite());
    EXPECT_TRUE(r.target_images.allFinite());
    EXPECT_EQ(r.source_images.rows(), source_count);
    EXPECT_EQ(r.target_images.rows(), target_count);
    EXPECT_TRUE(checks::is_total(r.pairs, source_count, target_count));
}

TEST(Refinement, FindsTheSameShapeSampledAnew) {
    SKIP_WHERE_WATCHED();
    const Animals animals(3000, 2500, 0.0);
    Progress progress;
    const Refinement r = animals.refined(progress);
    expect_complete(r, 3000, 2500);
    EXPECT_LT(animals.error(r, 0.0), 0.01);
}

TEST(Refinement, FollowsALegThatSwings) {
    SKIP_WHERE_WATCHED();
    const Animals animals(4000, 3000, 0.8);
    Progress progress;
    const Refinement r = animals.refined(progress);
    expect_complete(r, 4000, 3000);
    EXPECT_LT(animals.error(r, 0.8), 0.025);
    // Continuous: neighbors stay neighbors.
    const auto near = nearest_neighbors(KdTree<3>(animals.source.positions), 4, progress);
    std::vector<double> stretch;
    for (Index i = 0; i < near.size(); ++i)
        for (const Index j : near[i])
            stretch.push_back(
                (r.source_images.row(i) - r.source_images.row(j)).norm() /
                (animals.source.positions.row(i) - animals.source.positions.row(j)).norm());
    const auto high = stretch.begin() + static_cast<std::ptrdiff_t>(stretch.size() * 99 / 100);
    std::ranges::nth_element(stretch, high);
    EXPECT_LT(*high, 3.0);
}

TEST(Refinement, FeaturesMeetExactly) {
    const Animals animals(2000, 1500, 0.5);
    Progress progress;
    const Refinement r = animals.refined(progress);
    for (const IndexPair& f : animals.features) {
        EXPECT_EQ(r.source_images.row(f.source), animals.target.positions.row(f.target));
        EXPECT_EQ(r.target_images.row(f.target), animals.source.positions.row(f.source));
        for (const IndexPair& p : r.pairs) EXPECT_EQ(p.source == f.source, p.target == f.target);
    }
}

TEST(Refinement, BothMapsAreInverse) {
    SKIP_WHERE_WATCHED();
    const Animals animals(4000, 3000, 0.5);
    Progress progress;
    const Refinement r = animals.refined(progress);
    const KdTree<3> tree(animals.target.positions);
    double sum = 0.0;
    for (Index i = 0; i < 4000; ++i) {
        Index j;
        double squared;
        tree.nearest(r.source_images.row(i).data(), {&j, 1}, {&squared, 1});
        sum += (r.target_images.row(j) - animals.source.positions.row(i)).norm();
    }
    const double spacing = std::sqrt(estimated_area(KdTree<3>(animals.source.positions)) / 3000.0);
    EXPECT_LT(sum / 4000, spacing);
}

TEST(Refinement, TurnsScalesAndMovesWithTheClouds) {
    SKIP_WHERE_WATCHED();
    Animals animals(2000, 1500, 0.5);
    Progress progress;
    const Refinement before = animals.refined(progress);
    const Similarity a{300.0, shapes::rotation(5), Vector3(1e3, -2e3, 5e2)};
    const Similarity b{0.02, shapes::rotation(6), Vector3(-3, 1, 2)};
    animals.source = {a.apply(animals.source.positions), a.rotated(animals.source.normals)};
    animals.target = {b.apply(animals.target.positions), b.rotated(animals.target.normals)};
    const Refinement after = animals.refined(progress);
    const Positions back = b.inverse().apply(after.source_images);
    const double spacing =
        std::sqrt(estimated_area(KdTree<3>(animals.target.positions)) / 1500.0) / b.scale;
    EXPECT_LT((back - before.source_images).rowwise().norm().mean(), 0.2 * spacing);
}

TEST(Refinement, SameBitsForAnyThreadCount) {
    SKIP_WHERE_WATCHED();
    const Animals animals(1500, 1200, 0.5);
    Progress progress;
    const auto with = [&](int threads) {
        const ThreadCount scope(threads);
        return animals.refined(progress);
    };
    const Refinement one = with(1), three = with(3);
    EXPECT_EQ(one.source_images, three.source_images);
    EXPECT_EQ(one.target_images, three.target_images);
    EXPECT_EQ(one.pairs, three.pairs);
}

TEST(Refinement, StartsFromAnEarlierMap) {
    const Animals animals(2500, 2000, 0.5);
    Progress progress;
    const Refinement first = animals.refined(progress);
    const RefinementStart start{first.source_images, first.target_images};
    const auto again = [&](std::span<const IndexPair> features, Progress& watched) {
        return refine(animals.source_cloud(), animals.target_cloud(), as_features(features),
                      lighter_where_watched(), watched, &start);
    };
    Progress watched;
    const Refinement r = again(std::span(animals.features).first(1), watched);
    EXPECT_LT(animals.error(r, 0.5), 0.02);
    EXPECT_TRUE(std::ranges::none_of(watched.stages(),
                                     [](const StageTime& s) { return s.stage == "pose"; }));

    // A foot marked somewhere else than where the earlier map has it: met, and the rest stays.
    auto moved = animals.features;
    moved[5].target =
        shapes::nearest_row(animals.target_directions, Vector3(-0.7, 0.55, -0.3).normalized());
    const Refinement edited = again(moved, progress);
    EXPECT_EQ(edited.source_images.row(moved[5].source),
              animals.target.positions.row(moved[5].target));
    EXPECT_LT(animals.error(edited, 0.5), 0.04);
}

TEST(Refinement, FewMarksDontPullAnEarlierMapAway) {
    SKIP_WHERE_WATCHED();
    // They say nothing of a leg that has swung forward; the map that is started from knows.
    constexpr double kBend = 2.2;
    const Animals animals(1500, 1200, kBend);
    Progress progress;
    const Refinement first = animals.refined(progress);
    ASSERT_LT(animals.error(first, kBend), 0.03);
    const RefinementStart start{first.source_images, first.target_images};
    const std::vector<IndexPair> few{animals.features[3], animals.features[6], animals.features[7]};
    const Refinement again = refine(animals.source_cloud(), animals.target_cloud(),
                                    as_features(few), {}, progress, &start);
    EXPECT_LT(animals.error(again, kBend), 1.3 * animals.error(first, kBend));
}

TEST(Refinement, AnEarlierMapThatContradictsTheFeaturesIsNotUsed) {
    const Animals animals(1500, 1200, 0.0);
    Progress progress;
    const Refinement fresh = animals.refined(progress);
    RefinementStart exchanged{fresh.source_images, fresh.target_images};  // head for tail
    exchanged.source_images.leftCols(2) *= -1.0;
    exchanged.target_images.leftCols(2) *= -1.0;
    const Refinement r =
        refine(animals.source_cloud(), animals.target_cloud(), as_features(animals.features),
               lighter_where_watched(), progress, &exchanged);
    EXPECT_EQ(r.source_images, fresh.source_images);
    EXPECT_EQ(r.pairs, fresh.pairs);
}

TEST(Refinement, NormalsInsideOutAreNoticed) {
    SKIP_WHERE_WATCHED();
    Animals animals(1500, 1200, 0.3);
    Progress progress;
    EXPECT_FALSE(animals.refined(progress).inside_out);
    animals.target.normals *= -1.0;
    const Refinement r = animals.refined(progress);
    EXPECT_TRUE(r.inside_out);
    EXPECT_LT(animals.error(r, 0.3), 0.03);
}

TEST(Refinement, OpenPatchesGenusOneAndSeveralPartsGoThrough) {
    SKIP_WHERE_WATCHED();
    Progress progress;
    const auto run = [&](const Positions& s, const Normals& sn, const Positions& t,
                         const Normals& tn, std::vector<IndexPair> features) {
        expect_complete(refine({s, sn}, {t, tn}, as_features(features), {}, progress),
                        to_index(s.rows()), to_index(t.rows()));
    };
    const Positions half = shapes::sphere(600, 0.0), flat = shapes::grid(25);
    Normals up = Normals::Zero(flat.rows(), 3);
    up.col(2).setOnes();
    run(half, half, flat, up, {{0, 312}});
    const Positions ring = shapes::torus(900, 0.3);
    Normals out(900, 3);
    for (Index i = 0; i < 900; ++i) {
        const Vector3 p = ring.row(i).transpose();
        out.row(i) = (p - Vector3(p[0], p[1], 0).normalized()).normalized();
    }
    run(ring, out, ring, out, {{0, 0}, {1, 1}, {2, 2}, {3, 3}});
    Positions parts(700, 3);
    parts << shapes::sphere(500), 0.1 * shapes::sphere(200);
    Normals parts_out = parts.rowwise().normalized();
    parts.bottomRows(200).col(0).array() += 1.5;
    run(parts, parts_out, half, half, {});
}

TEST(Refinement, HopelessCloudsStillGiveFiniteMaps) {
    Progress progress;
    const Normals up = Vector3::UnitZ().transpose().replicate(40, 1);
    Positions line = Positions::Zero(40, 3), doubled(40, 3);
    line.col(0).setLinSpaced(40, 0.0, 1.0);
    doubled << shapes::cube_noise(4).replicate(10, 1);
    const Positions same = Positions::Constant(40, 3, 7.0), noise = shapes::cube_noise(40);
    const std::vector<IndexPair> features{{0, 0}, {1, 1}, {2, 2}};
    int combination = 0;
    for (const Positions& p : {line, doubled, same, noise})
        for (const Positions& q : {line, doubled, same, noise})
            for (const std::size_t count : {0u, 1u, 3u}) {
                // Each cloud on each side, and each count, in a fifth of the combinations.
                if (++combination % 5 != 0 && is_watched()) continue;
                expect_complete(refine({p, up}, {q, up},
                                       as_features(std::span(features).first(count)), {}, progress),
                                40, 40);
            }
    for (const Index few : {1, 2, 5}) {
        const Positions some = noise.topRows(few), some_up = up.topRows(few);
        expect_complete(refine({some, some_up}, {noise, up}, {}, {}, progress), few, 40);
    }
}

TEST(Refinement, EndsWhenAskedTo) {
    const Animals animals(3000, 3000, 0.3);
    for (const double share : {0.0, 0.3, 0.8}) {
        Progress progress(
            [&](std::string_view stage, double fraction) {
                return stage != "registration" || fraction < share;
            },
            std::chrono::milliseconds{0});
        EXPECT_THROW(animals.refined(progress), Cancelled);
    }
}

TEST(Example, Refinement) {
    SKIP_WHERE_WATCHED();
    const Animals animals(3000, 2500, 0.0);
    const auto& [source, source_normals] = animals.source;
    const auto& [target, target_normals] = animals.target;
    const std::vector<Feature> features = as_features(animals.features);
    Progress progress;
    // --- example
    const Refinement map =
        refine({source, source_normals}, {target, target_normals}, features, {}, progress);
    const Positions& images = map.source_images;
    const Pairing& pairs = map.pairs;
    // --- end of the example
    EXPECT_EQ(images.rows(), 3000);
    EXPECT_LT(animals.error(map, 0.0), 0.01);
    EXPECT_TRUE(checks::is_total(pairs, 3000, 2500));
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/registration/restarts.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "pointmorph/registration/misfit.hpp"
#include "pointmorph/registration/thin_plate.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

const std::vector<Vector3> kSpikes{Vector3::UnitX(), Vector3::UnitY(), -Vector3::UnitX(),
                                   Vector3(0.3, -1.0, 0.2).normalized()};

/// Spikes, the last of which is `tail` long; features are the ends of the first `marked` ones.
struct Spiky {
    shapes::Urchin cloud;
    Vector3 tail;
    CoarseShape coarse;

    Spiky(double length, unsigned seed, std::size_t marked = 3)
        : cloud(4000, spikes(length), seed), tail((0.5 + length) * kSpikes.back()) {
        std::vector<Index> required;
        for (std::size_t k = 0; k < marked; ++k) {
            Index best;
            (cloud.positions.rowwise() - 1.5 * kSpikes[k].transpose())
                .rowwise()
                .squaredNorm()
                .minCoeff(&best);
            required.push_back(best);
        }
        // Unit area, roughly: a ball of radius ½ has π.
        cloud.positions /= 2.2;
        tail /= 2.2;
        Progress progress;
        coarse = coarse_shape(KdTree<3>(cloud.positions), cloud.normals, required,
                              CoarseShapeOptions{2000, {150, 400}, {}}, progress);
    }

    static std::vector<Vector3> spikes(double length) {
        auto result = kSpikes;
        result.back() *= length;
        return result;
    }
};

std::vector<IndexPair> first_rows(Index count) {
    std::vector<IndexPair> pairs;
    for (Index k = 0; k < count; ++k) pairs.push_back({k, k});
    return pairs;
}

TEST(Restarts, ExtremitiesArePairedWhereTheyLieToTheFeaturesHoweverLong) {
    const Spiky source(1.2, 3), target(0.6, 4);
    const auto features = first_rows(3);
    Progress progress;
    const auto pairs =
        extremities_by_features({source.coarse, target.coarse, features}, {}, progress);
    ASSERT_EQ(pairs.size(), 1u);
    EXPECT_LT((source.coarse.positions.row(pairs[0].source).transpose() - source.tail).norm(),
              0.08);
    EXPECT_LT((target.coarse.positions.row(pairs[0].target).transpose() - target.tail).norm(),
              0.08);
    // Too few to say where one lies.
    EXPECT_TRUE(extremities_by_features(
                    {source.coarse, target.coarse, std::span(features).first(2)}, {}, progress)
                    .empty());
}

TEST(Restarts, ExtremitiesInDifferentPlacesAreNotPaired) {
    const Spiky source(1.0, 3);
    Spiky target(1.0, 4);
    // The same spikes, but the features go to others: the free one lies elsewhere to them.
    const std::vector<IndexPair> exchanged{{0, 0}, {1, 2}, {2, 1}};
    Progress progress;
    const auto pairs =
        extremities_by_features({source.coarse, target.coarse, exchanged}, {}, progress);
    EXPECT_TRUE(pairs.empty());
}

TEST(Restarts, AGoodResultIsNotTriedAgain) {
    const Spiky source(1.0, 3), target(1.0, 4);
    const auto features = first_rows(3);
    Progress progress;
    const RegistrationStart start{source.coarse.positions, target.coarse.positions};
    const CoarsePair shapes{source.coarse, target.coarse, features};
    const Registration first = register_shapes(shapes, start, {}, progress);
    const Restarts restarts = register_best(shapes, {"features", first}, {}, {}, progress);
    ASSERT_EQ(restarts.tried.size(), 1u);
    EXPECT_EQ(restarts.taken, 0u);
    EXPECT_EQ(restarts.tried[0].start, "features");
    EXPECT_EQ(restarts.registration.source_points.positions, first.source_points.positions);
    EXPECT_EQ(restarts.registration.target_points.positions, first.target_points.positions);
    EXPECT_LE(restarts.tried[0].torn, RegistrationOptions().most_torn);
}

TEST(Restarts, AStartThatCannotWorkIsReplaced) {
    const Spiky source(1.0, 3), target(0.7, 4);
    const auto features = first_rows(3);
    Progress progress;
    // Mirrored, and too stiff a schedule to come back from there.
    RegistrationStart start{source.coarse.positions, target.coarse.positions};
    start.source.col(1) *= -1.0;
    start.target.col(1) *= -1.0;
    const RegistrationOptions registration;
    const CoarsePair shapes{source.coarse, target.coarse, features};
    const Restarts restarts = register_best(
        shapes, {"earlier map", register_shapes(shapes, start, registration, progress, 1)}, {},
        registration, progress);
    ASSERT_GE(restarts.tried.size(), 2u);
    EXPECT_EQ(restarts.tried[0].start, "earlier map");
    EXPECT_GT(restarts.tried[0].torn, registration.most_torn);
    EXPECT_GT(restarts.taken, 0u);
    const auto score = [&](const Restart& a) {
        return a.energy * (1.0 + a.torn / registration.most_torn);
    };
    for (const Restart& a : restarts.tried)
        EXPECT_GE(score(a), score(restarts.tried[restarts.taken]));
    const double kept = torn_share(shapes, restarts.registration, registration, progress);
    EXPECT_EQ(kept, restarts.tried[restarts.taken].torn);
    EXPECT_LE(kept, registration.most_torn);
}

TEST(Example, Restarts) {
    SKIP_WHERE_WATCHED();
    const Spiky one(1.0, 3), other(1.0, 4);
    const CoarseShape &source = one.coarse, &target = other.coarse;
    const auto features = first_rows(3);
    Progress progress;
    // --- example
    const CoarsePair shapes{source, target, features};
    Registration first = register_shapes(shapes, thin_plate_start(shapes), {}, progress);
    const Restarts best = register_best(shapes, {"features", std::move(first)}, {}, {}, progress);
    const std::string& start = best.tried[best.taken].start;
    // --- end of the example
    EXPECT_EQ(start, "features");
    const KdTree<3> tree(target.positions);
    for (Index i = 0; i < source.size(); ++i) {
        Index nearest;
        double squared;
        tree.nearest(best.registration.source_points.positions.row(i).data(), {&nearest, 1},
                     {&squared, 1});
        EXPECT_LT(squared, 0.1 * 0.1);
    }
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/registration/restarts.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "shapes.hpp"

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

TEST(Attempts, TipsArePairedWhereTheyLieToTheFeaturesHoweverLong) {
    const Spiky source(1.2, 3), target(0.6, 4);
    const auto features = first_rows(3);
    Progress progress;
    const auto tips = tips_by_features(source.coarse, target.coarse, features, {}, progress);
    ASSERT_EQ(tips.size(), 1u);
    EXPECT_LT((source.coarse.positions.row(tips[0].source).transpose() - source.tail).norm(), 0.08);
    EXPECT_LT((target.coarse.positions.row(tips[0].target).transpose() - target.tail).norm(), 0.08);
    // Too few to say where a tip lies; and nothing left where every tip is marked.
    EXPECT_TRUE(
        tips_by_features(source.coarse, target.coarse, std::span(features).first(2), {}, progress)
            .empty());
}

TEST(Attempts, TipsInDifferentPlacesAreNotPaired) {
    const Spiky source(1.0, 3);
    Spiky target(1.0, 4);
    // The same spikes, but the features go to others: the free one lies elsewhere to them.
    const std::vector<IndexPair> exchanged{{0, 0}, {1, 2}, {2, 1}};
    Progress progress;
    const auto tips = tips_by_features(source.coarse, target.coarse, exchanged, {}, progress);
    EXPECT_TRUE(tips.empty());
}

TEST(Attempts, AGoodResultIsNotTriedAgain) {
    const Spiky source(1.0, 3), target(1.0, 4);
    const auto features = first_rows(3);
    Progress progress;
    const RegistrationStart start{source.coarse.positions, target.coarse.positions};
    const Registration first =
        register_shapes(source.coarse, target.coarse, features, start, {}, progress);
    const Attempts attempts =
        register_best(source.coarse, target.coarse, features, "features", first, {}, {}, progress);
    ASSERT_EQ(attempts.tried.size(), 1u);
    EXPECT_EQ(attempts.taken, 0u);
    EXPECT_EQ(attempts.tried[0].start, "features");
    EXPECT_EQ(attempts.registration.source_points.positions, first.source_points.positions);
    EXPECT_EQ(attempts.registration.target_points.positions, first.target_points.positions);
    EXPECT_LE(attempts.tried[0].torn, RegistrationOptions().most_torn);
}

TEST(Attempts, AStartThatCannotWorkIsReplaced) {
    const Spiky source(1.0, 3), target(0.7, 4);
    const auto features = first_rows(3);
    Progress progress;
    // Mirrored, and too stiff a schedule to come back from there.
    RegistrationStart start{source.coarse.positions, target.coarse.positions};
    start.source.col(1) *= -1.0;
    start.target.col(1) *= -1.0;
    const RegistrationOptions registration;
    const AttemptOptions options;
    const Attempts attempts = register_best(
        source.coarse, target.coarse, features, "earlier map",
        register_shapes(source.coarse, target.coarse, features, start, registration, progress, 1),
        options, registration, progress);
    ASSERT_GE(attempts.tried.size(), 2u);
    EXPECT_EQ(attempts.tried[0].start, "earlier map");
    EXPECT_GT(attempts.tried[0].torn, registration.most_torn);
    EXPECT_GT(attempts.taken, 0u);
    const auto score = [&](const Attempt& a) {
        return a.energy * (1.0 + a.torn / registration.most_torn);
    };
    for (const Attempt& a : attempts.tried)
        EXPECT_GE(score(a), score(attempts.tried[attempts.taken]));
    const double kept =
        torn_share(source.coarse, target.coarse, attempts.registration, registration, progress);
    EXPECT_EQ(kept, attempts.tried[attempts.taken].torn);
    EXPECT_LE(kept, registration.most_torn);
}

TEST(Attempts, TornIsTheShareOfEdgesWhoseEndsPart) {
    const Spiky source(1.0, 3);
    const Spiky& same = source;
    Progress progress;
    Registration identity;
    identity.source_points = {source.coarse.positions, source.coarse.normals, {}};
    identity.target_points = identity.source_points;
    EXPECT_EQ(torn_share(source.coarse, same.coarse, identity, {}, progress), 0.0);
    // A coarse shape halved by a plane, one half carried to the opposite end.
    Registration cut = identity;
    std::vector<char> moved(to_size(source.coarse.size()), 0);
    for (Index i = 0; i < source.coarse.size(); ++i)
        if (source.coarse.positions(i, 2) > 0.0) {
            moved[to_size(i)] = 1;
            cut.source_points.positions.row(i) *= -1.0;
            cut.source_points.normals.row(i) *= -1.0;
        }
    std::size_t across = 0;
    const SurfaceGraph& graph = source.coarse.graph;
    for (Index i = 0; i < graph.size(); ++i)
        for (auto e = graph.offsets[to_size(i)]; e < graph.offsets[to_size(i) + 1]; ++e)
            across += moved[to_size(i)] != moved[to_size(graph.neighbors[to_size(e)])];
    const double torn = torn_share(source.coarse, same.coarse, cut, {}, progress);
    const double expected = static_cast<double>(across) / static_cast<double>(graph.lengths.size());
    EXPECT_GT(torn, 0.3 * expected);
}

}  // namespace
}  // namespace pointmorph

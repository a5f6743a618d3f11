#include "pointmorph/registration/proposals.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

const std::vector<Vector3>& spikes() {
    static const std::vector<Vector3> directions{Vector3::UnitX(), -Vector3::UnitX(),
                                                 Vector3::UnitY(), Vector3::UnitZ()};
    return directions;
}

/// The end of a spike of urchin().
Vector3 end_of(std::size_t spike) {
    constexpr double kLengths[] = {1.0, 0.6, 0.8, 0.7};
    return (0.6 + kLengths[spike]) * spikes()[spike];
}

/// A ball with four spikes of different lengths, of about unit area; turned.
CoarseShape urchin(unsigned seed, const Matrix3& turn) {
    Positions p = shapes::sphere(30000) * shapes::rotation(seed).transpose();
    Normals normals = p;
    for (Index i = 0; i < p.rows(); ++i) {
        double length = 0.6;
        for (std::size_t k = 0; k < spikes().size(); ++k)
            length +=
                (end_of(k).norm() - 0.6) * std::exp((normals.row(i).dot(spikes()[k]) - 1.0) / 0.05);
        p.row(i) *= length;
    }
    p = p * turn.transpose() / 2.9;
    normals *= turn.transpose();
    Progress progress;
    CoarseShapeOptions options;
    options.points = 2000;
    return coarse_shape(KdTree<3>(p), normals, {}, options, progress);
}

TEST(Proposals, AreTheSameSpikesOfBothUrchins) {
    SKIP_WHERE_WATCHED();
    const Matrix3 turn = shapes::rotation(5);
    const CoarseShape source = urchin(1, Matrix3::Identity()), target = urchin(2, turn);
    Progress progress;
    const Pose pose = find_pose({source, target}, {}, {}, progress);
    const CoarseShape there = moved(target, pose.best.alignment);
    const auto proposals = propose_features({{source, there},
                                             pose.best.registration,
                                             pose.source_extremities,
                                             pose.target_extremities,
                                             pose.confidence},
                                            3, progress);
    std::set<std::size_t> matched;
    for (const Proposal& proposal : proposals) {
        EXPECT_GT(proposal.confidence, 0.0);
        EXPECT_LE(proposal.confidence, pose.confidence);
        // What belongs together is at the same place, up to the turn.
        const Vector3 here = source.positions.row(proposal.source);
        const Vector3 other = turn.transpose() * target.positions.row(proposal.target).transpose();
        EXPECT_LT((here - other).norm(), 0.12);
        for (std::size_t k = 0; k < spikes().size(); ++k)
            if (proposal.is_extremity && (here - end_of(k) / 2.9).norm() < 0.06) matched.insert(k);
    }
    EXPECT_EQ(matched.size(), spikes().size());
    EXPECT_TRUE(std::ranges::any_of(proposals, [](const Proposal& p) { return !p.is_extremity; }));
}

TEST(Proposals, LeaveFeaturesAloneAndNoRowTwice) {
    const CoarseShape shape = urchin(1, Matrix3::Identity());
    const auto tips = extremities(shape, node_distances(shape), {});
    ASSERT_FALSE(tips.empty());
    Progress progress;
    const Registration same =
        register_shapes({shape, shape}, {shape.positions, shape.positions}, {}, progress);
    const std::vector<IndexPair> features{{tips[0].point, tips[0].point}};
    const auto proposals =
        propose_features({{shape, shape, features}, same, tips, tips, 1.0}, 5, progress);
    EXPECT_GE(proposals.size(), tips.size() - 1);
    std::set<Index> sources{features[0].source}, targets{features[0].target};
    for (const Proposal& proposal : proposals) {
        EXPECT_TRUE(sources.insert(proposal.source).second);
        EXPECT_TRUE(targets.insert(proposal.target).second);
    }
}

TEST(Proposals, ConfidenceFollowsTheMapsAndFallsWithTheDistance) {
    double last = 1.0;
    for (const double distance : {0.0, 0.02, 0.05, 0.2}) {
        const double confidence = proposal_confidence(0.8, distance);
        EXPECT_LT(confidence, std::min(last, 0.8));
        EXPECT_LT(proposal_confidence(0.4, distance), confidence);
        last = confidence;
    }
}

TEST(Example, Proposals) {
    SKIP_WHERE_WATCHED();
    const Matrix3 turn = shapes::rotation(5);
    const CoarseShape source = urchin(1, Matrix3::Identity()), target = urchin(2, turn);
    Progress progress;
    // --- example
    const Pose pose = find_pose({source, target}, {}, {}, progress);
    const std::vector<Rival> rivals = describe_rivals(source, target, pose);
    const CoarseShape there = moved(target, pose.best.alignment);
    const std::vector<Proposal> proposals = propose_features({{source, there},
                                                              pose.best.registration,
                                                              pose.source_extremities,
                                                              pose.target_extremities,
                                                              pose.confidence},
                                                             4, progress);
    // --- end of the example
    EXPECT_LE(rivals.size(), pose.rivals.size());
    ASSERT_FALSE(proposals.empty());
    const Proposal& first = proposals.front();
    EXPECT_TRUE(first.is_extremity);
    EXPECT_LT(
        (source.positions.row(first.source) - target.positions.row(first.target) * turn).norm(),
        0.12);
}

}  // namespace
}  // namespace pointmorph

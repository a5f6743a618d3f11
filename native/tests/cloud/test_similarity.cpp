#include "pointmorph/cloud/similarity.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/SVD>

#include <vector>

#include "pointmorph/base/parallel.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

TEST(Similarity, BestRotationBeatsAllOthers) {
    for (unsigned seed = 1; seed < 6; ++seed) {
        const Matrix3 c = shapes::cube_noise(3, seed);  // reflections among them
        const auto best = best_rotation(c);
        EXPECT_NEAR(best.rotation.determinant(), 1.0, 1e-12);
        EXPECT_NEAR((best.rotation.transpose() * c).trace(), best.trace, 1e-12);
        for (unsigned other = 1; other < 200; ++other)
            EXPECT_LE((shapes::rotation(other).transpose() * c).trace(), best.trace + 1e-12);
    }
}

/// Clear covariances; then flat ones, lines, reflected ones, and all but reflected to the same
/// turn.
std::vector<Matrix3> covariances() {
    const Matrix3 u = shapes::rotation(1), v = shapes::rotation(2);
    std::vector<Matrix3> result;
    for (const Vector3& s : {Vector3(3, 2, 1), Vector3(1, 1, 1), Vector3(2, 1, 0), Vector3(1, 0, 0),
                             Vector3(1, 1e-9, 0), Vector3(3, 2, -1), Vector3(2, 1, -1),
                             Vector3(2, 1, -1 + 1e-7), Vector3(1, 1, -1), Vector3(2, 1, -0.999)})
        for (const double size : {1e-140, 1e-9, 1.0, 1e100})
            result.push_back(size * u * s.asDiagonal() * v);
    for (unsigned seed = 1; seed < 20; ++seed) result.push_back(shapes::cube_noise(3, seed));
    return result;
}

TEST(Similarity, BestRotationAgreesWithSingularValues) {
    const auto check = [](const Matrix3& c, const BestRotation& best) {
        const Eigen::JacobiSVD<Matrix3> svd(c, Eigen::ComputeFullU | Eigen::ComputeFullV);
        const double sign = (svd.matrixU() * svd.matrixV().transpose()).determinant();
        const Vector3 s = svd.singularValues();
        const double trace = s[0] + s[1] + sign * s[2];
        EXPECT_NEAR(best.trace, trace, 1e-12 * s[0]);
        EXPECT_NEAR((best.rotation.transpose() * c).trace(), trace, 1e-12 * s[0]);
        EXPECT_LT((best.rotation * best.rotation.transpose() - Matrix3::Identity()).norm(), 1e-12);
    };
    const std::vector<Matrix3> all = covariances();
    for (const Matrix3& c : all) check(c, best_rotation(c));
    std::vector<BestRotation> best(all.size());
    best_rotations(all, best);
    for (std::size_t k = 0; k < all.size(); ++k) check(all[k], best[k]);
}

TEST(Similarity, BestRotationOfNothingIsARotation) {
    const std::vector<Matrix3> none(3, Matrix3::Zero());
    std::vector<BestRotation> best(3);
    best_rotations(none, best);
    for (const BestRotation& its : best) EXPECT_NEAR(its.rotation.determinant(), 1.0, 1e-12);
    EXPECT_NEAR(best_rotation(none.front()).rotation.determinant(), 1.0, 1e-12);
}

TEST(Similarity, BestRotationsDontDependOnWhatIsBesideThem) {
    const std::vector<Matrix3> all = covariances();
    std::vector<BestRotation> together(all.size()), alone(1);
    best_rotations(all, together);
    for (std::size_t k = 0; k < all.size(); ++k) {
        best_rotations({&all[k], 1}, alone);
        EXPECT_EQ(alone.front().rotation, together[k].rotation);
        EXPECT_EQ(alone.front().trace, together[k].trace);
    }
}

TEST(Similarity, RecoversAKnownOne) {
    const Positions p = shapes::cube_noise(20);
    const Similarity known{2.5, shapes::rotation(3), Vector3(1, -2, 3)};
    const Similarity found = fit_similarity(p, known.apply(p));
    EXPECT_NEAR(found.scale, known.scale, 1e-12);
    EXPECT_LT((found.rotation - known.rotation).norm(), 1e-10);
    EXPECT_LT((found.translation - known.translation).norm(), 1e-10);
    EXPECT_LT((known.inverse().apply(known.apply(p)) - p).norm(), 1e-12);
}

TEST(Similarity, ARigidMotionKeepsTheSizeAndTheMiddle) {
    Positions from(5, 3);
    from << 1, 2, 3, -1, 0.5, 2, 0, 0, 1, 2, -1, 0.3, 0.2, 0.7, -2;
    const Similarity known{3.0, Eigen::AngleAxisd(0.8, Vector3(1, 2, -1).normalized()).matrix(),
                           Vector3(4, -5, 6)};
    const Positions to = known.apply(from);
    const Similarity found = fit_rigid_motion(from, to);
    EXPECT_EQ(found.scale, 1.0);
    EXPECT_LT((found.rotation - known.rotation).norm(), 1e-10);
    EXPECT_LT((found.apply(from).colwise().mean() - to.colwise().mean()).norm(), 1e-10);
    EXPECT_EQ(fit_rigid_motion(Positions(0, 3), Positions(0, 3)).translation, Vector3::Zero());
}

TEST(Similarity, NeverReflects) {
    const Positions p = shapes::cube_noise(20);
    Positions mirrored = p;
    mirrored.col(0) *= -1.0;
    EXPECT_NEAR(fit_similarity(p, mirrored).rotation.determinant(), 1.0, 1e-12);
}

TEST(Similarity, TakesTheLeastTurnWhereThatIsOpen) {
    Positions from(2, 3), to(2, 3);
    from << 0, 0, 0, 1, 0, 0;
    to << 0, 0, 0, 0, 2, 0;
    const Similarity s = fit_similarity(from, to);
    EXPECT_LT((s.apply(from) - to).norm(), 1e-6);
    EXPECT_LT((s.rotation * Vector3::UnitZ() - Vector3::UnitZ()).norm(), 1e-6);
}

TEST(Similarity, DegenerateInputGivesAShift) {
    const Positions one = Positions::Constant(1, 3, 2.0), none(0, 3);
    const Similarity shift = fit_similarity(one, Positions::Zero(1, 3));
    EXPECT_EQ(shift.scale, 1.0);
    EXPECT_TRUE(shift.rotation.isIdentity());
    EXPECT_LT(shift.apply(one).norm(), 1e-12);
    EXPECT_EQ(fit_similarity(none, none).scale, 1.0);
    const Positions same = Positions::Constant(5, 3, 1.0);
    EXPECT_EQ(fit_similarity(same, shapes::cube_noise(5)).scale, 1.0);
}

TEST(Similarity, JointSpreadIsThatOfBothEndsFarFromTheOrigin) {
    const Positions from = shapes::cube_noise(50, 3).rowwise() + Eigen::RowVector3d(1e4, 0, -2e4);
    const Positions to = Similarity{2.0, shapes::rotation(4), Vector3(0, 3e4, 0)}.apply(from) +
                         0.1 * shapes::cube_noise(50, 5);
    std::vector<IndexPair> pairs;
    Positions x(150, 3), y(150, 3);
    for (Index k = 0; k < 150; ++k) {  // rows in several pairs
        pairs.push_back({k % 50, (7 * k) % 40});
        x.row(k) = from.row(pairs.back().source);
        y.row(k) = to.row(pairs.back().target);
    }
    const JointSpread spread = joint_spread(from, to, pairs);
    const auto size = [](const Positions& p) { return (p.rowwise() - p.colwise().mean()).norm(); };
    EXPECT_NEAR(spread.from_size(), size(x), 1e-6);
    EXPECT_NEAR(spread.to_size(), size(y), 1e-6);
    EXPECT_NEAR(spread.half_way(), size(0.5 * (x + y)), 1e-6);
    EXPECT_LT((spread.rotation() - fit_similarity(x, y).rotation).norm(), 1e-6);
    const std::vector<IndexPair> one{{3, 4}};
    EXPECT_EQ(joint_spread(from, to, one).half_way(), 0.0);
    EXPECT_EQ(joint_spread(from, to, one).rotation(), Matrix3::Identity());

    // More than are added up at once: each 400 times.
    std::vector<IndexPair> many;
    for (int k = 0; k < 400; ++k) many.insert(many.end(), pairs.begin(), pairs.end());
    std::vector<JointSpread> by_threads;
    for (const int count : {1, 3}) {
        const ThreadCount threads(count);
        by_threads.push_back(joint_spread(from, to, many));
    }
    EXPECT_NEAR(by_threads[0].half_way(), 20.0 * spread.half_way(), 1e-5);
    EXPECT_LT((by_threads[0].rotation() - spread.rotation()).norm(), 1e-6);
    EXPECT_EQ(by_threads[0].half_way(), by_threads[1].half_way());
    EXPECT_EQ(by_threads[0].covariance, by_threads[1].covariance);
}

TEST(Example, Similarity) {
    const Similarity away{2.0, shapes::rotation(3), Vector3(1, -2, 3)};
    const Positions source_features = shapes::cube_noise(6), source = shapes::sphere(20);
    const Positions target_features = away.apply(source_features), target = away.apply(source);
    const Normals target_normals = away.rotated(source);
    // --- example
    const Similarity move = fit_similarity(target_features, source_features);
    const Positions moved = move.apply(target);
    const Normals normals = move.rotated(target_normals);
    // --- end of the example
    EXPECT_LT((moved - source).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_LT((normals - source).cwiseAbs().maxCoeff(), 1e-10);
}

}  // namespace
}  // namespace pointmorph

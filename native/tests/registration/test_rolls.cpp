#include "registration/rolls.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <random>

#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/pose.hpp"
#include "pointmorph/registration/proposals.hpp"
#include "registration/coarse_of_cloud.hpp"
#include "registration/watched_options.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

constexpr double kLength = 2.4, kRadius = 0.066;  // of unit area

/// A worm along an arc of a circle of radius `bow`, and where its points lie about its axis.
struct Worm {
    Positions positions;
    Normals normals;
    Positions opposite;  ///< half round the worm
};

/// Of `legs` on the outer side, each up to twice as long as the worm is thick.
Worm worm(Index count, double bow, unsigned seed, int legs = 0) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    Worm made{Positions(count, 3), Normals(count, 3), Positions(count, 3)};
    for (Index i = 0; i < count; ++i) {
        const double along = uniform(random), round = 2.0 * EIGEN_PI * uniform(random);
        const double thin = std::pow(1.0 - std::pow(2.0 * along - 1.0, 8.0), 0.5);
        const double angle = along * kLength / bow;
        const Vector3 out(std::cos(angle), std::sin(angle), 0.0), up = Vector3::UnitZ();
        const Vector3 normal = std::cos(round) * out + std::sin(round) * up;
        Vector3 off = thin * kRadius * normal;
        if (legs > 0 && std::cos(round) > 0.7 && std::fmod(along * legs, 1.0) < 0.5)
            off += 4.0 * kRadius * uniform(random) * out;
        made.positions.row(i) = (bow * out + off).transpose();
        made.normals.row(i) = normal.transpose();
        made.opposite.row(i) = (bow * out - off).transpose();
    }
    return made;
}

CoarseShape coarse_worm(const Worm& its, const std::vector<Index>& required = {}) {
    return coarse_of_cloud(its.positions, its.normals, required);
}

std::optional<Rolls> half_rolls(const CoarseShape& shape) {
    return half_rolls(shape, node_distances(shape));
}

TEST(Rolls, TakeEachPointToTheOtherSideHoweverTheShapeIsBent) {
    for (const double bow : {0.5, 1.2, 50.0}) {
        const Worm bent = worm(3000, bow, 1);
        const CoarseShape shape = coarse_worm(bent);
        const auto rolls = half_rolls(shape);
        ASSERT_TRUE(rolls) << bow;
        EXPECT_NEAR(rolls->thickness, kRadius, 0.15 * kRadius);
        double off = 0.0;
        for (Index i = 0; i < shape.size(); ++i) {
            const Similarity& roll = rolls->turns[to_size(i)];
            const Vector3 there =
                roll.rotation * shape.positions.row(i).transpose() + roll.translation;
            EXPECT_NEAR(roll.rotation.determinant(), 1.0, 1e-9);
            off += (there.transpose() - bent.opposite.row(shape.cloud_rows[to_size(i)])).norm();
        }
        EXPECT_LT(off / shape.size(), 0.3 * kRadius) << bow;
    }
}

TEST(Rolls, AreNoneOfWhatIsThickOrClosesOrHasLimbs) {
    Positions ball = shapes::sphere(1500);
    EXPECT_FALSE(half_rolls(coarse_of_cloud(0.28 * ball, ball)));
    const Positions ring = shapes::torus(2000, 0.05);
    Normals outward = ring;
    for (auto normal : outward.rowwise()) {
        Eigen::RowVector3d middle(normal.x(), normal.y(), 0.0);
        normal = (normal - middle.normalized()).normalized();
    }
    EXPECT_FALSE(half_rolls(coarse_of_cloud(0.7 * ring, outward)));
    // A cross of two worms.
    const Worm one = worm(1500, 50.0, 1);
    Positions both(3000, 3);
    Normals normals(3000, 3);
    const Eigen::RowVector3d middle = one.positions.colwise().mean();
    both.topRows(1500) = one.positions.rowwise() - middle;
    normals.topRows(1500) = one.normals;
    Matrix3 quarter;
    quarter << 0, -1, 0, 1, 0, 0, 0, 0, 1;
    both.bottomRows(1500) = both.topRows(1500) * quarter.transpose();
    normals.bottomRows(1500) = one.normals * quarter.transpose();
    EXPECT_FALSE(half_rolls(coarse_of_cloud(both, normals)));
    // Two worms side by side, and too few points to tell.
    both.bottomRows(1500) = both.topRows(1500).rowwise() + Eigen::RowVector3d(0.0, 0.0, 1.0);
    normals.bottomRows(1500) = one.normals;
    EXPECT_FALSE(half_rolls(coarse_of_cloud(both, normals)));
    EXPECT_FALSE(half_rolls(coarse_worm(worm(12, 1.2, 1))));
}

/// Rows along the worm, as far as one from the other, on its outer side.
std::vector<Index> outer_rows(const Worm& its, double bow, int count) {
    std::vector<Index> rows;
    for (int k = 0; k < count; ++k) {
        const double angle = (k + 0.5) / count * kLength / bow;
        rows.push_back(shapes::nearest_row(
            its.positions, (bow + kRadius) * Vector3(std::cos(angle), std::sin(angle), 0.0)));
    }
    return rows;
}

double share_turned(const std::vector<Similarity>& turns) {
    const auto count = std::ranges::count_if(
        turns, [](const Similarity& turn) { return !turn.rotation.isIdentity(); });
    return static_cast<double>(count) / static_cast<double>(turns.size());
}

TEST(Rolls, AreToldByMarksNearThemAlone) {
    const double bow = 1.2;
    const Worm its = worm(3000, bow, 1);
    const std::vector<Index> marks = outer_rows(its, bow, 9);
    CoarseShape shape = coarse_worm(its, marks);
    const Rolls rolls = half_rolls(shape).value();
    const auto turned = [&](const std::vector<Index>& features) {
        return share_turned(untold_turns(rolls, shape, features));
    };
    EXPECT_EQ(turned({}), 1.0);
    const double one = turned({4}), reach = 10.0 * kRadius / kLength;
    EXPECT_NEAR(one, 1.0 - reach, 0.05);
    EXPECT_NEAR(turned({0, 8}), 1.0 - reach - 2.0 / 18.0, 0.1);
    EXPECT_EQ(turned({0, 1, 2, 3, 4, 5, 6, 7, 8}), 0.0);

    // A curve along the back tells all of it, one round the worm nothing; so do regions.
    const auto with_curve = [&](const std::vector<Index>& rows) {
        CoarseShape marked = shape;
        marked.guides = {gather(shape.positions, rows), rows, Values::Ones(to_index(rows.size()))};
        return share_turned(untold_turns(rolls, marked, {}));
    };
    std::vector<Index> along, round;
    CoarseShape back = shape, belt = shape;
    back.labels = belt.labels = Labels::Zero(shape.size(), 16);
    for (Index i = 0; i < shape.size(); ++i) {
        const Eigen::RowVector3d place = shape.positions.row(i);
        const bool is_outer = place.head(2).norm() > bow + 0.8 * kRadius,
                   is_middle = std::abs(rolls.lengths[i] - 1.2) < 0.1;
        if (is_outer) along.push_back(i);
        if (is_middle) round.push_back(i);
        back.labels(i, 0) = place.head(2).norm() > bow ? 1.0 : 0.0;
        belt.labels(i, 0) = is_middle ? 1.0 : 0.0;
    }
    EXPECT_LT(with_curve(along), 0.05);
    EXPECT_EQ(with_curve(round), 1.0);
    EXPECT_LT(share_turned(untold_turns(rolls, back, {})), 0.05);
    EXPECT_GT(share_turned(untold_turns(rolls, belt, {})), 0.5);
}

Pose worms_pose(const CoarseShape& source, const CoarseShape& target,
                const std::vector<IndexPair>& features = {}) {
    Progress progress;
    return find_pose({source, target, features}, lighter_where_watched().pose, {}, progress);
}

bool has_equal_rival(const Pose& pose) {
    return !pose.rivals.empty() && pose.rivals.front().cost == pose.best.cost;
}

TEST(Rolls, AreNotToldByHowWormsAreBent) {
    const Index count = is_watched() ? 900 : 3000;
    const CoarseShape source = coarse_worm(worm(count, 1.2, 1)),
                      target = coarse_worm(worm(count, 0.8, 2));
    const Pose pose = worms_pose(source, target);
    EXPECT_TRUE(has_equal_rival(pose));
    EXPECT_LT(pose.confidence, 0.65);
    const std::vector<Rival> rivals = describe_rivals(source, target, pose);
    EXPECT_EQ(rivals.front().swap, Swap::kRolled);
    EXPECT_EQ(name_of(rivals.front().swap), "rolled");
    // The rival is the map rolled: it takes each point to the other side of the axis.
    const Positions images = images_at_rest(pose.best),
                    rolled = images_at_rest(pose.rivals.front());
    EXPECT_NEAR((images - rolled).rowwise().norm().mean(), 2.0 * kRadius, 0.7 * kRadius);
}

TEST(Rolls, AreToldByLegsAndByMarksAlongTheBack) {
    SKIP_WHERE_WATCHED();
    const Index count = 3000;
    EXPECT_FALSE(has_equal_rival(
        worms_pose(coarse_worm(worm(count, 1.2, 1, 12)), coarse_worm(worm(count, 0.8, 2, 12)))));
    const Worm source = worm(count, 1.2, 1), target = worm(count, 0.8, 2);
    const CoarseShape marked_source = coarse_worm(source, outer_rows(source, 1.2, 5)),
                      marked_target = coarse_worm(target, outer_rows(target, 0.8, 5));
    const std::vector<IndexPair> features{{0, 0}, {1, 1}, {2, 2}, {3, 3}, {4, 4}};
    EXPECT_FALSE(has_equal_rival(worms_pose(marked_source, marked_target, features)));
    // A mark at one end leaves the other one open.
    const Pose one_end = worms_pose(marked_source, marked_target, {{0, 0}});
    EXPECT_LT(one_end.confidence, 0.85);
}

}  // namespace
}  // namespace pointmorph

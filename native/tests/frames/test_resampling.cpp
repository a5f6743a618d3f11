#include "pointmorph/frames/resampling.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "shaken_shapes.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// A morph whose pairs and paths are known: straight ones between two clouds.
struct Given {
    Cloud source, target;
    std::vector<IndexPair> pairs;

    OrientedPoints at(double t) const {
        const auto rows = static_cast<Eigen::Index>(pairs.size());
        OrientedPoints cloud{Positions(rows, 3), Normals(rows, 3)};
        for (Eigen::Index i = 0; i < rows; ++i) {
            const auto [s, d] = pairs[to_size(i)];
            cloud.positions.row(i) =
                (1 - t) * source.positions.row(s) + t * target.positions.row(d);
            cloud.normals.row(i) =
                ((1 - t) * source.normals.row(s) + t * target.normals.row(d)).normalized();
        }
        return cloud;
    }

    Resampling resampled(const ResamplingOptions& options = {}) const {
        Progress progress;
        return {source, target, pairs, [this](double t) { return at(t); }, options, progress};
    }
};

/// Each point with its image.
Given same_points(const Positions& from, const Normals& from_normals, const Positions& to,
                  const Normals& to_normals) {
    Given given;
    given.source.positions = from;
    given.source.normals = from_normals;
    given.target.positions = to;
    given.target.normals = to_normals;
    for (Index i = 0; i < from.rows(); ++i) given.pairs.push_back({i, i});
    return given;
}

/// A plane whose right half moves away: half of the crack is open at t = ½. The source is whole.
Given torn_plane(Index side = 40, double gap = 0.6) {
    const Positions plane = shapes::shaken_grid(side, 0.2);
    Positions torn = plane;
    for (Index i = 0; i < torn.rows(); ++i)
        if (torn(i, 0) > 0) torn(i, 0) += gap;
    return same_points(plane, shapes::up(plane.rows()), torn, shapes::up(plane.rows()));
}

Positions with_pairs(const OrientedPoints& frame, const Resampling::Alive& alive) {
    Positions all(frame.positions.rows() + alive.positions.rows(), 3);
    all << frame.positions, alive.positions;
    return all;
}

double distance_to(const KdTree<3>& tree, const Vector3& place) {
    Index row = 0;
    double squared = 0.0;
    tree.nearest(place.data(), {&row, 1}, {&squared, 1});
    return std::sqrt(squared);
}

/// Star-shaped: limbs pulled out of a sphere, which turns into an ellipsoid.
struct Limbs {
    static double radius(const Vector3& direction, double t) {
        const Vector3 d = direction.normalized();
        double r = 1.0 / std::sqrt(1.0 + t * (0.6 * d.x() * d.x() - 0.3 * d.z() * d.z()));
        for (const Vector3& tip : {Vector3(0, 0, 1), Vector3(0.8, 0.6, 0), Vector3(-0.6, 0, -0.8)})
            r += t * 0.9 * std::exp(-8.0 * (d - tip).squaredNorm());
        return r;
    }
    /// Of the surface at t that straight paths along the rays give.
    static double blended(const Vector3& direction, double t) {
        return 1.0 - t + t * radius(direction, 1.0);
    }
    static Vector3 normal(const Vector3& place, double t) {
        // Gradient of |p| − r(p / |p|).
        Vector3 gradient;
        constexpr double kStep = 1e-6;
        for (int d = 0; d < 3; ++d) {
            Vector3 a = place, b = place;
            a[d] += kStep;
            b[d] -= kStep;
            gradient[d] = (a.norm() - blended(a, t)) - (b.norm() - blended(b, t));
        }
        return gradient.normalized();
    }
};

Given limbs(Index count) {
    const Positions sphere = shapes::sphere(count);
    Positions pulled(count, 3);
    Normals normals(count, 3);
    for (Index i = 0; i < count; ++i) {
        const Vector3 d = sphere.row(i).transpose();
        pulled.row(i) = Limbs::blended(d, 1.0) * d;
        normals.row(i) = Limbs::normal(pulled.row(i).transpose(), 1.0);
    }
    return same_points(sphere, sphere, pulled, normals);
}

/// Puts points everywhere: as many as can be judged.
ResamplingOptions everywhere() {
    ResamplingOptions options;
    options.omega = 2.0;
    options.spacing = 0.6;
    return options;
}

TEST(Resampling, NewPointsLieOnTheTrueSurface) {
    SKIP_WHERE_WATCHED();
    const Given given = limbs(16000);
    const Resampling resampling = given.resampled(everywhere());
    ASSERT_GT(resampling.points().size(), 6000U);
    Progress progress;
    for (const double t : {0.3, 0.8}) {
        const Resampling::Alive alive = resampling.at(t, given.at(t), progress);
        double off = 0.0, turned = 0.0;
        for (std::size_t i = 0; i < alive.ids.size(); ++i) {
            const auto row = static_cast<Eigen::Index>(i);
            const InsertedPoint& point = resampling.points()[to_size(alive.ids[i])];
            const Vector3 place = alive.positions.row(row).transpose();
            const Vector3 normal = Limbs::normal(place, t);
            // Radially, then along the normal.
            const double distance = (place.norm() - Limbs::blended(place, t)) *
                                    std::abs(normal.dot(place.normalized()));
            off = std::max(off, std::abs(distance) / resampling.spacing(point.pairs[0], t));
            turned = std::max(turned, (alive.normals.row(row).transpose() - normal).norm());
        }
        EXPECT_LT(off, 0.01) << t;
        EXPECT_LT(turned, 0.0175) << t;  // a degree
    }
}

TEST(Resampling, DoesOnceWhatIsToBeDoneMeanwhile) {
    const Given given = limbs(2000);
    const Resampling resampling = given.resampled(everywhere());
    Progress progress;
    for (const double t : {0.0, 0.4}) {
        const OrientedPoints frame = given.at(t);
        const Resampling::Alive alone = resampling.at(t, frame, progress);
        EXPECT_EQ(alone.ids.empty(), t == 0.0);
        std::atomic<int> calls{0};
        const Resampling::Alive beside = resampling.at(t, frame, progress, [&] { ++calls; });
        EXPECT_EQ(calls, 1) << t;
        EXPECT_EQ(beside.ids, alone.ids);
        EXPECT_EQ(beside.positions, alone.positions);
        EXPECT_EQ(beside.normals, alone.normals);
        EXPECT_THROW(resampling.at(t, frame, progress, [] { throw std::runtime_error("no"); }),
                     std::runtime_error);
    }
}

TEST(Resampling, PlaneToBumpStaysOnTheSurface) {
    SKIP_WHERE_WATCHED();
    const Positions plane = shapes::shaken_grid(100, 0.2);
    Positions bump = plane;
    Normals normals(plane.rows(), 3);
    const auto height = [](double x, double y) { return 0.5 * std::exp(-4 * (x * x + y * y)); };
    for (Index i = 0; i < plane.rows(); ++i) {
        const double x = plane(i, 0), y = plane(i, 1), z = height(x, y);
        bump(i, 2) = z;
        normals.row(i) = Vector3(8 * x * z, 8 * y * z, 1).normalized();
    }
    const Given given = same_points(plane, shapes::up(plane.rows()), bump, normals);
    const Resampling resampling = given.resampled(everywhere());
    Progress progress;
    const double t = 0.5;
    const Resampling::Alive alive = resampling.at(t, given.at(t), progress);
    ASSERT_GT(alive.ids.size(), 5000U);
    for (Eigen::Index i = 0; i < alive.positions.rows(); ++i) {
        const double x = alive.positions(i, 0), y = alive.positions(i, 1), z = t * height(x, y);
        const Vector3 normal = Vector3(8 * x * z, 8 * y * z, 1).normalized();
        EXPECT_LT(std::abs(alive.positions(i, 2) - z) * normal.z(), 0.01 * 0.02);
        EXPECT_LT((alive.normals.row(i).transpose() - normal).norm(), 0.0175);
        EXPECT_LE(alive.positions.row(i).head<2>().cwiseAbs().maxCoeff(), 1.005);  // the extent
    }
}

TEST(Resampling, NothingIsAddedWhereDensitySuffices) {
    const Positions random = shapes::torus(4000, 0.4);  // with all the gaps of random points
    const Normals outward = random.rowwise().normalized();
    const Positions even = shapes::sphere(3000);
    Positions grown = 7.0 * even;  // a larger shape isn't a sparser one
    for (const Given& given :
         {same_points(random, outward, random, outward), same_points(even, even, grown, even),
          same_points(grown, even, even, even)})
        EXPECT_EQ(given.resampled().points().size(), 0U);
}

TEST(Resampling, CracksAreFilledAndNothingElse) {
    const Given given = torn_plane();
    const Resampling resampling = given.resampled();
    Progress progress;
    const double spacing = 2.0 / 39;
    for (const double t : {0.2, 0.5, 0.77, 0.95}) {
        const OrientedPoints frame = given.at(t);
        const Resampling::Alive alive = resampling.at(t, frame, progress);
        const Positions all = with_pairs(frame, alive);
        const KdTree<3> tree(all), pairs(frame.positions);
        for (double x = 0; x < 0.6 * t; x += 0.01)
            for (double y = -0.95; y < 0.95; y += 0.03)
                EXPECT_LT(distance_to(tree, {x, y, 0}), 1.35 * spacing)
                    << t << " " << x << " " << y;
        // As many as the crack's area takes, all of them in it.
        const double area = 2.0 * 0.6 * t / (spacing * spacing);
        EXPECT_LT(static_cast<double>(alive.ids.size()), 2.0 * area + 40) << t;
        for (Eigen::Index i = 0; i < alive.positions.rows(); ++i) {
            EXPECT_GT(alive.positions(i, 0), -2 * spacing);
            EXPECT_LT(alive.positions(i, 0), 0.6 * t + 2 * spacing);
            EXPECT_LE(std::abs(alive.positions(i, 1)), 1.02);
            EXPECT_NEAR(alive.positions(i, 2), 0.0, 1e-6);
        }
    }
}

/// A plane whose halves are apart on the source, moved and turned by `place` and `normal` there.
Given parted_plane(const std::function<Vector3(const Vector3&)>& place,
                   const std::function<Vector3(const Vector3&)>& normal) {
    const Positions plane = shapes::shaken_grid(40, 0.2);
    Positions parted(plane.rows(), 3);
    Normals normals(plane.rows(), 3);
    for (Index i = 0; i < plane.rows(); ++i) {
        parted.row(i) = place(plane.row(i).transpose());
        normals.row(i) = normal(plane.row(i).transpose());
    }
    return same_points(parted, normals, plane, shapes::up(plane.rows()));
}

TEST(Resampling, ACrackBetweenSidesThatFaceEachOtherIsFilled) {
    // A valley, 60° steep on both sides, without its bottom.
    constexpr double kGap = 0.2;
    const double sine = std::sqrt(0.75), cosine = 0.5;
    const auto side = [](const Vector3& p) { return p.x() > 0.0 ? 1.0 : -1.0; };
    const Given given = parted_plane(
        [&](const Vector3& p) {
            const double up_hill = std::abs(p.x());
            return Vector3(side(p) * (kGap + cosine * up_hill), p.y(), sine * up_hill);
        },
        [&](const Vector3& p) { return Vector3(-side(p) * sine, 0.0, cosine); });
    const Resampling resampling = given.resampled();
    Progress progress;
    const double spacing = 2.0 / 39;
    for (const double t : {0.1, 0.2}) {
        const OrientedPoints frame = given.at(t);
        ASSERT_LT(frame.normals.row(0).dot(frame.normals.row(frame.normals.rows() - 1)), 0.0);
        const auto alive = resampling.at(t, frame, progress);
        const Positions all = with_pairs(frame, alive);
        const KdTree<3> tree(all);
        for (double x = -kGap * (1 - t); x < kGap * (1 - t); x += 0.01)
            for (double y = -0.95; y < 0.95; y += 0.03)
                EXPECT_LT(distance_to(tree, {x, y, 0}), 1.35 * spacing)
                    << t << " " << x << " " << y;
        // The bottom faces up, and turns into the sides.
        for (Eigen::Index i = 0; i < alive.positions.rows(); ++i) {
            const bool is_in_the_middle = std::abs(alive.positions(i, 0)) < 0.02;
            EXPECT_GT(alive.normals(i, 2), is_in_the_middle ? 0.9 : 0.4);
        }
    }
}

TEST(Resampling, ATriangleThatWouldShowItsBackFaceIsNotFilled) {
    // One half slid over the other: what joins their edges would lie upside down in between.
    const Given given = parted_plane(
        [](const Vector3& p) {
            return Vector3(p.x() > 0.0 ? p.x() - 0.4 : p.x() + 0.4, p.y(), p.x() > 0.0 ? -0.3 : 0);
        },
        [](const Vector3&) { return Vector3(0, 0, 1); });
    EXPECT_EQ(given.resampled().points().size(), 0U);
}

TEST(Resampling, AHoleThatBothModelsHaveStaysOpen) {
    const Positions plane = shapes::shaken_grid(50, 0.2);
    std::vector<Index> kept;
    for (Index i = 0; i < plane.rows(); ++i)
        if (plane.row(i).norm() > 0.25) kept.push_back(i);
    const Positions ring = plane(kept, Eigen::all);
    Positions torn = ring;  // and a crack through it
    for (Index i = 0; i < torn.rows(); ++i)
        if (torn(i, 0) > 0) torn(i, 0) += 0.4;
    const Given given = same_points(ring, shapes::up(ring.rows()), torn, shapes::up(ring.rows()));
    const Resampling resampling = given.resampled();
    ASSERT_GT(resampling.points().size(), 50U);
    Progress progress;
    const Resampling::Alive alive = resampling.at(0.5, given.at(0.5), progress);
    for (Eigen::Index i = 0; i < alive.positions.rows(); ++i)
        EXPECT_GT(std::abs(alive.positions(i, 1)), 0.18);
}

TEST(Resampling, PointsComeAndGoSmoothlyAndKeepTheirIds) {
    const Given given = torn_plane();
    const Resampling resampling = given.resampled();
    Progress progress;
    EXPECT_TRUE(resampling.at(0.0, given.at(0.0), progress).ids.empty());
    EXPECT_TRUE(resampling.at(1.0, given.at(1.0), progress).ids.empty());
    constexpr double kStep = 1e-3;
    double spacing = 2.0 / 39;
    for (const double t : {0.05, 0.21, 0.5, 0.64, 0.93}) {
        const auto now = resampling.at(t, given.at(t), progress);
        const auto next = resampling.at(t + kStep, given.at(t + kStep), progress);
        EXPECT_TRUE(std::ranges::is_sorted(now.ids));
        std::size_t j = 0;
        for (std::size_t i = 0; i < now.ids.size(); ++i) {
            const auto row = static_cast<Eigen::Index>(i);
            while (j < next.ids.size() && next.ids[j] < now.ids[i]) ++j;
            if (j == next.ids.size() || next.ids[j] != now.ids[i]) {
                EXPECT_LT(now.share[row], 0.01);  // vanished, from almost nothing
                continue;
            }
            const auto other = static_cast<Eigen::Index>(j);
            EXPECT_LT(std::abs(next.share[other] - now.share[row]), 0.03);
            const double moved = (next.positions.row(other) - now.positions.row(row)).norm();
            EXPECT_LT(moved, kStep * 0.6 + 0.01 * spacing);
        }
    }
}

TEST(Resampling, AnyOrderAndAnyNumberOfThreadsGiveTheSameBits) {
    SKIP_WHERE_WATCHED();
    const Given given = limbs(2000);
    const auto with = [&](int count, bool backward) {
        const ThreadCount threads(count);
        const Resampling resampling = given.resampled(everywhere());
        Progress progress;
        if (backward) resampling.at(0.9, given.at(0.9), progress);
        return resampling.at(0.4, given.at(0.4), progress);
    };
    const auto one = with(1, false), two = with(2, true);
    EXPECT_EQ(one.ids, two.ids);
    EXPECT_EQ(one.positions, two.positions);
    EXPECT_EQ(one.normals, two.normals);
    EXPECT_EQ(one.share, two.share);
}

TEST(Resampling, TheSameAtAnyScaleAndPlace) {
    const std::size_t expected = torn_plane().resampled().points().size();
    for (const double size : {1e-150, 1e-6, 1e6, 1e150}) {
        Given given = torn_plane();
        const Eigen::RowVector3d place = size * Eigen::RowVector3d(30, -20, 10);
        for (Cloud* cloud : {&given.source, &given.target})
            cloud->positions = (size * cloud->positions).rowwise() + place;
        const Resampling resampling = given.resampled();
        EXPECT_NEAR(static_cast<double>(resampling.points().size()), static_cast<double>(expected),
                    0.02 * static_cast<double>(expected))
            << size;
        Progress progress;
        const auto alive = resampling.at(0.5, given.at(0.5), progress);
        EXPECT_TRUE(alive.positions.allFinite());
        EXPECT_LT((alive.positions.rowwise() - place).cwiseAbs().maxCoeff(), 2.0 * size);
    }
}

TEST(Resampling, BothSidesOfAThinPlateAreFilled) {
    const Given top = torn_plane(30);
    const auto rows = to_index(top.pairs.size());
    Given plate = top;
    for (auto [cloud, from] :
         {std::pair{&plate.source, &top.source}, {&plate.target, &top.target}}) {
        cloud->positions.resize(2 * rows, 3);
        cloud->positions << from->positions,
            from->positions.rowwise() - Eigen::RowVector3d(0, 0, 0.02);
        cloud->normals.resize(2 * rows, 3);
        cloud->normals << from->normals, -from->normals;
    }
    for (Index i = 0; i < rows; ++i) plate.pairs.push_back({rows + i, rows + i});
    const Resampling resampling = plate.resampled();
    Progress progress;
    const auto alive = resampling.at(0.5, plate.at(0.5), progress);
    Index above = 0, below = 0;
    for (Eigen::Index i = 0; i < alive.positions.rows(); ++i) {
        const bool is_above = alive.normals(i, 2) > 0;
        ++(is_above ? above : below);
        EXPECT_NEAR(alive.positions(i, 2), is_above ? 0.0 : -0.02, 1e-6);
    }
    EXPECT_GT(above, 60);
    EXPECT_NEAR(above, below, 0.1 * above);
}

TEST(Resampling, CrowdedPointsHideAndLeaveNoGap) {
    // A map that draws a disc of the plane together, halfway only; straight there and back.
    const Positions plane = shapes::shaken_grid(40, 0.2);
    Given given = same_points(plane, shapes::up(plane.rows()), plane, shapes::up(plane.rows()));
    const auto crowded = [&](double t) {
        OrientedPoints cloud{plane, shapes::up(plane.rows())};
        const double pull = 4.0 * t * (1.0 - t);
        for (Index i = 0; i < plane.rows(); ++i) {
            const double r = plane.row(i).norm();
            if (r < 0.6) cloud.positions.row(i) *= 1.0 - 0.9 * pull * (1.0 - r / 0.6);
        }
        return cloud;
    };
    ResamplingOptions options;
    options.crowding = 2.0;
    Progress progress;
    const Resampling resampling(given.source, given.target, given.pairs, crowded, options,
                                progress);
    const Values shares = resampling.pair_shares(0.5);
    const Index hidden = to_index((shares.array() < 0.5).count());
    EXPECT_GT(hidden, 20);
    EXPECT_EQ(resampling.pair_shares(0.0).minCoeff(), 1.0);
    EXPECT_EQ(resampling.pair_shares(1.0).minCoeff(), 1.0);
    const OrientedPoints frame = crowded(0.5);
    std::vector<Index> kept;
    for (Index i = 0; i < shares.size(); ++i)
        if (shares[i] > 0.99) kept.push_back(i);
    const Positions shown = frame.positions(kept, Eigen::all);
    const KdTree<3> tree(shown);
    for (Index i = 0; i < shares.size(); ++i)
        EXPECT_LT(distance_to(tree, frame.positions.row(i).transpose()), 0.8 * 2.0 / 39);
}

TEST(Resampling, GoesOnFromAPlanWithTheSameBits) {
    const Given given = torn_plane(40);
    const auto count = to_index(given.pairs.size());
    ResamplingOptions options;
    options.crowding = 2.0;
    const Resampling first = given.resampled(options);
    const Resampling again(first.plan(), count, options);
    ASSERT_FALSE(first.points().empty());
    for (const double t : {0.2, 0.5, 0.9}) {
        Progress progress;
        const auto here = first.at(t, given.at(t), progress);
        const auto there = again.at(t, given.at(t), progress);
        EXPECT_EQ(here.ids, there.ids);
        EXPECT_EQ(here.positions, there.positions);
        EXPECT_EQ(here.normals, there.normals);
        EXPECT_EQ(here.share, there.share);
        EXPECT_EQ(first.pair_shares(t), again.pair_shares(t));
    }

    EXPECT_THROW(Resampling(first.plan(), count + 1, options), CloudError);
    ResamplingPlan wrong = first.plan();
    wrong.points.front().pairs[1] = count;
    EXPECT_THROW(Resampling(wrong, count, options), CloudError);
    wrong = first.plan();
    wrong.points.front().weights[0] = 1e300;
    EXPECT_THROW(Resampling(wrong, count, options), CloudError);
    wrong = first.plan();
    wrong.source_spacing[3] = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(Resampling(wrong, count, options), CloudError);
    wrong.source_spacing[3] = -0.1;
    EXPECT_THROW(Resampling(wrong, count, options), CloudError);
    wrong = first.plan();
    wrong.hidden.push_back({-1, {}});
    EXPECT_THROW(Resampling(wrong, count, options), CloudError);
}

TEST(Resampling, PointsOfOnePlaceThatGoFarApartAreNotFilledUpBetween) {
    constexpr Index kPlaces = 3, kEach = 16, kCount = kPlaces * kEach;
    const Positions corners = shapes::cube_noise(kPlaces, 3);
    Positions from = 1e-7 * shapes::cube_noise(kCount, 1), to = 1e-7 * shapes::cube_noise(kCount);
    for (Index i = 0; i < kCount; ++i) {
        from.row(i) += corners.row(i % kPlaces);
        to.row(i) += corners.row(i / kEach);
    }
    const Given given = same_points(from, shapes::up(kCount), to, shapes::up(kCount));
    EXPECT_LT(given.resampled().points().size(), 500U * kCount);
}

TEST(Resampling, OmegaZeroInsertsNothing) {
    ResamplingOptions options;
    options.omega = 0.0;
    EXPECT_TRUE(torn_plane().resampled(options).points().empty());
    options.crowding = 2.0;
    EXPECT_TRUE(torn_plane().resampled(options).points().empty());
}

TEST(Resampling, RefusesBadOptionsAndCanBeCancelled) {
    const Given given = torn_plane(20);
    ResamplingOptions omega, spacing, crowding;
    omega.omega = -1.0;
    spacing.spacing = 0.0;
    crowding.crowding = 1.0;
    for (const ResamplingOptions& options : {omega, spacing, crowding})
        EXPECT_THROW(given.resampled(options), OptionError);
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(Resampling(
                     given.source, given.target, given.pairs, [&](double t) { return given.at(t); },
                     {}, progress),
                 Cancelled);
}

TEST(Resampling, ProgressNeverFallsAndCanEndAtAnyReport) {
    const Given given = torn_plane(60);
    ResamplingOptions options;
    options.crowding = 2.0;
    const auto run = [&](Progress& progress) {
        progress.enter("resampling");
        Resampling(
            given.source, given.target, given.pairs, [&](double t) { return given.at(t); }, options,
            progress);
    };
    double last = 0.0;
    // Every report is heard, however fast this machine is.
    constexpr std::chrono::milliseconds always{0};
    Progress watched(
        [&](std::string_view, double fraction) {
            EXPECT_GE(fraction, last);
            last = fraction;
            return true;
        },
        always);
    run(watched);
    EXPECT_GT(last, 0.5);
    for (const double share : {0.1, 0.5, 0.8}) {
        Progress ended([&](std::string_view, double fraction) { return fraction < share; }, always);
        EXPECT_THROW(run(ended), Cancelled) << share;
    }
}

TEST(Resampling, CoincidentPointsDoNoHarm) {
    const Positions plane = shapes::shaken_grid(20, 0.2);
    Positions doubled(800, 3);
    doubled << plane, plane;
    Positions apart = doubled;
    apart.bottomRows(400).col(0).array() += 0.5;
    const Given given = same_points(doubled, shapes::up(800), apart, shapes::up(800));
    const Resampling resampling = given.resampled();
    Progress progress;
    EXPECT_TRUE(resampling.at(0.5, given.at(0.5), progress).positions.allFinite());
    const Given folded = same_points(
        plane, shapes::up(400), Positions::Zero(400, 3).rowwise() + Eigen::RowVector3d(0, 0, 1),
        shapes::up(400));
    EXPECT_TRUE(folded.resampled().at(0.5, folded.at(0.5), progress).positions.allFinite());
    // A plan from a file may be for other pairs, all of which lie in one place.
    const Given torn = torn_plane();
    OrientedPoints heap = torn.at(0.5);
    heap.positions.rowwise() = Eigen::RowVector3d(1, 2, 3);
    const Positions filled = torn.resampled().at(0.5, heap, progress).positions;
    ASSERT_GT(filled.rows(), 0);
    EXPECT_LT((filled.rowwise() - Eigen::RowVector3d(1, 2, 3)).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(Example, Resampling) {
    const Given torn = torn_plane();
    const auto& [source, target, pairs] = torn;
    const auto frame_at = [&](double t) { return torn.at(t); };
    Progress progress;
    // --- example
    const Resampling resampling(source, target, pairs, frame_at, {}, progress);
    const Resampling::Alive alive = resampling.at(0.5, frame_at(0.5), progress);
    const Positions& inserted = alive.positions;
    // --- end of the example
    ASSERT_GT(inserted.rows(), 0);
    EXPECT_LT(inserted.col(2).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_GT(alive.share.minCoeff(), 0.0);
}

}  // namespace
}  // namespace pointmorph

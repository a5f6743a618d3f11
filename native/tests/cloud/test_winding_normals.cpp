#include "cloud/winding_normals.hpp"

#include <gtest/gtest.h>

#include <numbers>
#include <numeric>
#include <random>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/covariance.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

struct OrientedCloud {
    Positions positions;
    Normals normals;  ///< the true ones

    Values areas() const {
        const double all = 4.0 * std::numbers::pi;
        return Values::Constant(positions.rows(), all / static_cast<double>(positions.rows()));
    }
    std::vector<Index> rows() const {
        std::vector<Index> all(to_size(to_index(positions.rows())));
        std::iota(all.begin(), all.end(), 0);
        return all;
    }
};

OrientedCloud round_cloud(Index count) {
    const Positions p = shapes::sphere(count);
    return {p, p};
}

/// A body with wings whose sides lie about as far apart as the points do, at random places.
OrientedCloud winged_cloud(Index count, unsigned seed) {
    const auto height = [](double x, double y) {
        const double body = 1.0 - 4.0 * x * x - y * y;
        return 0.06 + 0.35 * std::sqrt(std::max(0.0, body));
    };
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    OrientedCloud shape{Positions(count, 3), Normals(count, 3)};
    for (Index i = 0; i < count;) {
        constexpr double kStep = 1e-4, kLong = 2.0;
        const double x = kLong * uniform(random), y = uniform(random);
        if (x * x / (kLong * kLong) + y * y > 0.999) continue;
        const double side = i % 2 == 0 ? 1.0 : -1.0;
        shape.positions.row(i) << x, y, side * height(x, y);
        shape.normals.row(i) =
            Vector3(-(height(x + kStep, y) - height(x - kStep, y)) / kStep / 2.0,
                    -(height(x, y + kStep) - height(x, y - kStep)) / kStep / 2.0, 1.0)
                .normalized()
                .transpose();
        shape.normals(i, 2) *= side;
        ++i;
    }
    return shape;
}

double wrong_signs(const Normals& normals, const Normals& truth) {
    return ((normals.array() * truth.array()).rowwise().sum() < 0.0).cast<double>().mean();
}

TEST(WindingNormals, TellInsideFromOutsideOfABall) {
    const OrientedCloud shape = round_cloud(1500);
    const WindingNormals winding(shape.positions, shape.areas());
    Progress progress;
    EXPECT_LT(winding.misfit(shape.normals, progress), 0.02);
    // Reversed, the ball is the outside: 1 off either side.
    EXPECT_GT(winding.misfit(-shape.normals, progress), 1.5);
    const Normals found = winding.find(shape.normals, progress);
    EXPECT_GT((found.array() * shape.normals.array()).rowwise().sum().minCoeff(), 0.99);
}

TEST(WindingNormals, FallOutwardAlsoBetweenThePoints) {
    const OrientedCloud shape = round_cloud(1500), others = round_cloud(777);
    const WindingNormals winding(shape.positions, shape.areas());
    Progress progress;
    const Normals falls =
        winding.fall_at(shape.normals, others.positions, others.areas(), progress);
    EXPECT_GT((falls.array() * others.normals.array()).rowwise().sum().minCoeff(), 0.98);
}

TEST(WindingNormals, MendAQuarterOfReversedNormals) {
    for (const Index count : {1200, 6000}) {  // all, and by some of them
        const OrientedCloud shape = round_cloud(count);
        Normals normals = shape.normals;
        for (Index i = 0; i < count; ++i)
            if (shape.positions(i, 0) > 0.5) normals.row(i) *= -1.0;
        ASSERT_NEAR(wrong_signs(normals, shape.normals), 0.25, 0.01);
        Progress progress;
        orient_by_winding(shape.positions, shape.rows(), normals, progress);
        EXPECT_LT(wrong_signs(normals, shape.normals), 0.01) << count;
        EXPECT_LT((normals.rowwise().norm().array() - 1.0).abs().maxCoeff(), 1e-6);
    }
}

TEST(WindingNormals, MendThemAtAnyScaleAndPlaceAndWithPointsInOnePlace) {
    SKIP_WHERE_WATCHED();
    const OrientedCloud shape = round_cloud(1200);
    for (const double scale : {1e-12, 1.0, 1e12}) {
        Positions positions = shape.positions;
        for (Index i = 600; i < 620; ++i) positions.row(i) = positions.row(600);
        positions = (positions.rowwise() + Eigen::RowVector3d(1e4, 0.0, 0.0)) * scale;
        Normals normals = shape.normals;
        for (Index i = 0; i < 1200; ++i)
            if (shape.positions(i, 0) > 0.5) normals.row(i) *= -1.0;
        Progress progress;
        orient_by_winding(positions, shape.rows(), normals, progress);
        EXPECT_LT(wrong_signs(normals, shape.normals), 0.03) << scale;
    }
}

TEST(WindingNormals, TellTheSidesOfThinWings) {
    SKIP_WHERE_WATCHED();
    for (const unsigned seed : {1u, 2u, 3u}) {
        const OrientedCloud shape = winged_cloud(2400, seed);
        Progress progress;
        const Neighborhoods near = nearest_neighbors(KdTree<3>(shape.positions), 16, progress);
        // Planes fitted through both sides of one wing, which is reversed as a whole, and of the
        // other only below.
        Normals normals = covariance_analysis(shape.positions, near, progress).normals;
        for (Index i = 0; i < to_index(normals.rows()); ++i) {
            const double x = shape.positions(i, 0), z = shape.positions(i, 2);
            const bool is_right = normals.row(i).dot(shape.normals.row(i)) > 0.0;
            const bool is_reversed = x > 1.0 || (x < -1.0 && z < 0.0);
            if (is_right == is_reversed) normals.row(i) *= -1.0;
        }
        ASSERT_GT(wrong_signs(normals, shape.normals), 0.2);
        orient_by_winding(shape.positions, shape.rows(), normals, progress);
        EXPECT_LT(wrong_signs(normals, shape.normals), 0.03) << seed;
    }
}

TEST(WindingNormals, LeaveOpenSurfacesAndRightNormalsAlone) {
    const Positions bowl = shapes::sphere(1500, 0.0);
    const OrientedCloud shape = round_cloud(1500);
    for (const Positions& positions : {bowl, shape.positions}) {
        Normals normals = positions;
        std::vector<Index> rows(1500);
        std::iota(rows.begin(), rows.end(), 0);
        Progress progress;
        orient_by_winding(positions, rows, normals, progress);
        EXPECT_EQ(normals, Normals(positions));
    }
}

TEST(WindingNormals, AreTheSameForAnyThreadCount) {
    SKIP_WHERE_WATCHED();
    const OrientedCloud shape = winged_cloud(1700, 4);
    const WindingNormals winding(shape.positions, shape.areas());
    Normals upward = shape.normals;
    for (Index i = 0; i < 200; ++i) upward.row(i) *= -1.0;
    Normals first;
    for (const int threads : {1, 2, 3}) {
        const ThreadCount limit(threads);
        Progress progress;
        const Normals found = winding.find(upward, progress);
        if (threads == 1)
            first = found;
        else
            EXPECT_EQ(found, first);
    }
}

TEST(WindingNormals, CanBeCanceled) {
    const OrientedCloud shape = round_cloud(1500);
    const WindingNormals winding(shape.positions, shape.areas());
    Progress progress([](std::string_view, double share) { return share < 0.3; },
                      std::chrono::milliseconds(0));
    EXPECT_THROW(winding.find(shape.normals, progress), Cancelled);
}

}  // namespace
}  // namespace pointmorph

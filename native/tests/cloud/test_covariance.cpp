#include "pointmorph/cloud/covariance.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <numbers>
#include <numeric>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

Neighborhoods neighbors(const Positions& p, Index k = 16) {
    Progress progress;
    return nearest_neighbors(KdTree<3>(p), k, progress);
}

Covariance analysis(const Positions& p, Index k = 16) {
    Progress progress;
    return covariance_analysis(p, neighbors(p, k), progress);
}

/// Estimated and oriented; the estimate's own signs are made random first.
Normals oriented(const Positions& p, Index k = 16, unsigned seed = 1) {
    Progress progress;
    Normals normals = analysis(p, k).normals;
    std::mt19937_64 random(seed);
    for (Index i = 0; i < normals.rows(); ++i)
        if (random() % 2 == 0) normals.row(i) *= -1.0;
    orient_normals(p, neighbors(p, k), normals, progress);
    return normals;
}

Index disagreements(const Normals& a, const Normals& b) {
    return to_index(((a.array() * b.array()).rowwise().sum() <= 0.0).count());
}

Positions stacked(const Positions& a, const Positions& b) {
    Positions both(a.rows() + b.rows(), 3);
    both << a, b;
    return both;
}

void expect_principal_axes(const Matrix3& matrix) {
    const PrincipalAxes found = principal_axes(matrix);
    const double scale = matrix.cwiseAbs().maxCoeff();
    const Matrix3 rebuilt =
        found.axes * (found.eigenvalues / scale).asDiagonal() * found.axes.transpose();
    EXPECT_LT((rebuilt - matrix / scale).cwiseAbs().maxCoeff(), 1e-11) << matrix;
    EXPECT_LT((found.axes.transpose() * found.axes - Matrix3::Identity()).norm(), 1e-11) << matrix;
    EXPECT_GT(found.axes.determinant(), 0.0) << matrix;
    EXPECT_GE(found.eigenvalues[0], 0.0);
    EXPECT_LE(found.eigenvalues[0], found.eigenvalues[1]);
    EXPECT_LE(found.eigenvalues[1], found.eigenvalues[2]);
    const Eigen::SelfAdjointEigenSolver<Matrix3> iterative(matrix / scale);
    EXPECT_LT((found.eigenvalues / scale - iterative.eigenvalues()).cwiseAbs().maxCoeff(), 2e-12)
        << matrix;
}

TEST(PrincipalAxes, AreRightForAnySpectrum) {
    for (unsigned seed = 0; seed < 20; ++seed) {
        const Matrix3 r = shapes::rotation(seed);
        for (double gap = 1.0; gap > 1e-20; gap /= 10.0)
            for (const Vector3& spectrum :
                 {Vector3(0.0, gap, 1.0), Vector3(gap, gap, 1.0), Vector3(gap, 1.0, 1.0 + gap),
                  Vector3(1.0, 1.0 + gap, 2.0), Vector3(1.0, 1.0 + gap, 1.0 + 2.0 * gap),
                  Vector3(0.0, 0.0, 1.0), Vector3(0.0, 1.0, 1.0), Vector3(1.0, 1.0, 1.0)}) {
                const Matrix3 half = r * spectrum.cwiseSqrt().asDiagonal();
                expect_principal_axes(half * half.transpose());
            }
    }
}

TEST(PrincipalAxes, HoldAtAnyScale) {
    Matrix3 matrix;
    matrix << 2.0, 0.5, 0.1, 0.5, 1.0, 0.3, 0.1, 0.3, 0.7;
    for (const double scale : {1e-300, 1e-150, 1.0, 1e150, 1e300})
        expect_principal_axes(scale * matrix);
    const PrincipalAxes zero = principal_axes(Matrix3::Zero());
    EXPECT_EQ(zero.axes, Matrix3::Identity());
    EXPECT_EQ(zero.eigenvalues, Vector3::Zero());
}

TEST(LocalFrame, IsTheCovarianceOfItsRows) {
    const Positions p = shapes::cube_noise(50);
    const std::vector<Index> rows{3, 1, 4, 15, 9, 26};
    const LocalFrame frame = local_frame(p, rows);
    const Positions chosen = gather(p, rows);
    const Eigen::RowVector3d mean = chosen.colwise().mean();
    const Positions centered = chosen.rowwise() - mean;
    const Eigen::SelfAdjointEigenSolver<Matrix3> expected(Matrix3(centered.transpose() * centered));
    EXPECT_LT((frame.centroid - mean.transpose()).norm(), 1e-14);
    EXPECT_LT((frame.eigenvalues - expected.eigenvalues()).norm(), 1e-13);
    for (int axis = 0; axis < 3; ++axis)
        EXPECT_NEAR(std::abs(frame.axes.col(axis).dot(expected.eigenvectors().col(axis))), 1.0,
                    1e-12);
}

TEST(LocalFrame, OfNoneOneAndCoincidentPointsIsFinite) {
    const Positions p = Positions::Constant(4, 3, 5.0);
    for (const std::vector<Index>& rows :
         {std::vector<Index>{}, std::vector<Index>{2}, std::vector<Index>{0, 1, 2, 3}}) {
        const LocalFrame frame = local_frame(p, rows);
        EXPECT_EQ(frame.eigenvalues, Vector3::Zero());
        EXPECT_EQ(frame.axes, Matrix3::Identity());
        const double place = rows.empty() ? 0.0 : 5.0;
        EXPECT_EQ(frame.centroid, Vector3::Constant(place));
    }
}

TEST(Covariance, OfAPlaneIsItsNormalWithoutVariation) {
    const Matrix3 r = shapes::rotation(3);
    const Positions p = shapes::grid(30) * r.transpose();
    const Covariance found = analysis(p);
    for (Index i = 0; i < p.rows(); ++i) {
        EXPECT_NEAR(std::abs(found.normals.row(i).dot(r.col(2))), 1.0, 1e-14);
        EXPECT_LT(found.variation[i], 1e-14);
    }
}

TEST(Covariance, NormalsOfASphereAreItsRadii) {
    // A neighborhood of radius ρ that lies to one side is off by no more than ρ.
    const Index count = 5000;
    const Positions p = shapes::sphere(count);
    const double radius = std::sqrt(4.0 * std::numbers::pi * 17 / count / std::numbers::pi);
    const Covariance found = analysis(p);
    for (Index i = 0; i < count; ++i) {
        EXPECT_GT(std::abs(found.normals.row(i).dot(p.row(i))), std::cos(0.25 * radius));
        EXPECT_NEAR(found.normals.row(i).norm(), 1.0, 1e-14);
        EXPECT_LT(found.variation[i], radius * radius);
    }
}

TEST(Covariance, VariationRunsFromFlatToIsotropic) {
    Positions octahedron(7, 3);
    octahedron << 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1;
    EXPECT_NEAR(analysis(octahedron, 6).variation[0], 1.0 / 3.0, 1e-15);
}

TEST(Covariance, FollowsMotionAndScaleAndOrderOfThePoints) {
    const Positions p = shapes::torus(2000, 0.4);
    const Covariance reference = analysis(p);

    const Matrix3 r = shapes::rotation(5);
    const Positions moved = ((1e-3 * p) * r.transpose()).rowwise() + Eigen::RowVector3d(50, 60, 70);
    const Covariance other = analysis(moved);
    for (Index i = 0; i < p.rows(); ++i) {
        EXPECT_NEAR(std::abs(other.normals.row(i).dot(reference.normals.row(i) * r.transpose())),
                    1.0, 1e-10);
        EXPECT_NEAR(other.variation[i], reference.variation[i], 1e-9);
    }

    const auto order = shapes::permutation(to_index(p.rows()), 7);
    const Covariance permuted = analysis(gather(p, order));
    for (std::size_t i = 0; i < order.size(); ++i) {
        EXPECT_NEAR(permuted.variation[to_index(i)], reference.variation[order[i]], 1e-14);
        EXPECT_NEAR(
            std::abs(permuted.normals.row(to_index(i)).dot(reference.normals.row(order[i]))), 1.0,
            1e-12);
    }
}

TEST(Covariance, DegenerateNeighborhoodsGiveUnitNormals) {
    for (Index count : {0, 1, 2, 3, 40}) {
        const Positions coincident = Positions::Constant(count, 3, -2.0);
        Positions line = Positions::Zero(count, 3);
        for (Index i = 0; i < count; ++i) line.row(i) << 3.0 * i, 4.0 * i, 0.0;
        for (const bool on_line : {false, true}) {
            const Positions& p = on_line ? line : coincident;
            const Covariance found = analysis(p);
            const Normals normals = oriented(p);
            ASSERT_EQ(found.normals.rows(), count);
            for (Index i = 0; i < count; ++i) {
                EXPECT_NEAR(found.normals.row(i).norm(), 1.0, 1e-14);
                EXPECT_LT(found.variation[i], 1e-14);
                EXPECT_NEAR(normals.row(i).norm(), 1.0, 1e-14);
                if (on_line && count > 1) {
                    EXPECT_NEAR(found.normals.row(i).dot(Eigen::RowVector3d(3, 4, 0)), 0.0, 1e-12);
                }
            }
        }
    }
}

TEST(OrientNormals, SphereTorusAndHemisphereFaceOutwards) {
    const Index count = is_watched() ? 1000 : 3000;
    const Positions sphere = shapes::sphere(count);
    EXPECT_EQ(disagreements(oriented(sphere), sphere), 0);
    const Positions half = shapes::sphere(count, 0.0);
    EXPECT_EQ(disagreements(oriented(half), half), 0);
    const Positions cap = shapes::sphere(count, 0.95);
    EXPECT_EQ(disagreements(oriented(cap), cap), 0);

    const Positions torus = shapes::torus(2 * count, 0.4);
    Normals outward = torus;
    for (Index i = 0; i < torus.rows(); ++i)
        outward.row(i).head<2>() -= torus.row(i).head<2>().normalized();
    EXPECT_EQ(disagreements(oriented(torus), outward), 0);
}

TEST(OrientNormals, ClosedShapesFaceOutwardsWhateverThePose) {
    for (unsigned seed = 0; seed < 5; ++seed) {
        const Positions sphere = shapes::sphere(800);
        const Matrix3 r = shapes::rotation(seed);
        const Positions moved =
            (7.0 * sphere * r.transpose()).rowwise() + Eigen::RowVector3d(100, -50, 20);
        const Normals outward = sphere * r.transpose();
        EXPECT_EQ(disagreements(oriented(moved, 16, seed), outward), 0);
    }
}

TEST(OrientNormals, HeadWithNeckOpeningFacesOutwards) {
    // An ellipsoid that is open below, with a dent for a face.
    Positions p = shapes::sphere(is_watched() ? 2000 : 6000, -0.8);
    Normals outward = p;
    for (Index i = 0; i < p.rows(); ++i) {
        p.row(i) *=
            1.0 - 0.3 * std::exp(-8.0 * (p.row(i) - Eigen::RowVector3d(1, 0, 0)).squaredNorm());
        p(i, 2) *= 1.4;
        outward(i, 2) /= 1.4;
    }
    EXPECT_LT(disagreements(oriented(p), outward), p.rows() / 100);
}

TEST(OrientNormals, FlatPatchesFaceUpwards) {
    const Positions flat = shapes::grid(25);
    const Normals up = Eigen::RowVector3d(0, 0, 1).replicate(flat.rows(), 1);
    for (unsigned seed = 0; seed < 4; ++seed) {
        EXPECT_EQ(disagreements(oriented(flat, 16, seed), up), 0);
        // A saddle bulges to neither side.
        Positions saddle = flat;
        saddle.col(2) = 0.5 * saddle.col(0).cwiseProduct(saddle.col(1));
        EXPECT_EQ(disagreements(oriented(saddle, 16, seed), up), 0);
        // x + y = 0 faces x and y alike: both orders of the points must agree.
        Positions diagonal(flat.rows(), 3);
        diagonal << flat.col(0), -flat.col(0), flat.col(1);
        const Normals front = Eigen::RowVector3d(1, 1, 0).replicate(flat.rows(), 1);
        EXPECT_EQ(disagreements(oriented(diagonal, 16, seed), front), 0);
        diagonal.col(1) *= -1.0;
        const Normals back = Eigen::RowVector3d(-1, 1, 0).replicate(flat.rows(), 1);
        EXPECT_EQ(disagreements(oriented(diagonal, 16, seed), back), 0);
    }
}

TEST(OrientNormals, ComponentsAreIndependent) {
    const Positions ball = shapes::sphere(1000);
    const Positions far = (0.3 * ball).rowwise() + Eigen::RowVector3d(5, 0, 0);
    const Normals found = oriented(stacked(ball, far));
    EXPECT_EQ(disagreements(found, stacked(ball, ball)), 0);
    // The inner shell of a hollow ball is a closed surface of its own.
    EXPECT_EQ(disagreements(oriented(stacked(ball, 0.5 * ball)), stacked(ball, ball)), 0);
}

TEST(OrientNormals, ThinPlateHasTwoSides) {
    // A plate with round edge, thinner than its spacing in the plane is wide.
    constexpr double kSpacing = 0.05;
    for (const double thickness : {3.0 * kSpacing, 1.5 * kSpacing}) {
        std::vector<Eigen::RowVector3d> points, outward;
        for (int u = -20; u <= 20; ++u)
            for (int v = -20; v <= 20; ++v)
                for (const int side : {-1, 1}) {
                    points.emplace_back(u * kSpacing, v * kSpacing, 0.5 * side * thickness);
                    outward.emplace_back(0, 0, side);
                }
        const int rows = std::max(1, static_cast<int>(std::lround(1.6 * thickness / kSpacing)) - 1);
        for (int w = 1; w <= rows; ++w) {
            const double angle = std::numbers::pi * w / (rows + 1);
            for (int u = -20; u <= 20; ++u)
                for (const int side : {-1, 1}) {
                    const double out = side * (1.0 + 0.5 * thickness * std::sin(angle));
                    const double z = 0.5 * thickness * std::cos(angle);
                    points.emplace_back(out, u * kSpacing, z);
                    outward.emplace_back(side * std::sin(angle), 0, std::cos(angle));
                    points.emplace_back(u * kSpacing, out, z);
                    outward.emplace_back(0, side * std::sin(angle), std::cos(angle));
                }
        }
        Positions p(points.size(), 3), expected(points.size(), 3);
        for (std::size_t i = 0; i < points.size(); ++i) {
            p.row(to_index(i)) = points[i];
            expected.row(to_index(i)) = outward[i];
        }
        const Normals found = oriented(p, 10);
        // Points half-way round the edge may have any normal; the sides may not.
        Index wrong = 0;
        for (Index i = 0; i < p.rows(); ++i)
            if (std::abs(expected(i, 2)) == 1.0 && found.row(i).dot(expected.row(i)) <= 0.0)
                ++wrong;
        EXPECT_EQ(wrong, 0) << thickness;
    }
}

TEST(OrientNormals, DoesNotDependOnThreadsOrOrder) {
    const Positions p = shapes::torus(4000, 0.4);
    Normals by_threads[2];
    for (const int threads : {1, 4}) {
        const ThreadCount scope(threads);
        by_threads[threads > 1] = oriented(p);
    }
    EXPECT_EQ(by_threads[0], by_threads[1]);

    const auto order = shapes::permutation(to_index(p.rows()), 3);
    EXPECT_EQ(disagreements(oriented(gather(p, order), 16, 9), gather(by_threads[0], order)), 0);
}

TEST(OrientNormals, EndsOnANonOrientableSurface) {
    Positions strip(200 * 9, 3);
    for (Index u = 0; u < 200; ++u)
        for (Index v = 0; v < 9; ++v) {
            const double a = 2.0 * std::numbers::pi * u / 200, w = 0.03 * (v - 4);
            const double r = 1.0 + w * std::cos(a / 2.0);
            strip.row(u * 9 + v) << r * std::cos(a), r * std::sin(a), w * std::sin(a / 2.0);
        }
    const Normals found = oriented(strip, 8);
    EXPECT_TRUE(found.allFinite());
    // All but the seam agree: few pairs of neighbors along the strip have opposite signs.
    Index opposite = 0;
    for (Index i = 9; i < strip.rows(); ++i) opposite += found.row(i).dot(found.row(i - 9)) < 0.0;
    EXPECT_LE(opposite, 9 * 2);
}

TEST(OrientNormals, CancelledLeavesTheNormalsAsTheyWere) {
    const Positions p = shapes::sphere(2000);
    const Neighborhoods near = neighbors(p);
    Normals normals = analysis(p).normals;
    const Normals before = normals;
    Progress progress([](std::string_view, double) { return false; });
    EXPECT_THROW(orient_normals(p, near, normals, progress), Cancelled);
    EXPECT_EQ(normals, before);
}

TEST(Example, Covariance) {
    const Positions positions = shapes::sphere(500);
    Progress progress;
    // --- example
    const Neighborhoods near = nearest_neighbors(KdTree<3>(positions), 16, progress);
    Covariance covariance = covariance_analysis(positions, near, progress);
    orient_normals(positions, near, covariance.normals, progress);
    const double bend = covariance.variation[7];
    // --- end of the example
    EXPECT_EQ(disagreements(covariance.normals, positions), 0);
    EXPECT_GT(bend, 0.0);
    EXPECT_LT(bend, 0.02);
}

}  // namespace
}  // namespace pointmorph

#include "registration/pinning.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <string_view>
#include <vector>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/progress.hpp"
#include "registration/eggs.hpp"

namespace pointmorph {
namespace {

constexpr Index kGridSide = 41;
constexpr double kSpacing = 2.0 / (kGridSide - 1);
constexpr Index kMiddle = (kGridSide / 2) * kGridSide + kGridSide / 2;

MarkedRows forward(std::span<const IndexPair> pairs) {
    return {pairs, &IndexPair::source, &IndexPair::target};
}

TEST(Pinning, AMarkMeetsItsPartnerAndTakesThoseAroundAlong) {
    const Positions plane = shapes::grid(kGridSide);
    Positions other = plane;
    other.row(kMiddle) += Eigen::RowVector3d(0.1, 0.0, 0.2);
    const std::vector<IndexPair> marks{{kMiddle, kMiddle}};
    const Positions images = pinned_to_marks(plane, plane, other, forward(marks), kSpacing);
    EXPECT_EQ(images.row(kMiddle), other.row(kMiddle));
    for (Index i = 0; i < plane.rows(); ++i) {
        const double ratio =
            (plane.row(i) - plane.row(kMiddle)).squaredNorm() / std::pow(6.0 * kSpacing, 2);
        const double share = ratio < 1.0 ? std::pow(1.0 - ratio, 2) : 0.0;
        EXPECT_LT((images.row(i) - plane.row(i) - share * Eigen::RowVector3d(0.1, 0, 0.2)).norm(),
                  1e-12);
    }
}

TEST(Pinning, MarksBesideEachOtherAllMeet) {
    const Positions plane = shapes::grid(kGridSide);
    Positions other = plane.rowwise() + Eigen::RowVector3d(0.0, 0.1, 0.0);
    other.row(kMiddle + 1) += Eigen::RowVector3d(0.0, 0.0, 0.1);
    const std::vector<IndexPair> marks{{kMiddle, kMiddle}, {kMiddle + 1, kMiddle + 1}};
    const Positions images = pinned_to_marks(plane, plane, other, forward(marks), kSpacing);
    for (const IndexPair& mark : marks) EXPECT_EQ(images.row(mark.source), other.row(mark.target));
    EXPECT_EQ(largest_offset(images, other, forward(marks)), 0.0);
    EXPECT_NEAR(largest_offset(plane, other, forward(marks)), std::sqrt(0.02), 1e-12);
}

TEST(Pinning, ACurveGoesOntoItsPartnerAndTheRestStays) {
    const Positions plane = shapes::grid(kGridSide);
    const Normals up = Eigen::RowVector3d(0, 0, 1).replicate(plane.rows(), 1);
    const KdTree<3> tree(plane);
    constexpr Index kPlaces = 50;
    Positions own = Positions::Zero(kPlaces, 3), other;
    own.col(0).setLinSpaced(kPlaces, -0.5, 0.5);
    const Normals own_normals = up.topRows(kPlaces);
    other = own;
    for (Index k = 0; k < kPlaces; ++k) other(k, 1) = 0.03 * std::cos(3.0 * own(k, 0));
    const ImagedSurface surface{tree, up, kSpacing, [](Index) { return Matrix3::Identity(); }};
    Progress progress;
    const Positions images = pinned_to_curve(plane, surface, {own, own_normals}, other, progress);
    // Points of the grid on the curve lie near where the other one is at their place.
    for (Index i = 0; i < plane.rows(); ++i) {
        const double off = std::abs(plane(i, 1));
        if (off < 1e-9 && std::abs(plane(i, 0)) < 0.45) {
            EXPECT_NEAR(images(i, 1), 0.03 * std::cos(3.0 * plane(i, 0)), 0.1 * kSpacing);
        }
        if (off > 6.5 * kSpacing || std::abs(plane(i, 0)) > 0.5 + 6.5 * kSpacing) {
            EXPECT_EQ(images.row(i), plane.row(i));
        }
    }
    // Nothing on the other side of a thin part moves.
    const Normals down = -up;
    const ImagedSurface back{tree, down, kSpacing, [](Index) { return Matrix3::Identity(); }};
    EXPECT_EQ(pinned_to_curve(plane, back, {own, own_normals}, other, progress), plane);
    // It asks again and again whether to go on.
    for (const int most : {1, 4}) {
        int asked = 0;
        Progress ending([&](std::string_view, double) { return ++asked < most; },
                        std::chrono::milliseconds(0));
        EXPECT_THROW(pinned_to_curve(plane, surface, {own, own_normals}, other, ending), Cancelled);
        EXPECT_EQ(asked, most);
    }
}

TEST(Pinning, FeaturesAndGuidesPullWhatIsAroundThem) {
    Eggs eggs;
    const CoarseShape& source = eggs.coarse_source;
    Positions images = source.positions;
    images.col(2).array() += 0.05;
    const Positions pulled = pulled_to_marks(
        images, source, source, {eggs.features, &IndexPair::source, &IndexPair::source});
    for (const IndexPair& f : eggs.features)
        EXPECT_LT((pulled.row(f.source) - source.positions.row(f.source)).norm(), 0.005);
    for (Index i = 0; i < source.size(); ++i) {
        EXPECT_LE(pulled(i, 2), images(i, 2) + 1e-12);
        EXPECT_GE(pulled(i, 2), source.positions(i, 2) - 1e-12);
    }
    const CoarseShape bare = [&] {
        CoarseShape shape = source;
        shape.guides.places = source.positions.topRows(1);
        shape.guides.coarse_rows = {0};
        shape.guides.weights = Values::Zero(1);  // it shows the pose, and doesn't pull
        return shape;
    }();
    EXPECT_EQ(pulled_to_marks(images, bare, bare, forward({})), images);
}

TEST(Pinning, ImagesOfARegionAreTakenIntoItsPartner) {
    const Positions plane = shapes::grid(kGridSide);
    const KdTree<3> tree(plane);
    const Values left = (plane.col(0).array() < 0.0).cast<double>();
    Positions images = plane.rowwise() + Eigen::RowVector3d(0.3, 0.0, 0.0);
    const Positions clamped = clamped_to_region(images, left, tree, left);
    for (Index i = 0; i < plane.rows(); ++i) {
        // On the line between them, rounding decides.
        if (left[i] == 0.0 || images(i, 0) < -0.5 * kSpacing) {
            EXPECT_EQ(clamped.row(i), images.row(i));
        } else if (images(i, 0) > 0.5 * kSpacing) {
            EXPECT_NEAR(clamped(i, 0), -kSpacing, 1e-9);
            EXPECT_NEAR(clamped(i, 1), images(i, 1), 1e-9);
        }
    }
}

}  // namespace
}  // namespace pointmorph

#include "registration/likeness.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

#include "shapes.hpp"

namespace pointmorph {
namespace {

CoarseShape even_points(Positions positions, Normals normals, double area) {
    CoarseShape shape;
    shape.areas = Values::Constant(positions.rows(), area / static_cast<double>(positions.rows()));
    shape.positions = std::move(positions);
    shape.normals = std::move(normals);
    return shape;
}

CoarseShape ball_of_area_one() {
    const Positions unit = shapes::sphere(20000);
    return even_points(unit / std::sqrt(4.0 * std::numbers::pi), unit, 1.0);
}

constexpr FormRadii kRadii{0.05, 0.1, 0.2};
const std::vector<Index> kSome{0, 500, 7000, 12345, 19999};

TEST(Likeness, FormsOfABallAreThoseOfItsCaps) {
    const double radius = 1.0 / std::sqrt(4.0 * std::numbers::pi);
    const LocalForms forms = local_forms(ball_of_area_one(), kSome, kRadii);
    for (Eigen::Index i = 0; i < forms.rows(); ++i)
        for (int k = 0; k < 3; ++k) {
            const double r = kRadii[static_cast<std::size_t>(k)];
            // Heights in a cap are spread evenly from 0 to r²/2R.
            EXPECT_NEAR(forms(i, 3 * k), std::numbers::pi, 0.1);
            EXPECT_NEAR(forms(i, 3 * k + 1), r / (4.0 * radius), 0.03 * r / (4.0 * radius));
            EXPECT_NEAR(forms(i, 3 * k + 2), 1.0 - r * r / (4.0 * radius * radius), 2e-3);
        }
}

TEST(Likeness, ASheetHasItsOtherSideInEachBall) {
    const Index side = 101;
    const Positions front = 0.5 * shapes::grid(side);  // of area one
    Positions both(2 * front.rows(), 3);
    Positions back = front;
    back.col(2).array() -= 0.01;
    both << front, back;
    Normals normals(both.rows(), 3);
    normals << shapes::upward(to_index(front.rows())), -shapes::upward(to_index(front.rows()));
    const Index middle = shapes::nearest_row(front, front.colwise().mean().transpose());
    const LocalForms forms =
        local_forms(even_points(both, normals, 2.0), std::vector{middle}, kRadii);
    for (int k = 1; k < 3; ++k) {
        EXPECT_NEAR(forms(0, 3 * k), 2.0 * std::numbers::pi, 0.3);
        EXPECT_NEAR(forms(0, 3 * k + 2), 0.0, 0.03);
    }
}

TEST(Likeness, RotationsChangeNoForm) {
    const shapes::Urchin urchin(4000, {{1.2, 0.3, -0.2}, {-0.3, 0.9, 0.5}}, 3);
    const CoarseShape shape = even_points(0.3 * urchin.positions, urchin.normals, 1.0);
    const CoarseShape there = moved(shape, {1.0, shapes::rotation(5), {1.0, -2.0, 3.0}});
    const std::vector<Index> rows{0, 10, 200, 3999};
    EXPECT_TRUE(local_forms(shape, rows, kRadii).isApprox(local_forms(there, rows, kRadii), 1e-9));
}

TEST(Likeness, NumbersAreComparedInTheirDeviationsOverBothShapes) {
    LocalForms a = LocalForms::Random(40, 9), b = 3.0 * LocalForms::Random(60, 9);
    a.col(4) *= 1e-9;  // rounding
    b.col(4) *= 1e-9;
    make_comparable(a, b);
    for (int k = 0; k < 9; ++k) {
        Values all(100);
        all << a.col(k), b.col(k);
        const double deviation = std::sqrt((all.array() - all.mean()).square().mean());
        EXPECT_NEAR(deviation, k == 4 ? 0.0 : 1.0, 1e-6);
    }
}

TEST(Likeness, APlanesPointsAreAlikeHoweverItLies) {
    const Positions grid = shapes::grid(101);
    const Matrix3 turn = shapes::rotation(5);
    const CoarseShape shape =
        even_points(0.497 * grid * turn.transpose(),
                    shapes::upward(to_index(grid.rows())) * turn.transpose(), 1.0);
    std::vector<Index> inner;
    for (Index i = 0; i < to_index(grid.rows()); ++i)
        if (grid.row(i).cwiseAbs().maxCoeff() < 0.5) inner.push_back(i);
    LocalForms a = local_forms(shape, inner, kRadii), b = a;
    make_comparable(a, b);
    std::vector<Index> reversed(inner.size());
    std::iota(reversed.rbegin(), reversed.rend(), 0);
    EXPECT_LT(unlikeness(a, b, reversed, {}), 1e-9);
}

TEST(Likeness, BallsAreNoSmallerThanTwoSpacingsOfTheSparserShape) {
    CoarseShape dense, sparse;
    dense.positions.resize(5000, 3);
    sparse.positions.resize(400, 3);
    EXPECT_EQ(form_radii(dense, dense), (FormRadii{0.05, 0.1, 0.2}));
    EXPECT_EQ(form_radii(dense, sparse), (FormRadii{0.1, 0.1, 0.2}));
    EXPECT_EQ(form_radii(sparse, dense), (FormRadii{0.1, 0.1, 0.2}));
}

TEST(Likeness, IsNoneOfAShapeOntoItselfAndTheMeanDifferenceElsewhere) {
    const LocalForms a = LocalForms::Random(30, 9), b = LocalForms::Random(50, 9);
    std::vector<Index> same(30), other(30);
    std::iota(same.begin(), same.end(), 0);
    EXPECT_EQ(unlikeness(a, a, same, {}), 0.0);
    double sum = 0.0;
    for (Index i = 0; i < 30; ++i) {
        other[to_size(i)] = (7 * i + 3) % 50;
        for (int k = 0; k < 9; ++k) sum += std::abs(a(i, k) - b(other[to_size(i)], k));
    }
    EXPECT_NEAR(unlikeness(a, b, other, {}), sum / (30 * 9), 1e-12);
}

TEST(Likeness, WhereTheSurfaceEndsPartnersSayNothing) {
    const LocalForms a = LocalForms::Random(30, 9), b = LocalForms::Random(50, 9);
    std::vector<Index> partners(30);
    std::iota(partners.begin(), partners.end(), 0);
    std::vector<char> ends(50, 0);
    std::fill(ends.begin() + 10, ends.begin() + 30, 1);
    const double of_ten = unlikeness(a.topRows(10), b, std::span(partners).first(10), {});
    EXPECT_NEAR(unlikeness(a, b, partners, ends), of_ten, 1e-12);
    EXPECT_EQ(unlikeness(a, b, partners, std::vector<char>(50, 1)), 0.0);
}

}  // namespace
}  // namespace pointmorph

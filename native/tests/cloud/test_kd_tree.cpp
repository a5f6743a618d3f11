#include "pointmorph/cloud/kd_tree.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <utility>

#include "cloud/moving_tree.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

using Found = std::vector<std::pair<double, Index>>;  // squared distance, row

/// Random points; every fourth on a coarse grid, so that many distances tie.
template <int Dim>
typename KdTree<Dim>::Points random_points(Index count, unsigned seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    typename KdTree<Dim>::Points points(count, Dim);
    for (Index i = 0; i < count; ++i)
        for (int d = 0; d < Dim; ++d) {
            const double x = uniform(random);
            points(i, d) = i % 4 == 0 ? std::round(2.0 * x) / 2.0 : x;
        }
    return points;
}

template <int Dim>
Found brute_force(const typename KdTree<Dim>::Points& points, const double* query, double radius,
                  std::size_t most) {
    Found all;
    for (Index i = 0; i < points.rows(); ++i) {
        double squared_distance = 0.0;
        for (int d = 0; d < Dim; ++d)
            squared_distance += (query[d] - points(i, d)) * (query[d] - points(i, d));
        if (squared_distance < radius * radius) all.emplace_back(squared_distance, i);
    }
    std::ranges::sort(all);
    all.resize(std::min(all.size(), most));
    return all;
}

template <int Dim>
Found nearest(const KdTree<Dim>& tree, const double* query, std::size_t most,
              double radius = std::numeric_limits<double>::infinity()) {
    std::vector<Index> rows(most, -1);
    std::vector<double> squared_distances(most, -1.0);
    const Index count = tree.nearest_within(query, radius, rows, squared_distances);
    Found found;
    for (std::size_t i = 0; i < to_size(count); ++i)
        found.emplace_back(squared_distances[i], rows[i]);
    return found;
}

/// The same rows in the same order; distances up to how sums are rounded. Among points that all
/// coincide with the query any may be there.
void expect_same(const Found& a, const Found& b) {
    ASSERT_EQ(a.size(), b.size());
    const bool crowd = !b.empty() && b.back().first == 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        EXPECT_NEAR(a[i].first, b[i].first, 1e-14 * std::max(1.0, b[i].first));
        if (!crowd) {
            EXPECT_EQ(a[i].second, b[i].second);
        }
    }
}

template <int Dim>
void expect_brute_force() {
    const auto points = random_points<Dim>(500, Dim);
    const auto queries = random_points<Dim>(60, 100 + Dim);
    const KdTree<Dim> tree(points);
    EXPECT_EQ(tree.size(), 500);
    std::vector<std::pair<Index, double>> within, unsorted;
    for (Index q = 0; q < queries.rows() + points.rows(); ++q) {
        const double* query =
            q < queries.rows() ? queries.row(q).data() : points.row(q - queries.rows()).data();
        for (const std::size_t most : {1u, 3u, 8u, 9u, 17u, 18u, 24u, 500u, 600u}) {
            const double all = std::numeric_limits<double>::infinity();
            expect_same(nearest(tree, query, most), brute_force<Dim>(points, query, all, most));
            for (const double radius : {0.3, 0.5, 1.0})  // 0.5 and 1 are distances on the grid
                expect_same(nearest(tree, query, most, radius),
                            brute_force<Dim>(points, query, radius, most));
        }
        for (const double radius : {0.0, 0.3, 0.5, 1.0, 10.0}) {
            tree.within(query, radius, within);
            Found found;
            for (const auto& [row, squared_distance] : within)
                found.emplace_back(squared_distance, row);
            expect_same(found, brute_force<Dim>(points, query, radius, 500));
            tree.within_unsorted(query, radius, unsorted);
            EXPECT_TRUE(std::ranges::is_permutation(unsorted, within));
            EXPECT_EQ(tree.any_within(query, radius), !found.empty());
        }
    }
}

TEST(KdTree, AgreesWithBruteForceInTheDisk) {
    expect_brute_force<2>();
}
TEST(KdTree, AgreesWithBruteForceInSpace) {
    expect_brute_force<3>();
}
TEST(KdTree, GoesOnForTheSamePointsElsewhere) {
    std::optional<KdTree<3>::Points> before = random_points<3>(500, 6);
    std::optional<KdTree<3>> tree(std::in_place, *before);
    const KdTree<3>::Points points = *before;
    const KdTree<3> other(*tree, points);
    tree.reset();
    before.reset();
    EXPECT_EQ(&other.points(), &points);
    EXPECT_EQ(other.size(), 500);
    for (Index i = 0; i < 500; i += 7) {
        const Eigen::RowVector3d query = points.row(i) + Eigen::RowVector3d(0.01, 0.02, -0.01);
        Index nearest;
        double squared;
        other.nearest(query.data(), {&nearest, 1}, {&squared, 1});
        EXPECT_EQ(squared, brute_force<3>(points, query.data(), 10.0, 1).front().first);
    }
}

TEST(KdTree, AgreesWithBruteForceInTheProductSpaces) {
    SKIP_WHERE_WATCHED();
    expect_brute_force<6>();
    expect_brute_force<12>();
    expect_brute_force<32>();
}

/// Halving the box of such points takes next to none of them off at a time.
TEST(KdTree, AgreesWithBruteForceWherePointsGetDenserAndDenser) {
    constexpr Index kCount = 1500;
    Positions p(kCount, 3);
    for (Index i = 0; i < kCount; ++i)
        p.row(i) << std::pow(0.5, 0.4 * i), std::pow(0.5, 0.1 * (i % 50)), i % 3;
    const KdTree<3> tree(p);
    for (Index i = 0; i < kCount; i += 7)
        for (const double radius : {1e-12, 1e-3, 2.0, std::numeric_limits<double>::infinity()})
            expect_same(nearest(tree, p.row(i).data(), 20, radius),
                        brute_force<3>(p, p.row(i).data(), radius, 20));
}

TEST(KdTree, AgreesWithBruteForceWhereHundredsAreAsFarAsTheLastOne) {
    // Whole numbers with the same sum of squares; a few nearer ones, and a crowd at one place.
    std::vector<Eigen::RowVector3d> places;
    constexpr int kReach = 38;
    for (int x = -kReach; x <= kReach; ++x)
        for (int y = -kReach; y <= kReach; ++y)
            for (int z = -kReach; z <= kReach; ++z)
                if (const int squared = x * x + y * y + z * z; squared == 1409 || squared == 3)
                    places.emplace_back(x, y, z);
    ASSERT_GT(places.size(), 300u);
    places.insert(places.end(), 40, Eigen::RowVector3d(50.0, 50.0, 50.0));
    Positions p(to_index(places.size()), 3);
    for (std::size_t i = 0; i < places.size(); ++i) p.row(static_cast<Eigen::Index>(i)) = places[i];
    const KdTree<3> tree(p);
    const Eigen::RowVector3d middle = Eigen::RowVector3d::Zero();
    for (const std::size_t most : {3u, 8u, 12u, 17u, 18u}) {
        for (const double radius : {10.0, 40.0, std::numeric_limits<double>::infinity()})
            expect_same(nearest(tree, middle.data(), most, radius),
                        brute_force<3>(p, middle.data(), radius, most));
        for (const Index i : {0, tree.size() - 1, tree.size() - 60})
            expect_same(nearest(tree, p.row(i).data(), most),
                        brute_force<3>(p, p.row(i).data(), 1e9, most));
    }
}

TEST(KdTree, LargeTreesOfTheProductSpaceAgreeWithBruteForceForAnyThreads) {
    const auto points = random_points<12>(20000, 5);
    const auto queries = random_points<12>(40, 6);
    for (const int threads : {1, 3}) {
        const ThreadCount scope(threads);
        const KdTree<12> tree(points);
        for (Index q = 0; q < queries.rows(); ++q)
            expect_same(nearest(tree, queries.row(q).data(), 9),
                        brute_force<12>(points, queries.row(q).data(), 100.0, 9));
    }
}

TEST(KdTree, OrderOfThePointsMattersOnlyForTies) {
    const Positions p = shapes::cube_noise(1000);
    const auto order = shapes::permutation(1000, 4);
    const Positions shuffled = gather(p, order);
    const KdTree<3> a(p), b(shuffled);
    for (Index i = 0; i < p.rows(); ++i) {
        const auto one = nearest(a, p.row(i).data(), 12), other = nearest(b, p.row(i).data(), 12);
        ASSERT_EQ(one.size(), other.size());
        for (std::size_t n = 0; n < one.size(); ++n)
            EXPECT_EQ(one[n].second, order[to_size(other[n].second)]);
    }
}

TEST(KdTree, CoincidentPointsOfTheProductSpaceAreFoundInNoTime) {
    KdTree<12>::Points p = KdTree<12>::Points::Constant(100000, 12, 0.25);
    p.row(7).setZero();
    const KdTree<12> tree(p);
    const auto from_afar = nearest(tree, p.row(7).data(), 4);
    ASSERT_EQ(from_afar.size(), 4u);
    EXPECT_EQ(from_afar[0], std::pair(0.0, 7));
    for (std::size_t n = 1; n < 4; ++n) EXPECT_EQ(from_afar[n].second, to_index(n - 1));
    for (Index i = 8; i < p.rows(); ++i) {
        const auto found = nearest(tree, p.row(i).data(), 4);
        ASSERT_EQ(found.size(), 4u);
        ASSERT_EQ(found.back().first, 0.0);
    }
}

TEST(KdTree, EmptyTreesAndEmptyQueriesFindNothing) {
    const Positions none(0, 3);
    const Positions one = Positions::Constant(1, 3, 2.0);
    const double query[3] = {0.0, 0.0, 0.0};
    std::vector<std::pair<Index, double>> within{{7, 7.0}};
    for (const Positions& p : {none, one}) {
        const KdTree<3> tree(p);
        EXPECT_EQ(tree.size(), p.rows());
        EXPECT_EQ(nearest(tree, query, 5).size(), to_size(p.rows()));
        EXPECT_TRUE(nearest(tree, query, 0).empty());
        EXPECT_TRUE(nearest(tree, query, 5, 1.0).empty());
        tree.within(query, 1.0, within);
        EXPECT_TRUE(within.empty());
        within.emplace_back(7, 7.0);
        tree.within_unsorted(query, 1.0, within);
        EXPECT_TRUE(within.empty());
    }
}

TEST(KdTree, CoincidentPointsAreFoundByRowAndInNoTime) {
    Positions p = Positions::Constant(100000, 3, 0.25);
    p.row(7).setZero();
    const KdTree<3> tree(p);
    const auto from_afar = nearest(tree, p.row(7).data(), 4);  // ties at another distance than 0
    ASSERT_EQ(from_afar.size(), 4u);
    EXPECT_EQ(from_afar[0], std::pair(0.0, 7));
    for (std::size_t n = 1; n < 4; ++n) EXPECT_EQ(from_afar[n].second, to_index(n - 1));
    // Were each of these to look at all the others, this test would take minutes.
    for (Index i = 0; i < p.rows(); ++i) {
        if (i == 7) continue;
        const auto found = nearest(tree, p.row(i).data(), 4);
        ASSERT_EQ(found.size(), 4u);
        for (const auto& [squared_distance, row] : found) {
            EXPECT_EQ(squared_distance, 0.0);
            EXPECT_NE(row, 7);
        }
    }
}

TEST(KdTree, CanBeMoved) {
    const Positions p = shapes::cube_noise(100), other = shapes::cube_noise(50);
    KdTree<3> tree(p);
    const KdTree<3> moved(std::move(tree));
    expect_same(nearest(moved, p.row(3).data(), 5), brute_force<3>(p, p.row(3).data(), 10.0, 5));
    KdTree<3> assigned(other);
    assigned = KdTree<3>(p);
    EXPECT_EQ(&assigned.points(), &p);
    expect_same(nearest(assigned, p.row(3).data(), 5), brute_force<3>(p, p.row(3).data(), 10.0, 5));
}

/// All rows by distance, ties by row.
Found rows_by_distance(const Positions& positions, const Eigen::RowVector3d& query) {
    Found found;
    for (Index i = 0; i < to_index(positions.rows()); ++i)
        found.emplace_back((positions.row(i) - query).squaredNorm(), i);
    std::ranges::sort(found);
    return found;
}

void expect_nearest_found(const MovingTree& tree, const Positions& positions,
                          const Eigen::RowVector3d& query, double radius) {
    ASSERT_EQ(tree.size(), to_index(positions.rows()));
    const Found all = rows_by_distance(positions, query);
    std::array<Index, 9> rows;
    std::array<double, 9> squared;
    const auto found = to_size(tree.nearest(query.data(), rows, squared));
    ASSERT_EQ(found, std::min(rows.size(), all.size()));
    for (std::size_t k = 0; k < found; ++k) {
        EXPECT_NEAR(squared[k], all[k].first, 1e-15);
        // Of points that all lie at the query, any will do.
        if (all[found - 1].first > 0.0) {
            EXPECT_EQ(rows[k], all[k].second);
        }
    }
    std::vector<std::pair<Index, double>> ball;
    const auto is_odd = [](Index row) { return row % 2 == 1; };
    Index nearest = -1;
    for (const auto& [distance, row] : all)
        if (distance < radius * radius && is_odd(row)) {
            nearest = row;
            break;
        }
    EXPECT_EQ(tree.nearest_of(query.data(), radius, is_odd, ball), nearest);
}

Positions strewn_places(Index count, unsigned seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    Positions places(count, 3);
    for (double& number : places.reshaped()) number = uniform(random);
    return places;
}

void expect_nearest_found(const MovingTree& tree, const Positions& positions) {
    const Positions queries = strewn_places(40, 9);
    for (const double radius : {0.05, 0.3, 3.0})
        for (Index i = 0; i < 40; ++i) {
            expect_nearest_found(tree, positions, queries.row(i), radius);
            expect_nearest_found(tree, positions, positions.row(i % positions.rows()), radius);
        }
}

TEST(MovingTree, FindsWhatIsNearestWhileASheetIsRolledUp) {
    constexpr Index kLasting = 1500;
    const Positions flat = strewn_places(kLasting, 1);
    MovingTree tree(kLasting);
    Progress silent;
    for (int key = 0; key < 6; ++key) {
        // Some points are new each time, in other numbers.
        Positions positions = strewn_places(kLasting + 37 * (key % 3), 20 + unsigned(key));
        const double bend = 0.5 * key;
        for (Index i = 0; i < kLasting; ++i) {
            const double angle = bend * flat(i, 0), radius = bend > 0.0 ? 1.0 / bend : 0.0;
            positions.row(i) << (bend > 0.0 ? radius * std::sin(angle) : flat(i, 0)), flat(i, 1),
                radius * (1.0 - std::cos(angle));
        }
        tree.move(positions, silent);
        expect_nearest_found(tree, positions);
    }
}

TEST(MovingTree, FindsWhatIsNearestWherePointsAreStrewnAnew) {
    MovingTree tree(400);
    Progress silent;
    for (unsigned seed = 1; seed < 5; ++seed) {
        const Positions positions = strewn_places(400, seed);
        tree.move(positions, silent);
        expect_nearest_found(tree, positions);
    }
}

TEST(MovingTree, TellsPointsThatAreAsFarByTheirRow) {
    Positions grid(343, 3);
    for (Index i = 0; i < 343; ++i) grid.row(i) << i % 7, i / 7 % 7, i / 49;
    grid.array() /= 8.0;
    MovingTree tree(300);
    Progress silent;
    for (const double shift : {0.0, 0.25, 0.5}) {
        const Positions positions = grid.array() - shift;
        tree.move(positions, silent);
        expect_nearest_found(tree, positions);
    }
}

TEST(MovingTree, OfFewPointsAndOfCoincidentOnes) {
    Progress silent;
    for (const Index count : {1, 3, 40})
        for (const Index others : {0, 1, 30}) {
            MovingTree tree(count);
            for (const double at : {0.0, 0.3}) {
                const Positions positions = Positions::Constant(count + others, 3, at);
                tree.move(positions, silent);
                expect_nearest_found(tree, positions);
            }
        }
}

TEST(MovingTree, NothingLiesWithinNoRadius) {
    Progress silent;
    MovingTree tree(3);
    tree.move(Positions::Zero(3, 3), silent);
    std::vector<std::pair<Index, double>> ball;
    const Vector3 query = Vector3::Zero();
    const auto all = [](Index) { return true; };
    EXPECT_EQ(tree.nearest_of(query.data(), 0.0, all, ball), -1);
    EXPECT_EQ(tree.nearest_of(query.data(), 1e-9, all, ball), 0);
}

}  // namespace
}  // namespace pointmorph

#include "pointmorph/registration/product_space.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "checks.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

ProductPoints noise(Index count, unsigned seed) {
    const Positions p = shapes::cube_noise(4 * count, seed);
    return Eigen::Map<const ProductPoints>(p.data(), count, 12);
}

Index brute_force(const ProductPoints& points, Index i, const ProductPoints& others) {
    Index best;
    (others.rowwise() - points.row(i)).rowwise().squaredNorm().minCoeff(&best);
    return best;
}

TEST(ProductSpace, RowsHoldBothPlacesAndNormals) {
    const Positions a = shapes::cube_noise(5, 1), b = shapes::cube_noise(5, 2),
                    c = shapes::cube_noise(5, 3), d = shapes::cube_noise(5, 4);
    const ProductPoints p = product_points({a, c}, {b, d}, 0.5);
    ASSERT_EQ(p.rows(), 5);
    for (Index k = 0; k < 5; ++k) {
        EXPECT_EQ(p.row(k).segment<3>(0), a.row(k));
        EXPECT_EQ(p.row(k).segment<3>(3), b.row(k));
        EXPECT_EQ(p.row(k).segment<3>(6), 0.5 * c.row(k));
        EXPECT_EQ(p.row(k).segment<3>(9), 0.5 * d.row(k));
    }
}

TEST(ProductSpace, MatchesAgreeWithBruteForce) {
    const ProductPoints a = noise(300, 1), b = noise(200, 2);
    Progress progress;
    const KdTree<12> tree(b);
    const Matches m = nearest_matches(a, tree, progress);
    for (Index i = 0; i < 300; ++i) {
        const Index j = m.to[to_size(i)];
        EXPECT_EQ(j, brute_force(a, i, b));
        EXPECT_NEAR(m.distances[to_size(i)], (a.row(i) - b.row(j)).norm(), 1e-12);
    }
}

TEST(ProductSpace, AGuessDoesNotChangeTheMatches) {
    const ProductPoints a = noise(300, 1), b = noise(200, 2);
    Progress progress;
    const KdTree<12> tree(b);
    const Matches m = nearest_matches(a, tree, progress);
    Matches guess = m;
    for (std::size_t i = 0; i < guess.to.size(); i += 2) guess.to[i] = 7;
    const Matches again = nearest_matches(a, tree, progress, &guess);
    EXPECT_EQ(again.to, m.to);
    EXPECT_EQ(again.distances, m.distances);
}

TEST(ProductSpace, AGuessDoesNotChangeTheMatchesWherePointsCoincide) {
    ProductPoints b(200, 12);
    b << noise(100, 2), noise(100, 2);
    const ProductPoints a = b.bottomRows(150);
    Progress progress;
    const KdTree<12> tree(b);
    const Matches m = nearest_matches(a, tree, progress);
    Matches guess = m;
    for (Index& to : guess.to) to = (to + 100) % 200;  // its double
    EXPECT_EQ(nearest_matches(a, tree, progress, &guess).to, m.to);
}

TEST(ProductSpace, PairsCoverBothSidesAndKeepFeaturesApart) {
    const ProductPoints a = noise(300, 1), b = noise(200, 2);
    const std::vector<IndexPair> features{{3, 9}, {299, 0}};
    Progress progress;
    const Pairing pairs = mutual_pairs<12>(a, b, features, progress);
    EXPECT_TRUE(checks::is_total(pairs, 300, 200));
    for (const IndexPair& p : pairs)
        for (const IndexPair& f : features) EXPECT_EQ(p.source == f.source, p.target == f.target);
}

TEST(ProductSpace, ASideOfFeaturesAloneStillCoversTheOther) {
    const ProductPoints a = noise(2, 1), b = noise(5, 2);
    const std::vector<IndexPair> features{{0, 1}, {1, 3}};
    Progress progress;
    EXPECT_TRUE(checks::is_total(mutual_pairs<12>(a, b, features, progress), 2, 5));
}

TEST(Example, ProductSpace) {
    const Positions source = shapes::sphere(300), target = shapes::sphere(200);
    const Positions &source_normals = source, &target_normals = target;
    const OrientedView source_image{source, source_normals}, target_image{target, target_normals};
    const std::vector<IndexPair> features{{0, 0}};
    Progress progress;
    // --- example
    const ProductPoints s = product_points(source_image, {source, source_normals}, 0.1);
    const ProductPoints t = product_points({target, target_normals}, target_image, 0.1);
    const Pairing pairs = mutual_pairs<12>(s, t, features, progress);
    // --- end of the example
    EXPECT_TRUE(checks::is_total(pairs, 300, 200));
    for (const auto& [i, j] : pairs) EXPECT_LT((source.row(i) - target.row(j)).norm(), 0.3);
}

}  // namespace
}  // namespace pointmorph

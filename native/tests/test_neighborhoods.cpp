#include "pointmorph/neighborhoods.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "shapes.hpp"

namespace pointmorph {
namespace {

std::vector<Index> brute_force_nearest(const Positions& p, Index i, Index k) {
    std::vector<std::pair<double, Index>> all;
    for (Index j = 0; j < p.rows(); ++j)
        if (j != i) all.emplace_back((p.row(j) - p.row(i)).squaredNorm(), j);
    std::ranges::sort(all);
    std::vector<Index> result;
    for (Index m = 0; m < std::min<Index>(k, static_cast<Index>(all.size())); ++m)
        result.push_back(all[static_cast<std::size_t>(m)].second);
    return result;
}

TEST(Neighborhoods, NearestAgreeWithBruteForce) {
    const Positions p = shapes::cube_noise(700);
    Progress progress;
    const auto found = nearest_neighbors(KdTree<3>(p), 9, progress);
    for (Index i = 0; i < p.rows(); ++i) {
        const auto near = found[i];
        EXPECT_EQ(std::vector<Index>(near.begin(), near.end()), brute_force_nearest(p, i, 9));
    }
}

}  // namespace
}  // namespace pointmorph

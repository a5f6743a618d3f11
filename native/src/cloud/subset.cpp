#include "pointmorph/cloud/subset.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <random>
#include <utility>

namespace pointmorph {

namespace {

/// Points per squared radius and area of a saturated Poisson-disk sampling of the plane.
constexpr double kSaturation = 0.7;

/// The same permutation everywhere, unlike std::shuffle's.
std::vector<Index> permutation(Index count) {
    std::vector<Index> order(to_size(count));
    std::iota(order.begin(), order.end(), 0);
    std::mt19937_64 random(1);
    for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random() % i]);
    return order;
}

/// The nearest drawn point of each point, as far as balls around drawn points tell.
class NearestDrawn {
public:
    explicit NearestDrawn(Index count) : squared_(to_size(count)), rows_(squared_.size()) {}

    void clear() {
        std::ranges::fill(squared_, std::numeric_limits<double>::infinity());
        std::ranges::fill(rows_, kNone);
    }
    void offer(Index point, double squared, Index drawn, bool same_side) {
        Index& row = rows_[to_size(point)];
        double& nearest = squared_[to_size(point)];
        if (!same_side || squared == nearest)
            row = kUnsure;
        else if (squared < nearest && row != kUnsure)
            row = drawn;
        nearest = std::min(nearest, squared);
    }
    /// As places in `drawn`.
    std::vector<Index> places_in(std::span<const Index> drawn) && {
        std::vector<Index> place(rows_.size(), kNone);
        for (std::size_t k = 0; k < drawn.size(); ++k) place[to_size(drawn[k])] = to_index(k);
        for (Index& row : rows_) row = row >= 0 ? place[to_size(row)] : kNone;
        return std::move(rows_);
    }

private:
    static constexpr Index kNone = -1, kUnsure = -2;

    std::vector<double> squared_;
    std::vector<Index> rows_;
};

/// What is drawn from, and in which order.
struct Urn {
    const KdTree<3>& tree;
    const Normals& normals;
    const Neighborhoods* nearest;
    std::span<const Index> required;
    std::vector<Index> order;
};

/// Rows drawn at a given radius; ends early once there are more than `most`. Without known
/// neighbors, `cells` gets all balls.
std::vector<Index> draw(const Urn& urn, double radius, std::size_t most, NearestDrawn* cells,
                        Progress& progress) {
    const auto& [tree, normals, nearest, required, order] = urn;
    std::vector<char> covered(to_size(tree.size()), 0);
    std::vector<std::pair<Index, double>> ball;
    std::vector<Index> rows;
    if (cells) cells->clear();
    const auto take = [&](Index i) {
        rows.push_back(i);
        covered[to_size(i)] = 1;
        // All that is as near is among the nearest where the last of them isn't.
        const auto near = urn.nearest ? (*urn.nearest)[i] : std::span<const Index>();
        const auto squared = [&](Index j) {
            return (urn.tree.points().row(j) - urn.tree.points().row(i)).squaredNorm();
        };
        if (!near.empty() && squared(near.back()) >= radius * radius) {
            for (const Index j : near) {
                if (squared(j) >= radius * radius) break;
                if (urn.normals.row(i).dot(urn.normals.row(j)) > 0.0) covered[to_size(j)] = 1;
            }
            return;
        }
        urn.tree.within_unsorted(urn.tree.points().row(i).data(), radius, ball);
        for (const auto& [j, squared_distance] : ball) {
            const bool same_side = urn.normals.row(i).dot(urn.normals.row(j)) > 0.0;
            if (same_side) covered[to_size(j)] = 1;
            if (cells) cells->offer(j, squared_distance, i, same_side);
        }
    };
    std::vector<char> taken(to_size(tree.size()), 0);
    constexpr std::size_t kPoll = 256;
    for (const Index i : required)
        if (!taken[to_size(i)]) {
            taken[to_size(i)] = 1;
            take(i);
            if (rows.size() % kPoll == 0) progress.report(0.0);
        }
    const std::size_t drawn_from = rows.size();
    for (const Index i : order) {
        if (covered[to_size(i)]) continue;
        take(i);
        if (rows.size() > most) break;
        if (rows.size() % kPoll == 0) progress.report(0.0);
    }
    // What lies close in a cloud in spatial order stays close in memory.
    std::sort(rows.begin() + static_cast<std::ptrdiff_t>(drawn_from), rows.end());
    return rows;
}

constexpr Index kAreaNeighbors = 12;

/// `squared_radius(i)`: of the disk around a point that it has to itself, over π.
template <class SquaredRadius>
double probed_area(const Positions& positions, SquaredRadius&& squared_radius) {
    constexpr Index kProbes = 500;
    const auto count = to_index(positions.rows());
    if (count < 2) return 0.0;
    const Index step = std::max<Index>(1, count / kProbes);
    double sum = 0.0;
    Index probes = 0;
    for (Index i = 0; i < count; i += step, ++probes) sum += std::numbers::pi * squared_radius(i);
    if (sum > 0.0) return sum / probes * count;
    // Many points at each place: something of the right order.
    return (positions.colwise().maxCoeff() - positions.colwise().minCoeff()).squaredNorm();
}

/// About `count` points, of a cloud with that area.
Subset drawn(const Urn& urn, double area, Index count, NearestDrawn* cells, Progress& progress) {
    const Index size = urn.tree.size();
    Subset subset;
    subset.radius = std::sqrt(kSaturation * area / std::max<Index>(1, std::min(count, size)));
    if (size <= count || !(area > 0.0)) {
        constexpr double kCoincident = 1e-9,
                         kSmallest = 1e-150;  // a square that isn't 0
        subset.rows = draw(urn, std::max(kCoincident * std::sqrt(area), kSmallest), to_size(size),
                           cells, progress);
        return subset;
    }
    // The count goes with 1/radius², so that two or three rounds come close. Where points are
    // spaced evenly it leaps, and the radius is sought between one that gives too many and one that
    // gives too few.
    constexpr int kRounds = 9, kExact = 3;
    constexpr double kClose = 0.03, kAfterwards = 0.2;
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    double radius = subset.radius, closest = radius, least_off = kInfinity;
    double too_small = 0.0, too_large = kInfinity;
    for (int round = 0; round < kRounds; ++round) {
        std::vector<Index> rows = draw(urn, radius, to_size(2 * count), cells, progress);
        const double ratio = static_cast<double>(rows.size()) / std::max<Index>(1, count);
        if (std::abs(ratio - 1.0) < (round < kExact ? kClose : kAfterwards))
            return {std::move(rows), radius};
        const double off = std::abs(std::log(ratio));
        if (off < least_off) {
            least_off = off;
            closest = radius;
        }
        (ratio > 1.0 ? too_small : too_large) = radius;
        radius *= std::sqrt(ratio);
        if (radius <= too_small || radius >= too_large) radius = std::sqrt(too_small * too_large);
    }
    return {draw(urn, closest, to_size(size), cells, progress), closest};
}

}  // namespace

double estimated_area(const KdTree<3>& tree) {
    std::vector<Index> near(to_size(std::min<Index>(kAreaNeighbors + 1, tree.size())));
    std::vector<double> squared(near.size());
    return probed_area(tree.points(), [&](Index i) {
        tree.nearest(tree.points().row(i).data(), near, squared);
        return squared.back() / static_cast<double>(near.size() - 1);
    });
}

double estimated_area(const Positions& positions, const Neighborhoods& nearest) {
    return probed_area(positions, [&](Index i) {
        const auto near = nearest[i].first(std::min(to_size(kAreaNeighbors), nearest[i].size()));
        return (positions.row(near.back()) - positions.row(i)).squaredNorm() /
               static_cast<double>(near.size());
    });
}

Subset poisson_disk_subset(const KdTree<3>& tree, const Normals& normals,
                           std::span<const Index> required, Index count, Progress& progress,
                           const Neighborhoods* nearest) {
    const double area = nearest ? estimated_area(tree.points(), *nearest) : estimated_area(tree);
    return drawn({tree, normals, nearest, required, permutation(tree.size())}, area, count, nullptr,
                 progress);
}

SubsetCells poisson_disk_cells(const KdTree<3>& tree, const Normals& normals,
                               std::span<const Index> required, Index count, Progress& progress) {
    NearestDrawn nearest(tree.size());
    SubsetCells result;
    result.subset = drawn({tree, normals, nullptr, required, permutation(tree.size())},
                          estimated_area(tree), count, &nearest, progress);
    result.nearest = std::move(nearest).places_in(result.subset.rows);
    return result;
}

}  // namespace pointmorph

#include "cloud/stray_points.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "base/grouped.hpp"
#include "base/median.hpp"
#include "cloud/apart_neighbors.hpp"
#include "cloud/moments.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

constexpr Index kFewestPoints = 200;  // fewer say little about how far apart they should be
constexpr double kReach = 3.0;        // spacings; random samples of a surface leave no such gap
constexpr double kThinReach = 5.0;    // spacings; those of its thin parts seldom a larger one

/// A shape's points, and what is known of them while the strays among them are looked for.
class Sorting {
public:
    Sorting(const Positions& positions, const Neighborhoods& nearest, Progress& progress)
        : positions_(positions),
          nearest_(nearest),
          progress_(progress),
          own_(local_spacing(positions, nearest)) {}

    std::vector<Index> strays(std::span<const Index> marked);

private:
    double distance(Index i, Index j) const {
        return (positions_.row(i) - positions_.row(j)).norm();
    }
    double few() const {
        constexpr double kFewest = 8.0, kShare = 0.002;
        return std::max(kFewest, kShare * static_cast<double>(nearest_.size()));
    }

    /// Spacing of the samples around a point, whatever its own distance from them: the median over
    /// it and its neighbors. `values` is scratch memory.
    double usual_spacing(Index i, std::vector<double>& values) const;
    /// The least over a point and its neighbors, which is no more than the median.
    Values least_spacing() const;
    void find_usual();
    /// Components of points that are within reach of each other.
    ConnectedComponents near_each_other() const;
    /// Whether each point is on a component large enough, or dense enough, for a part of the shape.
    std::vector<char> on_parts(const ConnectedComponents& components) const;
    /// Adds what is within reach of the points that are on the surface, and so on.
    void spread(std::vector<char>& is_on) const;
    /// Whether a point and those around it lie in a plane: then they are surface, if not quite as
    /// dense as the rest, whose spacing is given.
    bool is_in_plane(Index i, double spacing) const;
    /// Of the points `off` the surface, those that are neither on a loose part nor on a thin one,
    /// such as an antenna.
    std::vector<Index> scattered(std::span<const Index> off, const std::vector<char>& is_on) const;

    const Positions& positions_;
    const Neighborhoods& nearest_;
    Progress& progress_;
    Values own_;    ///< spacing, by a point's neighbors alone
    Values usual_;  ///< of the samples around each point, where there are several components
};

double Sorting::usual_spacing(Index i, std::vector<double>& values) const {
    values.assign(1, own_[i]);
    for (const Index j : nearest_[i]) values.push_back(own_[j]);
    return median(values);
}

Values Sorting::least_spacing() const {
    Values least(own_.size());
    parallel_for(
        nearest_.size(), progress_,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                double lowest = own_[i];
                for (const Index j : nearest_[i]) lowest = std::min(lowest, own_[j]);
                least[i] = lowest;
            }
        },
        0.0, 0.2);
    return least;
}

void Sorting::find_usual() {
    usual_.resize(own_.size());
    parallel_for(
        nearest_.size(), progress_,
        [&](Index begin, Index end) {
            std::vector<double> values;
            for (Index i = begin; i < end; ++i) usual_[i] = usual_spacing(i, values);
        },
        0.4, 0.6);
}

ConnectedComponents Sorting::near_each_other() const {
    GrowingComponents joined(nearest_.size());
    // Bounds of the medians join most points, so that few medians are asked for.
    const Values least = least_spacing();
    std::vector<std::array<Index, 2>> apart;
    each_apart(joined, nearest_, [&](Index i, Index j) {
        if (distance(i, j) <= kReach * std::min(least[i], least[j]))
            joined.join(i, j);
        else
            apart.push_back({i, j});
    });
    progress_.report(0.3);
    std::vector<double> values;
    for (const auto& [i, j] : apart)
        if (!joined.are_joined(i, j) &&
            distance(i, j) <= kReach * std::min(usual_spacing(i, values), usual_spacing(j, values)))
            joined.join(i, j);
    return joined.components();
}

std::vector<char> Sorting::on_parts(const ConnectedComponents& components) const {
    // As find_topology() has it: what it would leave out later is none of the surface here.
    constexpr double kFew = 0.02;    // a share of the points
    constexpr double kSparse = 3.0;  // times the largest component's spacing
    const Grouped<Index> rows(components.count(), [&](auto&& take) {
        for (Index i = 0; i < nearest_.size(); ++i) take(components.label[to_size(i)], i);
    });
    const auto spacing_of = [&](Index component) {
        std::vector<double> values;
        for (const Index i : rows[component]) values.push_back(usual_[i]);
        return median(values);
    };
    const auto& sizes = components.sizes;
    const double usual = spacing_of(to_index(std::ranges::max_element(sizes) - sizes.begin()));
    const auto count = static_cast<double>(nearest_.size());
    std::vector<char> is_on(to_size(nearest_.size()), 0);
    for (Index c = 0; c < components.count(); ++c) {
        const auto size = static_cast<double>(sizes[to_size(c)]);
        if (size < few() || (size < kFew * count && spacing_of(c) > kSparse * usual)) continue;
        for (const Index i : rows[c]) is_on[to_size(i)] = 1;
    }
    return is_on;
}

void Sorting::spread(std::vector<char>& is_on) const {
    const Neighborhoods beside = symmetrized(nearest_);
    std::vector<Index> reached;
    const auto reach_from = [&](Index i) {
        for (const Index j : beside[i])
            if (!is_on[to_size(j)] && distance(i, j) <= kReach * usual_[i]) {
                is_on[to_size(j)] = 1;
                reached.push_back(j);
            }
    };
    for (Index i = 0; i < nearest_.size(); ++i)
        if (is_on[to_size(i)]) reach_from(i);
    for (std::size_t k = 0; k < reached.size(); ++k) reach_from(reached[k]);
}

bool Sorting::is_in_plane(Index i, double spacing) const {
    // Of the distance to the nearest: points scattered in space have more than that, but for 1 in
    // 100 more than 0.5; the pole of a globe of 64 by 32 has 0.05.
    constexpr double kThick = 0.3;
    constexpr double kApart = 10.0;  // spacings; a hundredth of the samples is no surface
    const auto near = nearest_[i];
    if (distance(i, near.front()) > kApart * spacing) return false;
    Moments moments(positions_.row(i).transpose());
    for (const Index j : near) moments.add(positions_.row(j).transpose());
    const Eigen::SelfAdjointEigenSolver<Matrix3> eigen(moments.covariance());
    const Vector3 normal = eigen.eigenvectors().col(0);
    const double height = normal.dot(positions_.row(i).transpose() - moments.mean());
    const double thickness = eigen.eigenvalues()[0] / static_cast<double>(near.size());
    const double most = kThick * distance(i, near.front());
    return height * height + thickness < most * most;
}

std::vector<Index> Sorting::scattered(std::span<const Index> off,
                                      const std::vector<char>& is_on) const {
    // Points: where 1 to 3 % are scattered over a box, one in six has the surface within reach; two
    // in a row are 2 to 6 % of them, three 0 to 1 %. Thin parts have more.
    constexpr Index kChain = 3;
    std::vector<Index> on;
    for (Index i = 0; i < nearest_.size(); ++i)
        if (is_on[to_size(i)]) on.push_back(i);
    const Positions surface = gather(positions_, on);
    const KdTree<3> tree(surface);
    // By the surface's own spacing where it is nearest, as scattered points have a large one.
    Values spacing(static_cast<Eigen::Index>(off.size()));
    std::vector<char> is_beside(off.size());
    parallel_for(
        to_index(off.size()), progress_,
        [&](Index begin, Index end) {
            for (Index k = begin; k < end; ++k) {
                Index foot;
                double squared;
                tree.nearest(positions_.row(off[to_size(k)]).data(), {&foot, 1}, {&squared, 1});
                const double own = usual_[on[to_size(foot)]];
                spacing[k] = own;
                is_beside[to_size(k)] = squared <= kThinReach * own * kThinReach * own;
            }
        },
        0.8, 1.0);
    std::vector<Index> number(to_size(nearest_.size()), -1);
    for (std::size_t k = 0; k < off.size(); ++k) number[to_size(off[k])] = to_index(k);
    GrowingComponents joined(to_index(off.size()));
    for (Index k = 0; k < to_index(off.size()); ++k)
        for (const Index j : nearest_[off[to_size(k)]]) {
            const Index other = number[to_size(j)];
            if (other >= 0 &&
                distance(off[to_size(k)], j) <= kThinReach * std::min(spacing[k], spacing[other]))
                joined.join(k, other);
        }
    const ConnectedComponents clumps = joined.components();
    std::vector<char> is_attached(to_size(clumps.count()), 0);
    for (std::size_t k = 0; k < off.size(); ++k)
        if (is_beside[k]) is_attached[to_size(clumps.label[k])] = 1;
    std::vector<Index> result;
    for (std::size_t k = 0; k < off.size(); ++k) {
        const auto clump = to_size(clumps.label[k]);
        const Index size = clumps.sizes[clump];
        const bool is_thin_part = is_attached[clump] && size >= kChain;
        if (!is_thin_part && size < few() &&
            !is_in_plane(off[k], spacing[static_cast<Eigen::Index>(k)]))
            result.push_back(off[k]);
    }
    return result;
}

std::vector<Index> Sorting::strays(std::span<const Index> marked) {
    const ConnectedComponents components = near_each_other();
    progress_.report(0.4);
    if (components.count() == 1) return {};
    find_usual();
    std::vector<char> is_on = on_parts(components);
    if (std::ranges::find(is_on, 0) == is_on.end()) return {};
    progress_.report(0.7);
    spread(is_on);
    progress_.report(0.8);
    std::vector<Index> off;
    for (Index i = 0; i < nearest_.size(); ++i)
        if (!is_on[to_size(i)]) off.push_back(i);
    if (off.empty() || to_index(off.size()) == nearest_.size()) return {};
    std::vector<Index> result = scattered(off, is_on);
    std::vector<char> is_marked(is_on.size(), 0);
    for (const Index i : marked) is_marked[to_size(i)] = 1;
    std::erase_if(result, [&](Index i) { return is_marked[to_size(i)] != 0; });
    if (static_cast<double>(result.size()) > kMostStrays * static_cast<double>(nearest_.size()))
        return {};
    return result;
}

}  // namespace

std::vector<Index> stray_points(const Positions& positions, const Neighborhoods& nearest,
                                std::span<const Index> marked, Progress& progress) {
    if (nearest.size() < kFewestPoints) return {};
    return Sorting(positions, nearest, progress).strays(marked);
}

}  // namespace pointmorph

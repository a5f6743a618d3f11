#include "pointmorph/registration/components.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <utility>

#include "pointmorph/base/assignment.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "registration/whole.hpp"

namespace pointmorph {

namespace {

/// Rows of every component, strays included.
std::vector<std::vector<Index>> rows_of(const Topology& topology) {
    std::vector<std::vector<Index>> rows(topology.components.size());
    for (std::size_t i = 0; i < topology.labels.size(); ++i)
        rows[to_size(topology.labels[i])].push_back(to_index(i));
    return rows;
}

/// A component as a whole, and the middle of where its points go.
struct MappedWhole {
    Whole whole;
    Eigen::RowVector3d image;
};

std::vector<MappedWhole> wholes_of(const ComponentView& view) {
    std::vector<std::vector<Index>> rows = rows_of(view.topology);
    rows.resize(view.topology.main().size());
    std::vector<MappedWhole> wholes;
    for (const auto& of_one : rows)
        wholes.push_back(
            {whole_of(view.positions, of_one), gather(view.images, of_one).colwise().mean()});
    return wholes;
}

/// How far the proportions of two wholes are apart: root mean square of the logarithms of the
/// ratios of their extents, which are at least a tenth of the longest.
double other_proportions(const Whole& a, const Whole& b) {
    constexpr double kThinnest = 0.1;
    const auto extents = [](const Whole& w) -> Vector3 {
        const Eigen::SelfAdjointEigenSolver<Matrix3> solver(w.covariance, Eigen::EigenvaluesOnly);
        const Vector3 squared =
            solver.eigenvalues().cwiseMax(kThinnest * kThinnest * solver.eigenvalues()[2]);
        return 0.5 * squared.cwiseMax(std::numeric_limits<double>::min()).array().log();
    };
    const Vector3 ratios = extents(a) - extents(b);
    return std::sqrt((ratios.array() - ratios.mean()).square().mean());
}

/// Shares of the points of each component that lie where they go in each of the other shape's
/// components: #components by #components.
Eigen::MatrixXd landing_shares(const ComponentView& here, const ComponentView& there) {
    Eigen::MatrixXd shares =
        Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(here.topology.components.size()),
                              static_cast<Eigen::Index>(there.topology.components.size()));
    const KdTree<3> tree(there.positions);
    for (Eigen::Index i = 0; i < here.images.rows(); ++i) {
        Index nearest;
        double squared;
        tree.nearest(here.images.row(i).data(), {&nearest, 1}, {&squared, 1});
        shares(here.topology.labels[to_size(i)], there.topology.labels[to_size(nearest)]) += 1.0;
    }
    for (Eigen::Index c = 0; c < shares.rows(); ++c)
        shares.row(c) /= std::max(1.0, shares.row(c).sum());
    return shares;
}

std::string counted(Index count, const char* one, const char* more) {
    return std::to_string(count) + " " + (count == 1 ? one : more);
}

Index points_of(const NamedTopology& shape, Index component) {
    return shape.topology.components[to_size(component)].points;
}

/// One shape's side of a matching.
struct Side {
    const ComponentView& here;
    const ComponentView& there;
    Index IndexPair::*row;
    std::span<const Index> alone;
};

/// The group of every component; −1 for those without a counterpart.
std::vector<Index> component_groups(const Topology& topology, std::span<const IndexPair> matched,
                                    Index IndexPair::*side) {
    std::vector<Index> groups(topology.components.size(), -1);
    for (std::size_t k = 0; k < matched.size(); ++k)
        groups[to_size(matched[k].*side)] = to_index(k);
    return groups;
}

/// Whether images crowd where those of `others` are.
class Crowd {
public:
    explicit Crowd(Positions others) : others_(std::move(others)), tree_(others_) {
        std::vector<double> distances;
        const Index step = std::max<Index>(1, tree_.size() / 500);
        for (Index i = 0; i < tree_.size(); i += step) {
            std::array<Index, 2> near{};
            std::array<double, 2> squared{};
            const Index found = tree_.nearest(others_.row(i).data(), near, squared);
            distances.push_back(std::sqrt(squared[to_size(found) - 1]));
        }
        const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
        std::ranges::nth_element(distances, middle);
        constexpr double kSpacings = 2.0;  // nearest neighbors are half a spacing apart
        reach_ = kSpacings * *middle;
    }

    double share(const Positions& images) const {
        Index crowded = 0;
        for (Eigen::Index i = 0; i < images.rows(); ++i)
            crowded += tree_.any_within(images.row(i).data(), reach_) ? 1 : 0;
        return static_cast<double>(crowded) / static_cast<double>(images.rows());
    }

private:
    Positions others_;
    KdTree<3> tree_;
    double reach_ = 0.0;
};

/// The group that most images lie in; −1 where that has none.
Index group_beneath(const Positions& images, const KdTree<3>& there,
                    const std::vector<Index>& groups_there, const Topology& topology) {
    std::map<Index, Index> votes;
    for (Eigen::Index i = 0; i < images.rows(); ++i) {
        Index nearest;
        double squared;
        there.nearest(images.row(i).data(), {&nearest, 1}, {&squared, 1});
        ++votes[groups_there[to_size(topology.labels[to_size(nearest)])]];
    }
    return std::ranges::max_element(votes, {}, &std::pair<const Index, Index>::second)->first;
}

/// Whether hardly any neighbors among `places` have anchors that lie far apart.
bool keep_together(const Positions& places, const Positions& anchors) {
    constexpr double kFar = 4.0;  // times as far as the places, or their spacing
    constexpr double kFew = 0.01;
    const KdTree<3> tree(places);
    const auto count = places.rows();
    std::vector<Index> next(to_size(count));
    Values apart(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        std::array<Index, 4> near{};
        std::array<double, 4> squared{};
        const Index found = tree.nearest(places.row(i).data(), near, squared);
        next[to_size(i)] = near[to_size(found) - 1];
        apart[i] = std::sqrt(squared[to_size(found) - 1]);
    }
    const double spacing = apart.mean();
    Index torn = 0;
    for (Eigen::Index i = 0; i < count; ++i)
        torn += (anchors.row(i) - anchors.row(next[to_size(i)])).norm() >
                kFar * std::max(apart[i], spacing);
    return torn <= kFew * static_cast<double>(count);
}

/// The nearest of some points to each place.
struct NearestPoints {
    std::vector<Index> rows;
    double mean_distance = std::numeric_limits<double>::infinity();
    Index closest = 0;  ///< of all, the nearest to any place
};

NearestPoints nearest_points(const Positions& places, const Positions& points) {
    const KdTree<3> tree(points);
    NearestPoints result;
    double sum = 0.0, least = std::numeric_limits<double>::infinity();
    for (Eigen::Index i = 0; i < places.rows(); ++i) {
        Index nearest;
        double squared;
        tree.nearest(places.row(i).data(), {&nearest, 1}, {&squared, 1});
        result.rows.push_back(nearest);
        sum += std::sqrt(squared);
        if (squared < least) {
            least = squared;
            result.closest = nearest;
        }
    }
    result.mean_distance = sum / static_cast<double>(places.rows());
    return result;
}

/// What components without room can go with.
struct Surroundings {
    const Positions& positions;
    const std::vector<std::vector<Index>>& rows;  ///< of every component
    std::span<const Index> settled;               ///< components that stay
};

/// Gives every row of a component, as its anchor, the nearest point of the component that lies
/// nearest to it as a whole; all of them the same one, where that would tear it.
void anchor(std::span<const Index> rows, const Surroundings& around, GroupedPoints& points) {
    const Positions places = gather(around.positions, rows);
    NearestPoints nearest;
    Index onto = around.settled.front();
    for (const Index component : around.settled) {
        NearestPoints found =
            nearest_points(places, gather(around.positions, around.rows[to_size(component)]));
        if (found.mean_distance >= nearest.mean_distance) continue;
        nearest = std::move(found);
        onto = component;
    }
    const std::vector<Index>& there = around.rows[to_size(onto)];
    const bool holds = keep_together(places, gather(around.positions, gather(there, nearest.rows)));
    for (std::size_t k = 0; k < rows.size(); ++k) {
        const Index at = there[to_size(holds ? nearest.rows[k] : nearest.closest)];
        points.anchors[to_size(rows[k])] = at;
        points.groups[to_size(rows[k])] = points.groups[to_size(at)];
    }
}

/// `vanishing`: components that got anchors, but for strays. `joined`: see ComponentGroups.
GroupedPoints grouped(const Side& side, const ComponentMatching& matching,
                      const ComponentOptions& options, std::vector<Index>& vanishing,
                      std::vector<char>& joined) {
    const ComponentView &here = side.here, &there = side.there;
    const auto rows = rows_of(here.topology);
    std::vector<Index> groups = component_groups(here.topology, matching.matched, side.row);
    const std::vector<Index> groups_there =
        component_groups(there.topology, matching.matched,
                         side.row == &IndexPair::source ? &IndexPair::target : &IndexPair::source);
    std::vector<Index> matched_rows;
    for (std::size_t i = 0; i < here.topology.labels.size(); ++i)
        if (groups[to_size(here.topology.labels[i])] >= 0) matched_rows.push_back(to_index(i));
    const Crowd crowd(gather(here.images, matched_rows));
    const KdTree<3> tree_there(there.positions);
    for (const Index component : side.alone) {
        const Positions images = gather(here.images, rows[to_size(component)]);
        if (crowd.share(images) <= options.crowded)
            groups[to_size(component)] =
                group_beneath(images, tree_there, groups_there, there.topology);
        const Index group = groups[to_size(component)];
        if (group < 0)
            vanishing.push_back(component);
        else
            joined[to_size(group)] = 1;
    }
    GroupedPoints points;
    for (const Index label : here.topology.labels) points.groups.push_back(groups[to_size(label)]);
    points.anchors.assign(points.groups.size(), -1);
    std::vector<Index> settled;
    for (std::size_t c = 0; c < rows.size(); ++c)
        if (groups[c] >= 0 && !rows[c].empty()) settled.push_back(to_index(c));
    for (std::size_t c = 0; c < rows.size(); ++c)
        if (groups[c] < 0 && !rows[c].empty())
            anchor(rows[c], {here.positions, rows, settled}, points);
    return points;
}

}  // namespace

ComponentMatching match_components(const ComponentView& source, const ComponentView& target,
                                   std::span<const IndexPair> marks, const Similarity& alignment,
                                   const ComponentOptions& options) {
    const auto s = wholes_of(source), t = wholes_of(target);
    const auto rows = static_cast<Eigen::Index>(s.size()),
               columns = static_cast<Eigen::Index>(t.size());
    constexpr double kAlone = 0.75, kNever = 2.0, kMarked = -1.0;
    constexpr double kMostly = 0.5;  // where the map says it that clearly, nothing else counts
    const Eigen::MatrixXd agreed =
        (landing_shares(source, target).topLeftCorner(rows, columns).array() *
         landing_shares(target, source).topLeftCorner(columns, rows).transpose().array())
            .sqrt();
    Eigen::MatrixXd costs(rows, columns);
    const double largest = std::log(options.size_ratio);
    for (Eigen::Index i = 0; i < rows; ++i)
        for (Eigen::Index j = 0; j < columns; ++j) {
            const MappedWhole &a = s[to_size(i)], &b = t[to_size(j)];
            const double size = alignment.scale * b.whole.size;  // as large as the source
            const double apart = 0.5 * ((b.image - a.whole.middle).norm() +
                                        alignment.scale * (a.image - b.whole.middle).norm());
            const double distance = apart / (options.distance * (a.whole.size + size));
            const double ratio = std::abs(std::log(a.whole.size / size)) / largest;
            const double other = other_proportions(a.whole, b.whole) / largest;
            const bool may_be = agreed(i, j) >= kMostly || (distance < 1.0 && ratio < 1.0);
            costs(i, j) = may_be ? 0.5 * (1.0 - agreed(i, j) + std::min(1.0, distance) +
                                          std::min(1.0, ratio) + std::min(1.0, other))
                                 : kNever;
        }
    // Nothing else can stand for what both shapes mostly are.
    const auto is_most = [](const ComponentView& view) {
        return 2 * to_size(view.topology.components.front().points) > view.topology.labels.size();
    };
    if (is_most(source) && is_most(target)) {
        costs.row(0).setConstant(kNever);
        costs.col(0).setConstant(kNever);
        costs(0, 0) = 0.0;
    }
    for (const IndexPair& mark : marks) {
        const auto i = source.topology.labels[to_size(mark.source)],
                   j = target.topology.labels[to_size(mark.target)];
        if (i < rows && j < columns) costs(i, j) += kMarked;
    }
    ComponentMatching matching;
    matching.matched = cheapest_pairs(costs, kAlone);
    const auto alone = [&](std::size_t count, Index IndexPair::*side) {
        std::vector<Index> result;
        for (Index i = 0; i < to_index(count); ++i)
            if (std::ranges::find(matching.matched, i, side) == matching.matched.end())
                result.push_back(i);
        return result;
    };
    matching.source_alone = alone(s.size(), &IndexPair::source);
    matching.target_alone = alone(t.size(), &IndexPair::target);
    // Components are numbered by size, but not alike on both sides.
    std::ranges::stable_sort(matching.matched, std::greater<>(), [&](const IndexPair& pair) {
        return source.topology.components[to_size(pair.source)].points +
               target.topology.components[to_size(pair.target)].points;
    });
    return matching;
}

ComponentGroups group_components(const ComponentView& source, const ComponentView& target,
                                 const ComponentMatching& matching,
                                 const ComponentOptions& options) {
    ComponentGroups groups;
    groups.count = to_index(matching.matched.size());
    if (groups.count == 0) return groups;
    groups.joined.assign(to_size(groups.count), 0);
    groups.source = grouped({source, target, &IndexPair::source, matching.source_alone}, matching,
                            options, groups.source_vanishing, groups.joined);
    groups.target = grouped({target, source, &IndexPair::target, matching.target_alone}, matching,
                            options, groups.target_appearing, groups.joined);
    return groups;
}

std::vector<std::string> components_in_words(const ComponentMatching& matching,
                                             const ComponentGroups& groups,
                                             const NamedTopology& source,
                                             const NamedTopology& target) {
    std::vector<std::string> words;
    if (matching.matched.size() > 1) {
        constexpr std::size_t kListed = 4;
        std::string list;
        for (std::size_t k = 0; k < std::min(kListed, matching.matched.size()); ++k)
            list += (k == 0 ? "" : ", ") +
                    std::to_string(points_of(source, matching.matched[k].source)) +
                    " points with " + std::to_string(points_of(target, matching.matched[k].target));
        if (matching.matched.size() > kListed) list += " and so on";
        words.push_back(std::to_string(matching.matched.size()) + " pieces of " + source.name +
                        " and " + target.name +
                        " were matched by position, size and shape: " + list + ".");
    }
    const auto alone = [&](std::span<const Index> components, const NamedTopology& shape,
                           const char* one, const char* more) {
        if (components.empty()) return;
        Index points = 0;
        for (const Index component : components) points += points_of(shape, component);
        const auto count = to_index(components.size());
        words.push_back(counted(count, "piece", "pieces") + " of " + shape.name + " (" +
                        counted(points, "point", "points") + ") " +
                        (count == 1 ? "has no counterpart and " : "have no counterpart and ") +
                        (count == 1 ? one : more) + " the nearest part.");
    };
    alone(groups.source_vanishing, source, "shrinks into", "shrink into");
    alone(groups.target_appearing, target, "grows out of", "grow out of");
    return words;
}

}  // namespace pointmorph

#include "pointmorph/registration/components.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <utility>

#include "pointmorph/base/assignment.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "registration/component_lists.hpp"
#include "registration/whole.hpp"

namespace pointmorph {

namespace {

/// A component as a whole, and the middle of where its points go.
struct MappedWhole {
    Whole whole;
    Eigen::RowVector3d image;
};

std::vector<MappedWhole> mapped_wholes(const ComponentView& view) {
    const std::vector<std::vector<Index>> rows = rows_of(view.topology);
    std::vector<MappedWhole> mapped;
    for (const Whole& whole : wholes_of(view.positions, view.topology, rows))
        mapped.push_back({whole, gather(view.images, rows[mapped.size()]).colwise().mean()});
    return mapped;
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

/// Shares of the points of each main component that lie where they go in each of the other shape's:
/// #main by #main.
Eigen::MatrixXd landing_shares(const ComponentView& here, const ComponentView& there,
                               Progress& progress) {
    const auto rows = static_cast<Eigen::Index>(here.topology.main().size()),
               columns = static_cast<Eigen::Index>(there.topology.main().size());
    Eigen::MatrixXd shares = Eigen::MatrixXd::Zero(rows, columns);
    Eigen::VectorXd points = Eigen::VectorXd::Zero(rows);
    const KdTree<3> tree(there.positions);
    const std::vector<Index> beneath = rows_beneath(here.images, tree, progress);
    for (std::size_t i = 0; i < beneath.size(); ++i) {
        const Index from = here.topology.labels[i], to = there.topology.labels[to_size(beneath[i])];
        if (from >= rows) continue;
        points[from] += 1.0;
        if (to < columns) shares(from, to) += 1.0;
    }
    return points.cwiseMax(1.0).cwiseInverse().asDiagonal() * shares;
}

std::string counted(Index count, const char* one, const char* more) {
    return std::to_string(count) + " " + (count == 1 ? one : more);
}

Index points_of(const NamedTopology& shape, Index component) {
    return shape.topology.components[to_size(component)].points;
}

constexpr double kAlone = 0.75, kNever = 2.0;  // costs: of no counterpart, of one out of reach

/// What main components of both shapes cost as counterparts, and how much larger the source's are:
/// logarithms of the ratios of their sizes, 1 for the largest ratio that counterparts may have.
struct Differences {
    Eigen::MatrixXd costs, larger;
    bool of_most = false;  ///< the first ones are most of both shapes, so that they belong together
};

Differences differences_of(const ComponentView& source, const ComponentView& target,
                           const Similarity& alignment, const ComponentOptions& options,
                           Progress& progress) {
    const auto s = mapped_wholes(source), t = mapped_wholes(target);
    const auto rows = static_cast<Eigen::Index>(s.size()),
               columns = static_cast<Eigen::Index>(t.size());
    constexpr double kMostly = 0.5;  // where the map says it that clearly, nothing else counts
    const Eigen::MatrixXd agreed = (landing_shares(source, target, progress).array() *
                                    landing_shares(target, source, progress).transpose().array())
                                       .sqrt();
    Differences result{Eigen::MatrixXd(rows, columns), Eigen::MatrixXd(rows, columns)};
    Eigen::MatrixXd& costs = result.costs;
    const double largest = std::log(options.size_ratio);
    for (Eigen::Index i = 0; i < rows; ++i)
        for (Eigen::Index j = 0; j < columns; ++j) {
            const MappedWhole &a = s[to_size(i)], &b = t[to_size(j)];
            const double size = alignment.scale * b.whole.size;  // as large as the source
            const double apart = 0.5 * ((b.image - a.whole.middle).norm() +
                                        alignment.scale * (a.image - b.whole.middle).norm());
            const double distance = apart / (options.distance * (a.whole.size + size));
            result.larger(i, j) = std::log(a.whole.size / size) / largest;
            const double ratio = std::abs(result.larger(i, j));
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
    result.of_most = is_most(source) && is_most(target);
    if (result.of_most) {
        costs.row(0).setConstant(kNever);
        costs.col(0).setConstant(kNever);
        costs(0, 0) = 0.0;
    }
    return result;
}

/// Whether two components that a mark joins are counterparts. A shoe that is marked on a figure of
/// one piece isn't that figure's: it is on it.
bool are_counterparts(const Differences& differences, const IndexPair& joined) {
    const auto [i, j] = joined;
    if (differences.of_most && (i == 0) != (j == 0)) return false;
    const double larger = differences.larger(i, j);
    if (std::abs(larger) < 1.0) return true;
    // Much larger than the other, and with a counterpart as large as itself.
    return larger > 0.0 ? !(differences.costs.row(i).array() < kAlone).any()
                        : !(differences.costs.col(j).array() < kAlone).any();
}

/// The costs where marks decide: of counterparts that they join, those that most do, then those
/// that cost least.
Eigen::MatrixXd with_marks(const Differences& differences, std::span<const IndexPair> joined) {
    constexpr double kMark = 1.0, kOfCost = 0.1;
    Eigen::MatrixXd costs = differences.costs;
    for (const IndexPair& pair : joined) {
        if (!are_counterparts(differences, pair)) continue;
        double& cost = costs(pair.source, pair.target);
        if (cost >= 0.0) cost *= kOfCost;
        cost -= kMark;
    }
    return costs;
}

/// See ComponentMatching; those that most marks join first.
std::vector<IndexPair> on_others(const Differences& differences, const ComponentMatching& matching,
                                 std::span<const IndexPair> joined) {
    std::map<std::pair<Index, Index>, Index> marks;
    for (const auto& [i, j] : joined) {
        const bool source_is_alone = std::ranges::binary_search(matching.source_alone, i),
                   target_is_alone = std::ranges::binary_search(matching.target_alone, j);
        const double larger = differences.larger(i, j);
        if (source_is_alone != target_is_alone && (source_is_alone ? larger : -larger) <= 0.0)
            ++marks[{i, j}];
    }
    std::vector<IndexPair> pairs;
    for (const auto& [pair, count] : marks) pairs.push_back({pair.first, pair.second});
    std::ranges::stable_sort(pairs, std::greater<>(), [&](const IndexPair& pair) {
        return marks[{pair.source, pair.target}];
    });
    return pairs;
}

}  // namespace

ComponentMatching match_components(const ComponentView& source, const ComponentView& target,
                                   std::span<const IndexPair> marks, const Similarity& alignment,
                                   const ComponentOptions& options, Progress& progress) {
    const Differences differences = differences_of(source, target, alignment, options, progress);
    std::vector<IndexPair> joined;
    for (const IndexPair& mark : marks)
        joined.push_back({source.topology.labels[to_size(mark.source)],
                          target.topology.labels[to_size(mark.target)]});
    std::erase_if(joined, [&](const IndexPair& pair) {  // strays
        return pair.source >= differences.costs.rows() || pair.target >= differences.costs.cols();
    });
    ComponentMatching matching;
    matching.matched = cheapest_pairs(with_marks(differences, joined), kAlone);
    const auto alone = [&](Eigen::Index count, Index IndexPair::*side) {
        std::vector<Index> result;
        for (Index i = 0; i < to_index(count); ++i)
            if (std::ranges::find(matching.matched, i, side) == matching.matched.end())
                result.push_back(i);
        return result;
    };
    matching.source_alone = alone(differences.costs.rows(), &IndexPair::source);
    matching.target_alone = alone(differences.costs.cols(), &IndexPair::target);
    matching.on_others = on_others(differences, matching, joined);
    sort_by_points(matching.matched, source.topology, target.topology);
    return matching;
}

namespace {

/// Main components that are alone, but for those that marks put on others.
std::vector<Index> rest_of(const ComponentMatching& matching, const std::vector<Index>& alone,
                           Index IndexPair::*side) {
    std::vector<Index> rest;
    std::ranges::copy_if(alone, std::back_inserter(rest), [&](Index component) {
        return std::ranges::find(matching.on_others, component, side) == matching.on_others.end();
    });
    return rest;
}

/// Some components as one; all others are strays.
Topology as_one(const Topology& topology, std::span<const Index> components) {
    Topology one{{}, {Component{}, Component{}}, 1};
    for (const Index label : topology.labels) {
        const Index is_other = std::ranges::binary_search(components, label) ? 0 : 1;
        one.labels.push_back(is_other);
        ++one.components[to_size(is_other)].points;
    }
    return one;
}

}  // namespace

void match_rest(ComponentMatching& matching, const ComponentView& source,
                const ComponentView& target, const Similarity& alignment,
                const ComponentOptions& options, Progress& progress) {
    std::vector<Index> of_source = rest_of(matching, matching.source_alone, &IndexPair::source),
                       of_target = rest_of(matching, matching.target_alone, &IndexPair::target);
    if (of_source.empty() || of_target.empty()) return;
    const Topology s = as_one(source.topology, of_source), t = as_one(target.topology, of_target);
    const auto is_little = [&](const Topology& one) {
        return one.components.front().points <
               options.rest_share * static_cast<double>(one.labels.size());
    };
    if (is_little(s) || is_little(t)) return;
    const Differences differences = differences_of(
        {s, source.positions, source.normals, source.images},
        {t, target.positions, target.normals, target.images}, alignment, options, progress);
    if (differences.costs(0, 0) > options.rest_cost) return;
    const auto largest = [](const std::vector<Index>& components, const Topology& topology) {
        return *std::ranges::max_element(
            components, {}, [&](Index c) { return topology.components[to_size(c)].points; });
    };
    matching.matched.push_back(
        {largest(of_source, source.topology), largest(of_target, target.topology)});
    matching.source_rest = std::move(of_source);
    matching.target_rest = std::move(of_target);
}

std::vector<IndexPair> joining_marks(std::span<const Feature> features) {
    const auto middle = [](const Marked& marked) { return marked.rows[marked.rows.size() / 2]; };
    std::vector<IndexPair> marks;
    for (const Feature& feature : features)
        marks.push_back({middle(feature.source), middle(feature.target)});
    return marks;
}

namespace {

/// Of pieces that can't go onto their counterparts without tears or folds; empty if all can.
std::string differences_in_words(std::span<const IndexPair> matched, const NamedTopology& source,
                                 const NamedTopology& target) {
    const auto component = [](const NamedTopology& shape, Index number) -> const Component& {
        return shape.topology.components[to_size(number)];
    };
    Index count = 0;
    std::string first;
    for (const IndexPair& pair : matched) {
        const Component &s = component(source, pair.source), &t = component(target, pair.target);
        if (!differ(s, t) || count++ > 0) continue;
        first = "in " + source.name + " " + in_words(s) + ", in " + target.name + " " + in_words(t);
    }
    if (count == 0) return "";
    return (count == 1 ? "A piece isn't like its counterpart ("
                       : std::to_string(count) + " pieces aren't like their counterparts (first ") +
           first + "): there the surface tears or folds during the morph.";
}

}  // namespace

std::vector<std::string> components_in_words(const ComponentMatching& matching,
                                             const ComponentGroups& groups,
                                             const NamedTopology& source,
                                             const NamedTopology& target) {
    std::vector<std::string> words;
    std::vector<IndexPair> plain;
    for (std::size_t g = 0; g < matching.matched.size(); ++g)
        if (groups.kind(g) == GroupKind::kPlain) plain.push_back(matching.matched[g]);
    const auto of_rest = to_index(matching.source_rest.size());
    if (of_rest > 0) plain.pop_back();  // the last match
    if (plain.size() > 1) {
        words.push_back(std::to_string(plain.size()) + " pieces of " + source.name + " and " +
                        target.name +
                        " were matched by position, size and shape. If one goes to the wrong "
                        "piece, mark a feature on both.");
    }
    const std::string difference = differences_in_words(plain, source, target);
    if (!difference.empty()) words.push_back(difference);
    if (of_rest > 0)
        words.push_back("What is left of both becomes one another as a whole: " +
                        counted(of_rest, "piece", "pieces") + " of " + source.name + " and " +
                        std::to_string(matching.target_rest.size()) + " of " + target.name + ".");
    const auto alone = [&](std::span<const Index> components, const NamedTopology& shape,
                           const char* one, const char* more) {
        if (components.empty()) return;
        Index points = 0;
        for (const Index component : components) points += points_of(shape, component);
        const auto count = to_index(components.size());
        const double share =
            static_cast<double>(points) / static_cast<double>(shape.topology.labels.size());
        const auto percents = std::lround(100.0 * share);
        words.push_back(counted(count, "piece", "pieces") + " of " + shape.name + " (" +
                        (percents > 0 ? std::to_string(percents) : "under 1") + " % of it) " +
                        (count == 1 ? "has no counterpart and " : "have no counterpart and ") +
                        (count == 1 ? one : more) + " the nearest part.");
    };
    alone(groups.source_vanishing, source, "shrinks into", "shrink into");
    alone(groups.target_appearing, target, "grows out of", "grow out of");
    return words;
}

}  // namespace pointmorph

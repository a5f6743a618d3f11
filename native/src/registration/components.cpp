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

/// The row of `there` nearest to each image.
std::vector<Index> rows_beneath(const Positions& images, const KdTree<3>& there,
                                Progress& progress) {
    std::vector<Index> rows(to_size(images.rows()));
    parallel_for(to_index(images.rows()), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            double squared;
            there.nearest(images.row(i).data(), {&rows[to_size(i)], 1}, {&squared, 1});
        }
    });
    return rows;
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

/// The group that most of the rows beneath are in; −1 where they have none.
Index group_beneath(std::span<const Index> beneath, const std::vector<Index>& groups_there,
                    const Topology& topology) {
    std::map<Index, Index> votes;
    for (const Index row : beneath) ++votes[groups_there[to_size(topology.labels[to_size(row)])]];
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

/// Components that stay where their group is, each with a tree, for those that go with them.
class Surroundings {
public:
    Surroundings(const Positions& positions, const std::vector<std::vector<Index>>& rows,
                 std::span<const Index> groups)
        : rows_(rows) {
        for (std::size_t c = 0; c < rows.size(); ++c) {
            if (groups[c] < 0 || rows[c].empty()) continue;
            components_.push_back(to_index(c));
            auto& points =
                points_.emplace_back(std::make_unique<Positions>(gather(positions, rows[c])));
            trees_.emplace_back(*points);
            boxes_.emplace_back(points->colwise().minCoeff().transpose(),
                                points->colwise().maxCoeff().transpose());
        }
    }

    /// The nearest row to each place, all of the component that is nearest to them as a whole; or
    /// just the one that is nearest to any, where the others would tear them apart.
    std::vector<Index> beside(const Positions& places) const {
        const Eigen::AlignedBox3d box(places.colwise().minCoeff().transpose(),
                                      places.colwise().maxCoeff().transpose());
        Nearest best;
        for (std::size_t k = 0; k < components_.size(); ++k) {
            if (box.exteriorDistance(boxes_[k]) >= best.mean_distance) continue;
            Nearest found = nearest(places, trees_[k]);
            if (found.mean_distance >= best.mean_distance) continue;
            best = std::move(found);
            best.component = k;
        }
        if (!keep_together(places, gather(*points_[best.component], best.places)))
            std::ranges::fill(best.places, best.closest);
        return gather(rows_[to_size(components_[best.component])], best.places);
    }

private:
    struct Nearest {
        std::vector<Index> places{};  ///< in the component
        double mean_distance = std::numeric_limits<double>::infinity();
        Index closest = 0;  ///< the one that is nearest to any
        std::size_t component = 0;
    };

    static Nearest nearest(const Positions& places, const KdTree<3>& tree) {
        Nearest result;
        double sum = 0.0, least = std::numeric_limits<double>::infinity();
        for (Eigen::Index i = 0; i < places.rows(); ++i) {
            Index place;
            double squared;
            tree.nearest(places.row(i).data(), {&place, 1}, {&squared, 1});
            result.places.push_back(place);
            sum += std::sqrt(squared);
            if (squared >= least) continue;
            least = squared;
            result.closest = place;
        }
        result.mean_distance = sum / static_cast<double>(places.rows());
        return result;
    }

    const std::vector<std::vector<Index>>& rows_;
    std::vector<Index> components_;
    std::vector<std::unique_ptr<Positions>> points_;
    std::vector<KdTree<3>> trees_;
    std::vector<Eigen::AlignedBox3d> boxes_;
};

/// One shape's side of a matching.
struct Side {
    const ComponentView& here;
    const ComponentView& there;
    Index IndexPair::*row, IndexPair::*other_row;
};

/// `vanishing`: components that got anchors, but for strays. `joined`: see ComponentGroups.
GroupedPoints grouped(const Side& side, const ComponentMatching& matching,
                      const ComponentOptions& options, std::vector<Index>& vanishing,
                      std::vector<char>& joined, Progress& progress) {
    const ComponentView &here = side.here, &there = side.there;
    const auto rows = rows_of(here.topology);
    const auto main = to_index(here.topology.main().size());
    std::vector<Index> groups = component_groups(here.topology, matching.matched, side.row);
    const std::vector<Index> groups_there =
        component_groups(there.topology, matching.matched, side.other_row);
    std::vector<Index> matched_rows, alone;
    for (std::size_t i = 0; i < here.topology.labels.size(); ++i)
        if (groups[to_size(here.topology.labels[i])] >= 0) matched_rows.push_back(to_index(i));
    for (std::size_t c = 0; c < rows.size(); ++c)
        if (groups[c] < 0 && !rows[c].empty()) alone.push_back(to_index(c));
    const Crowd crowd(gather(here.images, matched_rows));
    const KdTree<3> tree_there(there.positions);
    for (const Index component : alone) {
        const Positions images = gather(here.images, rows[to_size(component)]);
        Index& group = groups[to_size(component)];
        const auto marked = std::ranges::find(matching.on_others, component, side.row);
        if (marked != matching.on_others.end())
            group = groups_there[to_size((*marked).*side.other_row)];
        else if (crowd.share(images) <= options.crowded)
            group = group_beneath(rows_beneath(images, tree_there, progress), groups_there,
                                  there.topology);
        if (component >= main) continue;
        if (group < 0)
            vanishing.push_back(component);
        else
            joined[to_size(group)] = 1;
    }
    GroupedPoints points;
    for (const Index label : here.topology.labels) points.groups.push_back(groups[to_size(label)]);
    points.anchors.assign(points.groups.size(), -1);
    const Surroundings around(here.positions, rows, groups);
    for (const Index component : alone) {
        if (groups[to_size(component)] >= 0) continue;
        progress.throw_if_cancelled();
        const auto& own = rows[to_size(component)];
        const std::vector<Index> beside = around.beside(gather(here.positions, own));
        for (std::size_t k = 0; k < own.size(); ++k) {
            points.anchors[to_size(own[k])] = beside[k];
            points.groups[to_size(own[k])] = points.groups[to_size(beside[k])];
        }
        if (component < main) points.loose.insert(points.loose.end(), own.begin(), own.end());
    }
    std::ranges::sort(points.loose);
    return points;
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

std::vector<IndexPair> joining_marks(std::span<const Feature> features) {
    const auto middle = [](const Marked& marked) { return marked.rows[marked.rows.size() / 2]; };
    std::vector<IndexPair> marks;
    for (const Feature& feature : features)
        marks.push_back({middle(feature.source), middle(feature.target)});
    return marks;
}

ComponentGroups group_components(const ComponentView& source, const ComponentView& target,
                                 const ComponentMatching& matching, const ComponentOptions& options,
                                 Progress& progress) {
    ComponentGroups groups;
    groups.count = to_index(matching.matched.size());
    if (groups.count == 0) return groups;
    groups.matched = matching.matched;
    groups.joined.assign(to_size(groups.count), 0);
    groups.source = grouped({source, target, &IndexPair::source, &IndexPair::target}, matching,
                            options, groups.source_vanishing, groups.joined, progress);
    groups.target = grouped({target, source, &IndexPair::target, &IndexPair::source}, matching,
                            options, groups.target_appearing, groups.joined, progress);
    return groups;
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
    if (plain.size() > 1) {
        words.push_back(std::to_string(plain.size()) + " pieces of " + source.name + " and " +
                        target.name +
                        " were matched by position, size and shape. If one goes to the wrong "
                        "piece, mark a feature on both.");
    }
    const std::string difference = differences_in_words(plain, source, target);
    if (!difference.empty()) words.push_back(difference);
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

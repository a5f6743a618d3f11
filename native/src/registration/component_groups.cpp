#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <utility>

#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/components.hpp"
#include "registration/component_lists.hpp"

namespace pointmorph {

namespace {

/// The group of every component; −1 for those without a counterpart.
std::vector<Index> groups_of_components(const Topology& topology, const ComponentMatching& matching,
                                        Index IndexPair::*side) {
    const std::vector<IndexPair>& matched = matching.matched;
    std::vector<Index> groups(topology.components.size(), -1);
    for (std::size_t k = 0; k < matched.size(); ++k)
        groups[to_size(matched[k].*side)] = to_index(k);
    const bool is_source = side == &IndexPair::source;
    for (const Index component : is_source ? matching.source_rest : matching.target_rest)
        groups[to_size(component)] = to_index(matched.size()) - 1;
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
    std::vector<Index> groups = groups_of_components(here.topology, matching, side.row);
    const std::vector<Index> groups_there =
        groups_of_components(there.topology, matching, side.other_row);
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

}  // namespace

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

}  // namespace pointmorph

#include "pointmorph/registration/components.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "pointmorph/base/assignment.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "pointmorph/registration/product_space.hpp"
#include "pointmorph/surface/projection.hpp"

namespace pointmorph {

namespace {

/// A component as a whole: its middle, its size, and where its points go on the whole.
struct Whole {
    Eigen::RowVector3d middle = Eigen::RowVector3d::Zero(), image = Eigen::RowVector3d::Zero();
    double size = 0.0;
};

Whole whole_of(const Positions& positions, const Positions& images, std::span<const Index> rows) {
    Whole whole;
    for (const Index i : rows) {
        whole.middle += positions.row(i);
        whole.image += images.row(i);
    }
    const auto count = static_cast<double>(rows.size());
    whole.middle /= count;
    whole.image /= count;
    for (const Index i : rows) whole.size += (positions.row(i) - whole.middle).squaredNorm();
    whole.size = std::sqrt(whole.size / count);
    return whole;
}

std::vector<std::vector<Index>> rows_of(const Topology& topology) {
    std::vector<std::vector<Index>> rows(topology.main().size());
    for (std::size_t i = 0; i < topology.labels.size(); ++i)
        if (to_size(topology.labels[i]) < rows.size())
            rows[to_size(topology.labels[i])].push_back(to_index(i));
    return rows;
}

std::vector<Whole> wholes_of(const ComponentView& view) {
    std::vector<Whole> wholes;
    for (const auto& rows : rows_of(view.topology))
        wholes.push_back(whole_of(view.positions, view.images, rows));
    return wholes;
}

std::string counted(Index count, const char* one, const char* more) {
    return std::to_string(count) + " " + (count == 1 ? one : more);
}

/// Columns of the product space that hold where points of a shape go and where they are.
struct ProductColumns {
    Eigen::Index image, own, image_normal, own_normal;
};

/// A map between the shapes: whose points it takes, and to which.
struct Direction {
    ProductColumns columns;
    Marked Feature::*marked_here, Feature::*marked_there;
    Index IndexPair::*here, IndexPair::*there;
};
constexpr Direction kForward{.columns = {.image = 0, .own = 3, .image_normal = 6, .own_normal = 9},
                             .marked_here = &Feature::source,
                             .marked_there = &Feature::target,
                             .here = &IndexPair::source,
                             .there = &IndexPair::target};
constexpr Direction kBackward{.columns = {.image = 3, .own = 0, .image_normal = 9, .own_normal = 6},
                              .marked_here = &Feature::target,
                              .marked_there = &Feature::source,
                              .here = &IndexPair::target,
                              .there = &IndexPair::source};

/// Points of the product space, those of each region moved and scaled onto its counterpart: there
/// both shapes lie alike.
ProductPoints brought_over(ProductPoints points, const ProductPoints& others,
                           std::span<const Feature> regions, const Direction& map) {
    const auto& [image, own, image_normal, own_normal] = map.columns;
    const Positions from = points.middleCols<3>(own), to = others.middleCols<3>(image);
    for (const Feature& region : regions) {
        const Whole a = whole_of(from, from, (region.*map.marked_here).rows);
        const Whole b = whole_of(to, to, (region.*map.marked_there).rows);
        const double scale = a.size > 0.0 ? b.size / a.size : 1.0;
        for (const Index i : (region.*map.marked_here).rows) {
            points.block<1, 3>(i, image) = b.middle + scale * (from.row(i) - a.middle);
            points.block<1, 3>(i, image_normal) = points.block<1, 3>(i, own_normal);
        }
    }
    return points;
}

/// Which region every point belongs to, counted from 1; 0 for none.
std::vector<Index> groups_of(Eigen::Index points, std::span<const Feature> regions,
                             Marked Feature::*side) {
    std::vector<Index> groups(to_size(points), 0);
    for (std::size_t k = 0; k < regions.size(); ++k)
        for (const Index i : (regions[k].*side).rows) groups[to_size(i)] = to_index(k) + 1;
    return groups;
}

/// Groups of the points of both shapes.
struct Groups {
    std::vector<Index> source, target;
};

std::vector<Index> rows_in(const std::vector<Index>& groups, Index group) {
    std::vector<Index> rows;
    for (std::size_t i = 0; i < groups.size(); ++i)
        if (groups[i] == group) rows.push_back(to_index(i));
    return rows;
}

/// Pairs points within each of `count` groups, and those that are pinned.
Pairing paired_by_group(const ProductPoints& source, const ProductPoints& target,
                        const Groups& groups, Index count, std::span<const IndexPair> pinned,
                        Progress& progress) {
    Pairing pairs(pinned.begin(), pinned.end());
    for (Index g = 0; g < count; ++g) {
        const auto s = rows_in(groups.source, g), t = rows_in(groups.target, g);
        std::vector<IndexPair> features;  // places in these
        for (const IndexPair& f : pinned)
            if (groups.source[to_size(f.source)] == g && groups.target[to_size(f.target)] == g)
                features.push_back({to_index(std::ranges::lower_bound(s, f.source) - s.begin()),
                                    to_index(std::ranges::lower_bound(t, f.target) - t.begin())});
        for (const IndexPair& pair :
             mutual_pairs<12>(gather(source, s), gather(target, t), features, progress))
            pairs.push_back({s[to_size(pair.source)], t[to_size(pair.target)]});
    }
    std::ranges::sort(pairs);
    pairs.erase(std::ranges::unique(pairs).begin(), pairs.end());
    return pairs;
}

/// Points of a region, and those whose partners in `before` were taken from them.
std::vector<Index> astray(const std::vector<Index>& own, const std::vector<Index>& other,
                          const Pairing& before, std::span<const IndexPair> pinned,
                          const Direction& map) {
    std::vector<char> is_astray(own.size());
    for (std::size_t i = 0; i < own.size(); ++i) is_astray[i] = own[i] > 0;
    for (const IndexPair& pair : before)
        if (own[to_size(pair.*map.here)] != other[to_size(pair.*map.there)])
            is_astray[to_size(pair.*map.here)] = 1;
    for (const IndexPair& pair : pinned) is_astray[to_size(pair.*map.here)] = 0;
    std::vector<Index> rows;
    for (std::size_t i = 0; i < is_astray.size(); ++i)
        if (is_astray[i]) rows.push_back(to_index(i));
    return rows;
}

/// The `images` with those in `rows` put onto the other shape, from where they were `moved` to,
/// beside the nearest of their partners.
Positions put_back(Positions images, const std::vector<Index>& rows, const Positions& moved,
                   const Pairing& pairs, const ComponentView& other, const Direction& map,
                   Progress& progress) {
    std::vector<Index> nearest(to_size(images.rows()), -1);
    for (const IndexPair& pair : pairs) {
        Index& best = nearest[to_size(pair.*map.here)];
        const auto squared = [&](Index j) {
            return (other.positions.row(j) - moved.row(pair.*map.here)).squaredNorm();
        };
        if (best < 0 || squared(pair.*map.there) < squared(best)) best = pair.*map.there;
    }
    const KdTree<3> tree(other.positions);
    const Positions put = project_onto_surface(gather(moved, rows), gather(nearest, rows), tree,
                                               other.normals, progress);
    for (std::size_t k = 0; k < rows.size(); ++k)
        images.row(rows[k]) = put.row(static_cast<Eigen::Index>(k));
    return images;
}

Index points_of(const NamedTopology& shape, Index component) {
    return shape.topology.components[to_size(component)].points;
}

}  // namespace

ComponentMatching match_components(const ComponentView& source, const ComponentView& target,
                                   const Similarity& alignment, const ComponentOptions& options) {
    const auto s = wholes_of(source), t = wholes_of(target);
    const auto rows = static_cast<Eigen::Index>(s.size()),
               columns = static_cast<Eigen::Index>(t.size());
    constexpr double kAlone = 1.0;
    Eigen::MatrixXd costs(rows, columns);
    for (Eigen::Index i = 0; i < rows; ++i)
        for (Eigen::Index j = 0; j < columns; ++j) {
            const Whole &a = s[to_size(i)], &b = t[to_size(j)];
            const double size = alignment.scale * b.size;  // as large as the source
            const double apart =
                0.5 * ((b.image - a.middle).norm() + alignment.scale * (a.image - b.middle).norm());
            const double distance = apart / (options.distance * (a.size + size));
            const double ratio = std::abs(std::log(a.size / size)) / std::log(options.size_ratio);
            costs(i, j) = distance < 1.0 && ratio < 1.0 ? 0.5 * (distance + ratio) : 2.0 * kAlone;
        }
    // Nothing else can stand for what both shapes mostly are.
    const auto is_most = [](const ComponentView& view) {
        return 2 * to_size(view.topology.components.front().points) > view.topology.labels.size();
    };
    if (is_most(source) && is_most(target)) {
        costs.row(0).setConstant(2.0 * kAlone);
        costs.col(0).setConstant(2.0 * kAlone);
        costs(0, 0) = 0.0;
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

std::vector<Feature> component_regions(const Topology& source, const Topology& target,
                                       std::span<const IndexPair> matched, Index most) {
    const auto source_rows = rows_of(source), target_rows = rows_of(target);
    std::vector<Feature> regions;
    for (std::size_t k = 1; k < matched.size() && k <= to_size(most); ++k)
        regions.push_back({"piece " + std::to_string(k + 1), FeatureKind::kRegion,
                           Marked{source_rows[to_size(matched[k].source)], {}},
                           Marked{target_rows[to_size(matched[k].target)], {}}});
    return regions;
}

RefinementStart component_start(const ComponentView& source, const ComponentView& target,
                                std::span<const Feature> regions, const Similarity& alignment,
                                const ComponentOptions& options) {
    RefinementStart start{source.images, target.images};
    const auto move = [&](const ComponentView& from, const Positions& to, Marked Feature::*here,
                          Marked Feature::*there, const Matrix3& rotation, Positions& images) {
        for (const Feature& region : regions) {
            const auto& rows = (region.*here).rows;
            if (static_cast<double>(rows.size()) >
                options.small_share * static_cast<double>(from.positions.rows()))
                continue;
            const Whole own = whole_of(from.positions, from.images, rows);
            const Whole other = whole_of(to, to, (region.*there).rows);
            const double scale = own.size > 0.0 ? other.size / own.size : 1.0;
            for (const Index i : rows)
                images.row(i) = other.middle +
                                scale * (from.positions.row(i) - own.middle) * rotation.transpose();
        }
    };
    move(source, target.positions, &Feature::source, &Feature::target,
         alignment.rotation.transpose(), start.source_images);
    move(target, source.positions, &Feature::target, &Feature::source, alignment.rotation,
         start.target_images);
    return start;
}

bool are_small(std::span<const Feature> regions, Index source_size, Index target_size,
               const ComponentOptions& options) {
    return std::ranges::all_of(regions, [&](const Feature& region) {
        const auto share = [](const Marked& marked, Index size) {
            return static_cast<double>(marked.rows.size()) / size;
        };
        return std::max(share(region.source, source_size), share(region.target, target_size)) <=
               options.small_share;
    });
}

Refinement kept_apart(const Refinement& map, const ComponentView& source,
                      const ComponentView& target, const ComponentMarks& marks,
                      const ComponentOptions& options, Progress& progress) {
    const auto& [regions, pinned] = marks;
    Refinement result = map;
    result.source_product = brought_over(map.source_product, map.target_product, regions, kForward);
    result.target_product =
        brought_over(map.target_product, map.source_product, regions, kBackward);
    const Groups groups{groups_of(source.positions.rows(), regions, &Feature::source),
                        groups_of(target.positions.rows(), regions, &Feature::target)};
    result.pairs = paired_by_group(result.source_product, result.target_product, groups,
                                   to_index(regions.size()) + 1, pinned, progress);

    const RefinementStart wholes = component_start(source, target, regions, map.alignment, options);
    result.source_images =
        put_back(source.images, astray(groups.source, groups.target, map.pairs, pinned, kForward),
                 wholes.source_images, result.pairs, target, kForward, progress);
    result.target_images =
        put_back(target.images, astray(groups.target, groups.source, map.pairs, pinned, kBackward),
                 wholes.target_images, result.pairs, source, kBackward, progress);
    return result;
}

std::vector<std::string> components_in_words(const ComponentMatching& matching,
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
                        " and " + target.name + " were matched by position and size: " + list +
                        ".");
    }
    const auto alone = [&](std::span<const Index> components, const NamedTopology& shape) {
        if (components.empty()) return;
        Index points = 0;
        for (const Index component : components) points += points_of(shape, component);
        const auto count = to_index(components.size());
        words.push_back(
            counted(count, "piece", "pieces") + " of " + shape.name + " (" +
            counted(points, "point", "points") +
            (count == 1 ? ") has no counterpart and was" : ") have no counterpart and were") +
            " joined to the nearest part.");
    };
    alone(matching.source_alone, source);
    alone(matching.target_alone, target);
    return words;
}

}  // namespace pointmorph

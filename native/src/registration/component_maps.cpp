#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "base/quietly.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/components.hpp"
#include "pointmorph/registration/product_space.hpp"
#include "pointmorph/surface/projection.hpp"
#include "registration/marks.hpp"
#include "registration/whole.hpp"

namespace pointmorph {

namespace {

/// Columns of the product space that hold where points of a shape go and where they are.
struct ProductColumns {
    Eigen::Index image, own, image_normal, own_normal;
};
constexpr ProductColumns kSourceColumns{.image = 0, .own = 3, .image_normal = 6, .own_normal = 9};
constexpr ProductColumns kTargetColumns{.image = 3, .own = 0, .image_normal = 9, .own_normal = 6};

/// A map between the shapes: whose points it takes, and to which.
struct GroupDirection {
    ProductColumns columns;
    Index IndexPair::*here, IndexPair::*there;
};
constexpr GroupDirection kForward{
    .columns = kSourceColumns, .here = &IndexPair::source, .there = &IndexPair::target};
constexpr GroupDirection kBackward{
    .columns = kTargetColumns, .here = &IndexPair::target, .there = &IndexPair::source};

/// From the given coordinates of both shapes into the product space, and what normals weigh there.
struct Frame {
    Similarity of_source, of_target;
    double normal_weight;
    bool inside_out;
};

Frame frame_of(const Refinement& map, const Positions& source) {
    const Positions own = map.source_product.middleCols<3>(kSourceColumns.own);
    const Similarity of_source = fit_similarity(source, own);
    return {of_source, composed(of_source, map.alignment),
            map.source_product.row(0).segment<3>(kSourceColumns.own_normal).norm(), map.inside_out};
}

/// The rows of one group of both shapes, ascending.
struct GroupRows {
    std::vector<Index> source, target;
};

std::vector<GroupRows> group_rows(const ComponentGroups& groups) {
    std::vector<GroupRows> rows(to_size(groups.count));
    const auto add = [&](const GroupedPoints& points, std::vector<Index> GroupRows::*side) {
        for (std::size_t i = 0; i < points.groups.size(); ++i)
            if (points.anchors[i] < 0)
                (rows[to_size(points.groups[i])].*side).push_back(to_index(i));
    };
    add(groups.source, &GroupRows::source);
    add(groups.target, &GroupRows::target);
    return rows;
}

/// The features of each group, in its rows, and which groups keep the map of the whole because one
/// reaches over them and others.
struct GroupFeatures {
    std::vector<std::vector<Feature>> features;
    std::vector<char> held;
};

/// In places of the group's rows; of a region those that are in it. None where there are none, or
/// one of another feature isn't in it.
std::optional<Marked> within(const Feature& feature, const Marked& marked,
                             const std::vector<Index>& group) {
    Marked result;
    for (std::size_t k = 0; k < marked.rows.size(); ++k) {
        const auto found = std::ranges::lower_bound(group, marked.rows[k]);
        if (found == group.end() || *found != marked.rows[k]) {
            if (feature.kind != FeatureKind::kRegion) return {};
            continue;
        }
        result.rows.push_back(to_index(found - group.begin()));
        if (!marked.weights.empty()) result.weights.push_back(marked.weights[k]);
    }
    if (result.rows.empty()) return {};
    return result;
}

GroupFeatures group_features(const ComponentMarks& marks, std::span<const GroupRows> rows) {
    GroupFeatures result{std::vector<std::vector<Feature>>(rows.size()),
                         std::vector<char>(rows.size(), 0)};
    for (const Feature& feature : marks.features) {
        std::vector<Index> touched;
        for (const Index row : feature.source.rows)
            touched.push_back(marks.groups.source.groups[to_size(row)]);
        for (const Index row : feature.target.rows)
            touched.push_back(marks.groups.target.groups[to_size(row)]);
        std::ranges::sort(touched);
        touched.erase(std::ranges::unique(touched).begin(), touched.end());
        if (touched.size() > 1) {
            if (feature.kind != FeatureKind::kPoint)
                for (const Index g : touched) result.held[to_size(g)] = 1;
            continue;
        }
        const auto g = to_size(touched.front());
        auto source = within(feature, feature.source, rows[g].source),
             target = within(feature, feature.target, rows[g].target);
        if (!source || !target) {
            if (feature.kind != FeatureKind::kPoint) result.held[g] = 1;
            continue;
        }
        Feature& own = result.features[g].emplace_back(feature);
        own.source = std::move(*source);
        own.target = std::move(*target);
    }
    return result;
}

/// One group of both shapes as clouds of their own.
struct GroupClouds {
    OrientedPoints source, target;
    std::vector<Index> source_ends, target_ends;
};

/// Places in the group of those ends that are in it.
std::vector<Index> ends_within(const std::vector<Index>& group, std::span<const Index> ends) {
    std::vector<Index> places;
    for (std::size_t k = 0; k < group.size(); ++k)
        if (std::ranges::binary_search(ends, group[k])) places.push_back(to_index(k));
    return places;
}

GroupClouds clouds_of(const GroupRows& rows, const ComponentView& source,
                      const ComponentView& target) {
    return {{gather(source.positions, rows.source), gather(source.normals, rows.source)},
            {gather(target.positions, rows.target), gather(target.normals, rows.target)},
            ends_within(rows.source, source.ends),
            ends_within(rows.target, target.ends)};
}

Whole whole_cloud(const Positions& positions) {
    std::vector<Index> rows(to_size(positions.rows()));
    std::iota(rows.begin(), rows.end(), 0);
    return whole_of(positions, rows);
}

/// Every point of one moved as that goes to the other as a whole; `turn` takes directions there.
Positions moved_whole(const Positions& from, const Whole& a, const Whole& b, const Matrix3& turn) {
    const Matrix3 linear = stretch_between(a, b, turn);
    return ((from.rowwise() - a.middle) * linear.transpose()).rowwise() + b.middle;
}

Positions moved_whole(const Positions& from, const Positions& to, const Matrix3& turn) {
    return moved_whole(from, whole_cloud(from), whole_cloud(to), turn);
}

/// How far images are from the points that they should cover, both ways, over the size of these:
/// mean distances.
double uncovered(const Positions& images, const Positions& points) {
    const auto one_way = [](const Positions& from, const Positions& to) {
        const KdTree<3> tree(to);
        double sum = 0.0;
        const Index step = std::max<Index>(1, to_index(from.rows()) / 400);
        Index count = 0;
        for (Index i = 0; i < from.rows(); i += step, ++count) {
            Index nearest;
            double squared;
            tree.nearest(from.row(i).data(), {&nearest, 1}, {&squared, 1});
            sum += std::sqrt(squared);
        }
        return sum / count;
    };
    return one_way(images, points) + one_way(points, images);
}

/// Where the search for a group's map begins: its points moved as a whole, or where the map of the
/// whole shapes takes them, whichever covers the other better.
RefinementStart group_start(const GroupClouds& clouds, const RefinementStart& by_whole,
                            const Matrix3& source_turn) {
    RefinementStart moved{
        moved_whole(clouds.source.positions, clouds.target.positions, source_turn),
        moved_whole(clouds.target.positions, clouds.source.positions, source_turn.transpose())};
    const double as_whole = uncovered(moved.source_images, clouds.target.positions);
    const double before = uncovered(by_whole.source_images, clouds.target.positions);
    return as_whole < before ? std::move(moved) : by_whole;
}

/// For a group with a share of the points.
RefinementOptions options_for(RefinementOptions options, double share) {
    constexpr Index kFewestPoints = 300, kFewestCoarse = 24, kFewestFine = 100;
    const auto part = [share](Index whole, Index fewest) {
        return std::clamp(static_cast<Index>(std::lround(share * whole)), std::min(fewest, whole),
                          whole);
    };
    options.coarse.points = part(options.coarse.points, kFewestPoints);
    for (std::size_t k = 0; k < options.coarse.nodes.size(); ++k)
        options.coarse.nodes[k] =
            part(options.coarse.nodes[k], k == 0 ? kFewestCoarse : kFewestFine);
    options.propose = false;
    // A mark pulls at the start, however far it has to go: the pose is known.
    options.trusted_distance = std::numeric_limits<double>::infinity();
    return options;
}

/// Where the points of a group go: in given coordinates on the other shape's surface, and in the
/// product space of the whole.
struct GroupMap {
    RefinementStart images;
    ProductPoints source_product, target_product;
};

/// The rows of a group in the product space of the whole, from other images and their normals.
ProductPoints with_images(ProductPoints product, const ProductColumns& columns,
                          const Positions& images, const Normals& normals) {
    product.middleCols<3>(columns.image) = images;
    product.middleCols<3>(columns.image_normal) = normals;
    return product;
}

/// Images put onto the points of `there`.
Positions landed(const Positions& images, const OrientedPoints& there, Progress& progress) {
    const KdTree<3> tree(there.positions);
    return project_onto_surface(images, nearest_rows(tree, images), tree, there.normals, progress);
}

/// What a group goes as where it goes as a whole.
struct GroupWholes {
    GroupKind kind;
    Whole source, target;
};

GroupWholes wholes_of_group(const GroupRows& rows, const ComponentView& source,
                            const ComponentView& target, const ComponentGroups& groups,
                            std::size_t group) {
    const GroupKind kind = groups.kind(group);
    // What has joined a share goes with it, but has no say.
    const auto whole = [&](const ComponentView& view, std::vector<Index> all,
                           Index IndexPair::*side) {
        if (kind != GroupKind::kPlain)
            std::erase_if(all, [&](Index row) {
                return view.topology.labels[to_size(row)] != groups.matched[group].*side;
            });
        return whole_of(view.positions, all);
    };
    return {kind, whole(source, rows.source, &IndexPair::source),
            whole(target, rows.target, &IndexPair::target)};
}

/// A group that goes as a whole. A share is cut at a slant: what it is for stays straight.
GroupMap whole_group(const GroupClouds& clouds, const GroupWholes& wholes, const Frame& frame,
                     const GroupMap& by_whole, const Matrix3& source_turn, Progress& progress) {
    Whole source = wholes.source, target = wholes.target;
    if (const GroupKind kind = wholes.kind; kind != GroupKind::kPlain) {
        const Vector3 axis = kind == GroupKind::kShareOfTarget
                                 ? axis_of(source)
                                 : Vector3(source_turn.transpose() * axis_of(target));
        source = straightened(source, axis);
        target = straightened(target, source_turn * axis);
    }
    const Positions on_target = moved_whole(clouds.source.positions, source, target, source_turn),
                    on_source = moved_whole(clouds.target.positions, target, source,
                                            source_turn.transpose());
    GroupMap map = by_whole;
    map.source_product =
        with_images(by_whole.source_product, kSourceColumns, frame.of_target.apply(on_target),
                    by_whole.source_product.middleCols<3>(kSourceColumns.own_normal));
    map.target_product =
        with_images(by_whole.target_product, kTargetColumns, frame.of_source.apply(on_source),
                    by_whole.target_product.middleCols<3>(kTargetColumns.own_normal));
    map.images = {landed(on_target, clouds.target, progress),
                  landed(on_source, clouds.source, progress)};
    return map;
}

/// A group that is mapped by itself.
GroupMap refined_group(const GroupClouds& clouds, std::span<const Feature> features,
                       const RefinementStart& start, const RefinementOptions& options,
                       const Frame& frame, const GroupMap& by_whole, Progress& progress) {
    const Refinement found =
        refine({clouds.source.positions, clouds.source.normals, nullptr, clouds.source_ends},
               {clouds.target.positions, clouds.target.normals, nullptr, clouds.target_ends},
               features, options, progress, &start);
    const Frame own = frame_of(found, clouds.source.positions);
    const double weight = own.normal_weight > 0.0 ? frame.normal_weight / own.normal_weight : 0.0;
    // The target's own normals are there as the map of the whole has them.
    const double onto_target = found.inside_out != frame.inside_out ? -weight : weight;
    const auto brought = [&](const ProductPoints& product, const ProductPoints& before,
                             const ProductColumns& columns, const Similarity& to_frame,
                             const Similarity& from_own, double normal_weight) {
        const Similarity move = composed(to_frame, from_own.inverse());
        return with_images(
            before, columns, move.apply(product.middleCols<3>(columns.image)),
            normal_weight * move.rotated(Normals(product.middleCols<3>(columns.image_normal))));
    };
    return {{found.source_images, found.target_images},
            brought(found.source_product, by_whole.source_product, kSourceColumns, frame.of_target,
                    own.of_target, onto_target),
            brought(found.target_product, by_whole.target_product, kTargetColumns, frame.of_source,
                    own.of_source, weight)};
}

/// All rows without an anchor.
std::vector<Index> rows_without_anchor(const GroupedPoints& points) {
    std::vector<Index> rows;
    for (std::size_t i = 0; i < points.anchors.size(); ++i)
        if (points.anchors[i] < 0) rows.push_back(to_index(i));
    return rows;
}

/// Points of the product space so far apart, from group to group, that no point is near another
/// group's.
ProductPoints set_apart(ProductPoints product, const std::vector<Index>& groups, double distance) {
    for (Eigen::Index i = 0; i < product.rows(); ++i)
        product(i, 0) += distance * groups[to_size(i)];
    return product;
}

/// Farther than any two points of a group are from each other.
double distance_between_groups(const ProductPoints& source, const ProductPoints& target) {
    const auto all = [](const ProductPoints& p) {
        return (p.colwise().maxCoeff() - p.colwise().minCoeff()).norm();
    };
    return 4.0 * (all(source) + all(target)) + 1.0;
}

/// Pairs of rows without an anchor by group, those of hard regions among themselves, and those that
/// are pinned.
Pairing paired_by_group(const Refinement& map, const ComponentMarks& marks,
                        std::span<const IndexPair> pinned, Progress& progress) {
    const std::vector<Index> s = rows_without_anchor(marks.groups.source),
                             t = rows_without_anchor(marks.groups.target);
    std::vector<IndexPair> places;
    for (const IndexPair& pair : pinned) {
        const auto a = std::ranges::lower_bound(s, pair.source),
                   b = std::ranges::lower_bound(t, pair.target);
        if (a == s.end() || *a != pair.source || b == t.end() || *b != pair.target) continue;
        places.push_back({to_index(a - s.begin()), to_index(b - t.begin())});
    }
    const auto members = [&](Eigen::Index points, Marked Feature::*side,
                             const std::vector<Index>& rows) -> DynamicRows {
        const DynamicRows all = hard_region_members(marks.features, side, points);
        return all.cols() == 0 ? all : gather(all, rows);
    };
    const Pairing found = pairs_within_regions(
        {gather(map.source_product, s), members(map.source_product.rows(), &Feature::source, s)},
        {gather(map.target_product, t), members(map.target_product.rows(), &Feature::target, t)},
        places, progress);
    Pairing pairs(pinned.begin(), pinned.end());
    for (const IndexPair& pair : found)
        pairs.push_back({s[to_size(pair.source)], t[to_size(pair.target)]});
    std::ranges::sort(pairs);
    pairs.erase(std::ranges::unique(pairs).begin(), pairs.end());
    return pairs;
}

/// The nearest partner of each row that has one; −1 elsewhere.
std::vector<Index> partners_beside(const Positions& images, const Positions& there,
                                   const Pairing& pairs, const GroupDirection& map) {
    std::vector<Index> nearest(to_size(images.rows()), -1);
    for (const IndexPair& pair : pairs) {
        const Index i = pair.*map.here, j = pair.*map.there;
        Index& best = nearest[to_size(i)];
        const auto squared = [&](Index row) {
            return (there.row(row) - images.row(i)).squaredNorm();
        };
        if (best < 0 || squared(j) < squared(best)) best = j;
    }
    return nearest;
}

/// Images beside the points of another group put beside the nearest of their partners.
Positions put_back(Positions images, const std::vector<Index>& nearest, const ComponentView& there,
                   const GroupedPoints& own, const GroupedPoints& other, Progress& progress) {
    const KdTree<3> tree(there.positions);
    std::vector<char> is_astray(to_size(images.rows()), 0);
    parallel_for(to_index(images.rows()), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            if (nearest[to_size(i)] < 0 || own.anchors[to_size(i)] >= 0) continue;
            Index beside;
            double squared;
            tree.nearest(images.row(i).data(), {&beside, 1}, {&squared, 1});
            is_astray[to_size(i)] = other.groups[to_size(beside)] != own.groups[to_size(i)];
        }
    });
    std::vector<Index> rows;
    for (std::size_t i = 0; i < is_astray.size(); ++i)
        if (is_astray[i]) rows.push_back(to_index(i));
    const Positions put = project_onto_surface(gather(images, rows), gather(nearest, rows), tree,
                                               there.normals, progress);
    for (std::size_t k = 0; k < rows.size(); ++k)
        images.row(rows[k]) = put.row(static_cast<Eigen::Index>(k));
    return images;
}

/// Everything with an anchor goes where that goes.
void follow_anchors(const GroupedPoints& points, const std::vector<Index>& nearest,
                    const GroupDirection& map, ProductPoints& product, Positions& images,
                    Pairing& pairs) {
    for (std::size_t i = 0; i < points.anchors.size(); ++i) {
        const Index anchor = points.anchors[i];
        if (anchor < 0) continue;
        const auto row = static_cast<Eigen::Index>(i);
        images.row(row) = images.row(anchor);
        for (const Eigen::Index column : {map.columns.image, map.columns.image_normal})
            product.block<1, 3>(row, column) = product.block<1, 3>(anchor, column);
        IndexPair pair{};
        pair.*map.here = to_index(i);
        pair.*map.there = nearest[to_size(anchor)];
        pairs.push_back(pair);
    }
}

}  // namespace

Refinement mapped_by_group(const Refinement& whole, const ComponentView& source,
                           const ComponentView& target, const ComponentMarks& marks,
                           const GroupMapping& options, Progress& progress) {
    const Frame frame = frame_of(whole, source.positions);
    const std::vector<GroupRows> rows = group_rows(marks.groups);
    const GroupFeatures of_groups = group_features(marks, rows);
    const Matrix3 source_turn = options.target_turn.transpose();
    const auto share = [&](const GroupRows& group) {
        return 0.5 * (static_cast<double>(group.source.size()) / source.positions.rows() +
                      static_cast<double>(group.target.size()) / target.positions.rows());
    };
    const auto keeps = [&](std::size_t g) {
        const bool is_plain = marks.groups.kind(g) == GroupKind::kPlain;
        return (is_plain && marks.groups.joined[g]) || of_groups.held[g] ||
               rows[g].source.empty() || rows[g].target.empty() ||
               (g == 0 && share(rows[0]) >= 1.0 - options.components.small_share);
    };
    std::vector<std::optional<GroupMap>> maps(rows.size());
    const auto map_group = [&](std::size_t g, Progress& its) {
        const GroupClouds clouds = clouds_of(rows[g], source, target);
        const GroupMap by_whole{
            {gather(source.images, rows[g].source), gather(target.images, rows[g].target)},
            gather(whole.source_product, rows[g].source),
            gather(whole.target_product, rows[g].target)};
        const auto fewest = std::min(rows[g].source.size(), rows[g].target.size());
        if (marks.groups.kind(g) != GroupKind::kPlain ||
            to_index(fewest) < options.components.fewest_points)
            maps[g] = whole_group(clouds, wholes_of_group(rows[g], source, target, marks.groups, g),
                                  frame, by_whole, source_turn, its);
        else
            maps[g] = refined_group(
                clouds, of_groups.features[g], group_start(clouds, by_whole.images, source_turn),
                options_for(options.refinement, share(rows[g])), frame, by_whole, its);
    };
    // Large ones one after the other, by all threads; the others next to each other.
    std::vector<std::size_t> small;
    for (std::size_t g = 0; g < rows.size(); ++g) {
        if (keeps(g)) continue;
        if (share(rows[g]) < options.components.small_share) {
            small.push_back(g);
            continue;
        }
        quietly(progress, [&](Progress& quiet) { map_group(g, quiet); });
    }
    std::atomic<int> done{0};
    parallel_invoke(static_cast<int>(small.size()), progress, [&](int k, Progress& its) {
        quietly(its, [&](Progress& quiet) { map_group(small[to_size(k)], quiet); });
        its.report(static_cast<double>(++done) / static_cast<double>(small.size()));
    });
    Refinement result = whole;
    const auto put = [](const auto& from, const std::vector<Index>& at, auto& into) {
        for (std::size_t i = 0; i < at.size(); ++i)
            into.row(at[i]) = from.row(static_cast<Eigen::Index>(i));
    };
    for (std::size_t g = 0; g < rows.size(); ++g) {
        if (!maps[g]) continue;
        put(maps[g]->images.source_images, rows[g].source, result.source_images);
        put(maps[g]->images.target_images, rows[g].target, result.target_images);
        put(maps[g]->source_product, rows[g].source, result.source_product);
        put(maps[g]->target_product, rows[g].target, result.target_product);
    }
    return result;
}

Refinement kept_apart(Refinement map, const ComponentView& source, const ComponentView& target,
                      const ComponentMarks& marks, Progress& progress) {
    const ComponentGroups& groups = marks.groups;
    const std::vector<IndexPair> pinned = pinned_pairs(marks.features);
    const double distance = distance_between_groups(map.source_product, map.target_product);
    map.source_product = set_apart(std::move(map.source_product), groups.source.groups, distance);
    map.target_product = set_apart(std::move(map.target_product), groups.target.groups, distance);
    map.pairs = paired_by_group(map, marks, pinned, progress);

    const auto to_target =
        partners_beside(map.source_images, target.positions, map.pairs, kForward);
    const auto to_source =
        partners_beside(map.target_images, source.positions, map.pairs, kBackward);
    map.source_images = put_back(std::move(map.source_images), to_target, target, groups.source,
                                 groups.target, progress);
    map.target_images = put_back(std::move(map.target_images), to_source, source, groups.target,
                                 groups.source, progress);
    const auto pin = [&] {
        for (const IndexPair& f : pinned) {
            map.source_images.row(f.source) = target.positions.row(f.target);
            map.target_images.row(f.target) = source.positions.row(f.source);
        }
    };
    pin();
    follow_anchors(groups.source, to_target, kForward, map.source_product, map.source_images,
                   map.pairs);
    follow_anchors(groups.target, to_source, kBackward, map.target_product, map.target_images,
                   map.pairs);
    pin();
    std::ranges::sort(map.pairs);
    map.pairs.erase(std::ranges::unique(map.pairs).begin(), map.pairs.end());
    return map;
}

}  // namespace pointmorph

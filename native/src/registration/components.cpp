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

/// A piece as a whole: its middle, its size, and where its points go on the whole.
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
            rows[to_size(topology.labels[i])].push_back(static_cast<Index>(i));
    return rows;
}

std::vector<Whole> wholes_of(const PieceView& view) {
    std::vector<Whole> wholes;
    for (const auto& rows : rows_of(view.topology))
        wholes.push_back(whole_of(view.positions, view.images, rows));
    return wholes;
}

std::string counted(Index count, const char* one, const char* more) {
    return std::to_string(count) + " " + (count == 1 ? one : more);
}

}  // namespace

PieceMatching match_pieces(const PieceView& source, const PieceView& target,
                           const Similarity& alignment, const PieceOptions& options) {
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
    const auto is_most = [](const PieceView& view) {
        return 2 * to_size(view.topology.components.front().points) > view.topology.labels.size();
    };
    if (is_most(source) && is_most(target)) {
        costs.row(0).setConstant(2.0 * kAlone);
        costs.col(0).setConstant(2.0 * kAlone);
        costs(0, 0) = 0.0;
    }
    PieceMatching matching;
    matching.matched = cheapest_pairs(costs, kAlone);
    const auto alone = [&](std::size_t count, Index IndexPair::*side) {
        std::vector<Index> result;
        for (Index i = 0; i < static_cast<Index>(count); ++i)
            if (std::ranges::find(matching.matched, i, side) == matching.matched.end())
                result.push_back(i);
        return result;
    };
    matching.source_alone = alone(s.size(), &IndexPair::source);
    matching.target_alone = alone(t.size(), &IndexPair::target);
    // Pieces are numbered by size, but not alike on both sides.
    std::ranges::stable_sort(matching.matched, std::greater<>(), [&](const IndexPair& pair) {
        return source.topology.components[to_size(pair.source)].points +
               target.topology.components[to_size(pair.target)].points;
    });
    return matching;
}

std::vector<Feature> piece_regions(const Topology& source, const Topology& target,
                                   std::span<const IndexPair> matched, Index most) {
    const auto source_rows = rows_of(source), target_rows = rows_of(target);
    std::vector<Feature> regions;
    for (std::size_t k = 1; k < matched.size() && k <= to_size(most); ++k)
        regions.push_back({"piece " + std::to_string(k + 1), FeatureKind::kRegion,
                           Marked{source_rows[to_size(matched[k].source)], {}},
                           Marked{target_rows[to_size(matched[k].target)], {}}});
    return regions;
}

RefinementStart piece_start(const PieceView& source, const PieceView& target,
                            std::span<const Feature> regions, const Similarity& alignment,
                            const PieceOptions& options) {
    RefinementStart start{source.images, target.images};
    const auto move = [&](const PieceView& from, const Positions& to, Marked Feature::*here,
                          Marked Feature::*there, const Matrix3& turn, Positions& images) {
        for (const Feature& region : regions) {
            const auto& rows = (region.*here).rows;
            if (static_cast<double>(rows.size()) >
                options.carries_itself * static_cast<double>(from.positions.rows()))
                continue;
            const Whole own = whole_of(from.positions, from.images, rows);
            const Whole other = whole_of(to, to, (region.*there).rows);
            const double scale = own.size > 0.0 ? other.size / own.size : 1.0;
            for (const Index i : rows)
                images.row(i) =
                    other.middle + scale * (from.positions.row(i) - own.middle) * turn.transpose();
        }
    };
    move(source, target.positions, &Feature::source, &Feature::target,
         alignment.rotation.transpose(), start.source_images);
    move(target, source.positions, &Feature::target, &Feature::source, alignment.rotation,
         start.target_images);
    return start;
}

bool are_small(std::span<const Feature> regions, Index source_size, Index target_size,
               const PieceOptions& options) {
    return std::ranges::all_of(regions, [&](const Feature& region) {
        const auto share = [](const Marked& marked, Index size) {
            return static_cast<double>(marked.rows.size()) / size;
        };
        return std::max(share(region.source, source_size), share(region.target, target_size)) <=
               options.carries_itself;
    });
}

void keep_apart(Refinement& map, const PieceView& source, const Normals& source_normals,
                const PieceView& target, const Normals& target_normals,
                std::span<const Feature> regions, std::span<const IndexPair> pinned,
                const PieceOptions& options, Progress& progress) {
    // In the product space both shapes lie alike: pieces are only moved and scaled.
    constexpr Eigen::Index kOnTarget = 0, kOnSource = 3, kTargetNormal = 6, kSourceNormal = 9;
    const auto move = [&](ProductPoints& points, const ProductPoints& others, Eigen::Index image,
                          Eigen::Index own, Eigen::Index image_normal, Eigen::Index own_normal,
                          Marked Feature::*here, Marked Feature::*there) {
        const Positions from = points.middleCols<3>(own), to = others.middleCols<3>(image);
        for (const Feature& region : regions) {
            const Whole a = whole_of(from, from, (region.*here).rows);
            const Whole b = whole_of(to, to, (region.*there).rows);
            const double scale = a.size > 0.0 ? b.size / a.size : 1.0;
            for (const Index i : (region.*here).rows) {
                points.block<1, 3>(i, image) = b.middle + scale * (from.row(i) - a.middle);
                points.block<1, 3>(i, image_normal) = points.block<1, 3>(i, own_normal);
            }
        }
    };
    move(map.source_product, map.target_product, kOnTarget, kOnSource, kTargetNormal, kSourceNormal,
         &Feature::source, &Feature::target);
    move(map.target_product, map.source_product, kOnSource, kOnTarget, kSourceNormal, kTargetNormal,
         &Feature::target, &Feature::source);
    // Region of every point, 0 for none.
    const auto groups = [&](const PieceView& view, Marked Feature::*side) {
        std::vector<Index> group(to_size(static_cast<Index>(view.positions.rows())), 0);
        for (std::size_t k = 0; k < regions.size(); ++k)
            for (const Index i : (regions[k].*side).rows)
                group[to_size(i)] = static_cast<Index>(k) + 1;
        return group;
    };
    const auto source_group = groups(source, &Feature::source);
    const auto target_group = groups(target, &Feature::target);
    const Pairing before = std::exchange(map.pairs, Pairing(pinned.begin(), pinned.end()));
    for (Index g = 0; g <= static_cast<Index>(regions.size()); ++g) {
        const auto rows_in = [&](const std::vector<Index>& group) {
            std::vector<Index> rows;
            for (std::size_t i = 0; i < group.size(); ++i)
                if (group[i] == g) rows.push_back(static_cast<Index>(i));
            return rows;
        };
        const auto s = rows_in(source_group), t = rows_in(target_group);
        std::vector<IndexPair> features;
        for (const IndexPair& f : pinned)
            if (source_group[to_size(f.source)] == g && target_group[to_size(f.target)] == g)
                features.push_back(
                    {static_cast<Index>(std::ranges::lower_bound(s, f.source) - s.begin()),
                     static_cast<Index>(std::ranges::lower_bound(t, f.target) - t.begin())});
        for (const IndexPair& pair : mutual_pairs<12>(
                 gather(map.source_product, s), gather(map.target_product, t), features, progress))
            map.pairs.push_back({s[to_size(pair.source)], t[to_size(pair.target)]});
    }
    std::ranges::sort(map.pairs);
    map.pairs.erase(std::ranges::unique(map.pairs).begin(), map.pairs.end());

    const RefinementStart wholes = piece_start(source, target, regions, map.alignment, options);
    const auto land = [&](Positions& images, const PieceView& there, const Normals& there_normals,
                          const Positions& moved, const std::vector<Index>& own,
                          const std::vector<Index>& other, Index IndexPair::*from,
                          Index IndexPair::*to) {
        // Points of a region, and those whose partners were taken from them.
        std::vector<char> astray(own.size());
        for (std::size_t i = 0; i < own.size(); ++i) astray[i] = own[i] > 0;
        for (const IndexPair& pair : before)
            if (own[to_size(pair.*from)] != other[to_size(pair.*to)])
                astray[to_size(pair.*from)] = 1;
        for (const IndexPair& pair : pinned) astray[to_size(pair.*from)] = 0;
        std::vector<Index> partner(astray.size(), -1);
        for (const IndexPair& pair : map.pairs) {
            Index& best = partner[to_size(pair.*from)];
            const auto squared = [&](Index j) {
                return (there.positions.row(j) - moved.row(pair.*from)).squaredNorm();
            };
            if (best < 0 || squared(pair.*to) < squared(best)) best = pair.*to;
        }
        std::vector<Index> rows, partners;
        for (std::size_t i = 0; i < astray.size(); ++i)
            if (astray[i]) {
                rows.push_back(static_cast<Index>(i));
                partners.push_back(partner[i]);
            }
        const KdTree<3> tree(there.positions);
        const Positions put =
            project_onto_surface(gather(moved, rows), partners, tree, there_normals, progress);
        for (std::size_t k = 0; k < rows.size(); ++k)
            images.row(rows[k]) = put.row(static_cast<Eigen::Index>(k));
    };
    Positions source_images = source.images, target_images = target.images;
    land(source_images, target, target_normals, wholes.source_images, source_group, target_group,
         &IndexPair::source, &IndexPair::target);
    land(target_images, source, source_normals, wholes.target_images, target_group, source_group,
         &IndexPair::target, &IndexPair::source);
    map.source_images = std::move(source_images);
    map.target_images = std::move(target_images);
}

std::vector<std::string> pieces_in_words(const PieceMatching& matching, const Topology& source,
                                         const std::string& source_name, const Topology& target,
                                         const std::string& target_name) {
    std::vector<std::string> words;
    if (matching.matched.size() > 1) {
        constexpr std::size_t kListed = 4;
        std::string list;
        for (std::size_t k = 0; k < std::min(kListed, matching.matched.size()); ++k)
            list += (k == 0 ? "" : ", ") +
                    std::to_string(source.components[to_size(matching.matched[k].source)].points) +
                    " points with " +
                    std::to_string(target.components[to_size(matching.matched[k].target)].points);
        if (matching.matched.size() > kListed) list += " and so on";
        words.push_back(std::to_string(matching.matched.size()) + " pieces of " + source_name +
                        " and " + target_name + " were matched by place and size: " + list + ".");
    }
    const auto alone = [&](std::span<const Index> pieces, const Topology& topology,
                           const std::string& name) {
        if (pieces.empty()) return;
        Index points = 0;
        for (const Index piece : pieces) points += topology.components[to_size(piece)].points;
        const auto count = static_cast<Index>(pieces.size());
        words.push_back(
            counted(count, "piece", "pieces") + " of " + name + " (" +
            counted(points, "point", "points") +
            (count == 1 ? ") has no counterpart: it was" : ") have no counterpart: they were") +
            " joined to what is nearest.");
    };
    alone(matching.source_alone, source, source_name);
    alone(matching.target_alone, target, target_name);
    return words;
}

}  // namespace pointmorph

#include "pointmorph/measures/local_confidence.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "measures/doubtful_places.hpp"
#include "measures/judged_surface.hpp"
#include "measures/measured_map.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/cloud/subset.hpp"

namespace pointmorph {

namespace {

// Lengths are in √area.
constexpr Index kNeighbors = 6;         // that tell how far apart points are
constexpr Index kTogetherFrom = 4000;   // points, of which several are carried to together
constexpr double kGrowthNear = 0.05;    // around a node, where growth is averaged …
constexpr double kStrainNear = 0.12;    // … and strain
constexpr double kBendNear = 0.1;       // a ball whose centroid tells tips, edges and planes apart
constexpr double kElsewhere = 0.15;     // images that far apart have nothing in common
constexpr double kUnreached = 0.065;    // from all images of the other cloud's nodes …
constexpr double kGaps = 2.0;           // … and so many times what the image is from its nodes
constexpr double kSureUnreached = 0.3;  // at most, where nothing comes near
constexpr std::size_t kFewestUnreached = 4;

/// Values at some places, blended at others.
struct Blend {
    std::array<Index, 4> rows{};
    std::array<double, 4> weights{};
    std::size_t count = 0;

    template <class At>
    double of(At&& at) const {
        double sum = 0.0;
        for (std::size_t k = 0; k < count; ++k) sum += weights[k] * at(rows[k]);
        return sum;
    }
};

/// By inverse squared distances, which `weights` hold so far.
void balance(Blend& blend) {
    constexpr double kCloser = 1e-12;  // than which it makes no difference
    double sum = 0.0;
    for (std::size_t k = 0; k < blend.count; ++k) {
        blend.weights[k] = 1.0 / std::max(blend.weights[k], kCloser);
        sum += blend.weights[k];
    }
    for (std::size_t k = 0; k < blend.count; ++k) blend.weights[k] /= sum;
}

Blend blend(const KdTree<6>& tree, const SidedPoint& point) {
    Blend result;
    result.count = to_size(tree.nearest(point.data(), result.rows, result.weights));
    balance(result);
    return result;
}

/// One direction of the map.
struct JudgedWay {
    const JudgedSurface &here, &there;
    const NodeTrees &trees_here, &trees_there;
    const PointQuality& quality;
    const MapFigures& figures;
    Positions images;         ///< of the nodes, at unit area
    Positions ends;           ///< where the other cloud ends and this one goes on, at unit area
    std::vector<Index> feet;  ///< the node of the other cloud next to each, on its side
    const std::vector<Index>& rows_of_others;
    Eigen::MatrixXd OtherMaps::*others;
    std::vector<char> alone{};      ///< of each node, whether it is known to have no counterpart
    std::vector<char> unreached{};  ///< whether none of the other cloud's images is near, nor near
                                    ///< some nodes around it
};

/// Means over the points of each node, of what is measured at points.
struct NodeMeans {
    Values strain;  ///< √((ln² s₁ + ln² s₂) / 2) of the stretches
    Values growth;  ///< ln(s₁ s₂)
};

NodeMeans means_at_nodes(const JudgedWay& map) {
    constexpr double kMost = 20.0;
    const Index nodes = map.here.count();
    NodeMeans means{Values::Zero(nodes), Values::Zero(nodes)};
    Values count = Values::Zero(nodes);
    for (const Index row : map.here.samples) {
        const auto point = map.here.sided(row);
        Index k = 0;
        double squared_distance = 0.0;
        map.trees_here.by_side.nearest(point.data(), {&k, 1}, {&squared_distance, 1});
        const auto logarithm = [&](Eigen::Index column) {
            return std::log(std::clamp(map.quality.stretch(row, column), 1.0 / kMost, kMost));
        };
        const double a = logarithm(0), b = logarithm(1);
        means.strain[k] += std::sqrt((a * a + b * b) / 2.0);
        means.growth[k] += a + b;
        count[k] += 1.0;
    }
    means.strain.array() /= count.array().max(1.0);
    means.growth.array() /= count.array().max(1.0);
    return means;
}

/// Nodes and their squared distances, ascending.
using Found = std::vector<std::pair<Index, double>>;

std::span<const std::pair<Index, double>> within(const Found& found, double radius) {
    const auto end =
        std::ranges::lower_bound(found, radius * radius, {}, &std::pair<Index, double>::second);
    return {found.begin(), end};
}

/// The mean over the nodes around one, on its side of the surface, that have a counterpart.
double mean_around(const JudgedWay& way, Index node, const Values& values,
                   std::span<const std::pair<Index, double>> around) {
    double sum = 0.0;
    Index count = 0;
    for (const auto& [other, squared_distance] : around) {
        if (way.alone[to_size(other)] || !way.here.same_side(node, other)) continue;
        sum += values[other];
        ++count;
    }
    return count > 0 ? sum / count : values[node];
}

/// How far the centroid of what lies in a ball is from its center along a normal, in radii: 0 in a
/// plane, less than 0 where the surface bulges.
double bend(const JudgedSurface& surface, const Eigen::RowVector3d& center,
            const Eigen::RowVector3d& normal, std::span<const std::pair<Index, double>> inside) {
    if (inside.empty()) return 0.0;
    double sum = 0.0;
    for (const auto& [row, squared_distance] : inside)
        sum += (surface.places.row(row) - center).dot(normal);
    return sum / static_cast<double>(inside.size()) / kBendNear;
}

/// The other maps' weights: 1 where one costs as little; 0 where a mark speaks against it.
Values weights_of(const OtherMaps& others, double exponent, const JudgedWay& way,
                  std::span<const Blend> marks) {
    constexpr double kLeast = 0.5;
    Values weights = others.ratios.array().max(kLeast).pow(-exponent);
    const Eigen::MatrixXd& distances = others.*way.others;
    for (const Blend& mark : marks)
        for (Eigen::Index k = 0; k < weights.size(); ++k)
            if (mark.of([&](Index row) { return distances(k, row); }) > kRightPlace)
                weights[k] = 0.0;
    return weights;
}

/// All other maps, with their weights.
struct WeighedMaps {
    const Alternatives& maps;
    Values finished, trials;
    /// Of those of the finished that lay the whole shape otherwise, or roll it; not there.
    Values elsewhere;
};

WeighedMaps weighed(const Alternatives& maps, const JudgedWay& there,
                    std::span<const Feature> features) {
    constexpr double kFinishedCost = 40.0, kTrialCost = 20.0;
    constexpr double kMostOfIt = 0.75;
    if (!maps.searched()) return {maps, {}, {}, {}};
    const SidedPoints places = there.here.sided(there.rows_of_others);
    const KdTree<6> tree(places);
    std::vector<Blend> marks;
    for (const Feature& feature : features)
        if (feature.kind == FeatureKind::kPoint)
            marks.push_back(blend(tree, there.here.sided(feature.source.rows.front())));
    WeighedMaps result{maps,
                       weights_of(maps.finished, kFinishedCost, there, marks),
                       weights_of(maps.trials, kTrialCost, there, marks),
                       {}};
    result.elsewhere = Values::Zero(result.finished.size());
    for (Eigen::Index k = 0; k < result.finished.size(); ++k)
        if (maps.finished.rolled == k ||
            (maps.finished.source.row(k).array() / kElsewhere).min(1.0).mean() >= kMostOfIt)
            std::swap(result.finished[k], result.elsewhere[k]);
    return result;
}

/// How much other maps that may be right as well differ at a place.
double disagreement(const Blend& at, const Eigen::MatrixXd& distances, const Values& weights) {
    double sum = 0.0;
    for (Eigen::Index k = 0; k < weights.size(); ++k) {
        const double distance = at.of([&](Index row) { return distances(k, row); });
        sum += weights[k] * std::pow(std::min(distance / kElsewhere, 1.0), 1.5);
    }
    return sum;
}

/// At the nodes.
Values confidence_at_nodes(const JudgedWay& way, const NodeMeans& means, const WeighedMaps& others,
                           Progress& progress) {
    // Fitted; see docs/stages/measures/local_confidence.md.
    constexpr double kPlain = -0.42, kRoundTrip = 0.91, kStrain = 4.7, kGrowth = 0.75, kBend = 2.7,
                     kFinished = 1.0, kTrials = 0.73, kNoSearch = 0.66;
    constexpr double kNoRoundTrip = 0.003, kLongRoundTrip = 0.5;
    const bool searched = others.maps.searched();
    const double round_trip = std::min(way.figures.round_trip_mean, kLongRoundTrip);
    const double everywhere =
        kPlain + kRoundTrip * std::log(round_trip + kNoRoundTrip) + (searched ? 0.0 : kNoSearch);
    const SidedPoints places = searched ? way.here.sided(way.rows_of_others) : way.here.nodes;
    const KdTree<6> places_tree(places);
    Values confidence(way.here.count());
    const auto judge = [&](Index k, Found& near, Found& near_image) {
        const Eigen::RowVector3d place = way.here.places.row(k), image = way.images.row(k);
        way.trees_here.by_place.within(place.data(), kStrainNear, near);
        way.trees_there.by_place.within(image.data(), kBendNear, near_image);
        const double bends =
            bend(way.here, place, way.here.node_normal(k), within(near, kBendNear)) -
            bend(way.there, image, way.there.node_normal(way.feet[to_size(k)]), near_image);
        double doubt = everywhere + kBend * std::abs(bends) +
                       kStrain * mean_around(way, k, means.strain, near) +
                       kGrowth * mean_around(way, k, means.growth, within(near, kGrowthNear));
        double elsewhere = 0.0;  // each of these maps is as likely, in the proportion of its weight
        if (searched) {
            const Blend at = blend(places_tree, way.here.nodes.row(k));
            const Eigen::MatrixXd &finished = others.maps.finished.*way.others,
                                  &trials = others.maps.trials.*way.others;
            doubt += kFinished * std::log1p(disagreement(at, finished, others.finished)) +
                     kTrials * std::log1p(disagreement(at, trials, others.trials));
            elsewhere = disagreement(at, finished, others.elsewhere);
        }
        confidence[k] = 1.0 / (1.0 + std::exp(doubt)) / (1.0 + elsewhere);
        if (way.unreached[to_size(k)]) confidence[k] = std::min(confidence[k], kSureUnreached);
    };
    parallel_for(
        way.here.count(), progress,
        [&](Index begin, Index end) {
            Found near, near_image;
            for (Index k = begin; k < end; ++k) judge(k, near, near_image);
        },
        0.0, 1.0, 64);
    return confidence;
}

/// Those whose images lie at ends, and those of loose pieces.
std::vector<char> alone_nodes(const JudgedWay& way, std::span<const Index> loose) {
    Progress silent;  // nodes are few
    std::vector<char> alone = lie_at_ends(way.images, way.ends, kEndNear, silent);
    alone.resize(to_size(way.here.count()), 0);
    std::vector<char> is_loose(to_size(way.here.size()), 0);
    for (const Index row : loose) is_loose[to_size(row)] = 1;
    for (std::size_t k = 0; k < alone.size(); ++k) alone[k] |= is_loose[to_size(way.here.rows[k])];
    return alone;
}

/// Those that have to have a counterpart, in places that hold a few. Where an image lies in a gap
/// between the other cloud's nodes, none of theirs can come near.
std::vector<char> unreached_nodes(const JudgedWay& way, const Positions& images) {
    const KdTree<3> tree(images);
    std::vector<char> far(to_size(way.here.count()), 0), result = far;
    for (Index k = 0; k < way.here.count(); ++k) {
        const Index foot = way.feet[to_size(k)];
        const double gap = (way.images.row(k) - way.there.places.row(foot)).norm();
        far[to_size(k)] =
            way.alone[to_size(k)] == 0 &&
            !tree.any_within(way.here.places.row(k).data(), std::max(kUnreached, kGaps * gap));
    }
    Found around;
    for (Index k = 0; k < way.here.count(); ++k) {
        if (far[to_size(k)] == 0) continue;
        way.trees_here.by_place.within(way.here.places.row(k).data(), kUnreached, around);
        std::size_t count = 0;
        for (const auto& [other, squared_distance] : around) count += to_size(far[to_size(other)]);
        result[to_size(k)] = count >= kFewestUnreached;
    }
    return result;
}

/// Nodes are even. Nothing where none has a counterpart.
std::optional<double> mean_with_counterpart(const JudgedWay& way, const Values& at_nodes) {
    double sum = 0.0;
    Index count = 0;
    for (Index k = 0; k < way.here.count(); ++k) {
        if (way.alone[to_size(k)]) continue;
        sum += at_nodes[k];
        ++count;
    }
    return count > 0 ? std::optional(sum / count) : std::nullopt;
}

/// From the nodes to all points. Those that follow one another in the cloud's spatial order lie
/// close together: the nodes near one of them are near to all.
Values carried(const JudgedSurface& surface, const NodeTrees& trees, const Values& at_nodes,
               Progress& progress) {
    constexpr Index kNear = 16;
    constexpr double kCloser = 1e-9;  // squared, than which it makes no difference
    using Each = Eigen::Array<double, kNear, 1>;
    const Index together = 1 + surface.size() / kTogetherFrom;
    const Index groups = (surface.size() + together - 1) / together;
    Values result(surface.size());
    const auto carry = [&](Index group) {
        const Index begin = group * together, end = std::min(begin + together, surface.size());
        std::array<Index, kNear> near{};
        std::array<double, kNear> squared_distances{};
        const Eigen::RowVector3d middle =
            surface.scale * surface.positions.row(surface.order[to_size((begin + end) / 2)]);
        const Index count = trees.by_place.nearest(middle.data(), near, squared_distances);
        Eigen::Array<double, kNear, 6> nodes;
        Each values = Each::Zero(), is_there = Each::Zero();
        nodes.setZero();
        for (Index k = 0; k < count; ++k) {
            nodes.row(k) = surface.nodes.row(near[to_size(k)]);
            values[k] = at_nodes[near[to_size(k)]];
            is_there[k] = 1.0;
        }
        for (Index i = begin; i < end; ++i) {
            const Index row = surface.order[to_size(i)];
            const SidedPoint point = surface.sided(row);
            Each squared = Each::Constant(kCloser);
            for (Eigen::Index d = 0; d < 6; ++d) squared += (nodes.col(d) - point[d]).square();
            const Each weights = is_there / squared.square();
            result[row] = (weights * values).sum() / weights.sum();
        }
    };
    parallel_for(groups, progress, [&](Index begin, Index end) {
        for (Index group = begin; group < end; ++group) carry(group);
    });
    return result;
}

/// At all points. A node without a counterpart is as likely right as what its image lies on.
Values at_points(const JudgedWay& way, Values at_nodes, const Values& at_others,
                 Progress& progress) {
    for (Index k = 0; k < way.here.count(); ++k)
        if (way.alone[to_size(k)]) at_nodes[k] = at_others[way.feet[to_size(k)]];
    return carried(way.here, way.trees_here, at_nodes, progress);
}

JudgedNodes judged_nodes(const JudgedWay& way, const Values& confidence) {
    return {way.here, way.trees_here, confidence, way.alone, way.unreached};
}

/// The node nearest to each image, on the side where it belongs: that of a partner.
std::vector<Index> feet_of(const Positions& images, const JudgedSurface& surface,
                           const NodeTrees& trees, std::span<const Index> partners) {
    const Positions normals = surface.nodes.rightCols<3>() / JudgedSurface::kSideWeight;
    std::vector<Index> feet(to_size(images.rows()));
    for (std::size_t k = 0; k < feet.size(); ++k)
        feet[k] =
            nearest_on_sheet(trees.by_place, normals, images.row(static_cast<Eigen::Index>(k)),
                             surface.cloud.normals.row(partners[k]));
    return feet;
}

/// A partner of each node.
std::vector<Index> partners_of(const JudgedSurface& surface, const TwoWayMap& map, bool on_source) {
    std::vector<Index> partner(to_size(surface.size()), 0);
    for (const IndexPair& pair : map.pairs)
        partner[to_size(on_source ? pair.source : pair.target)] =
            on_source ? pair.target : pair.source;
    return gather(partner, surface.rows);
}

/// Where the nodes' counterparts are, and which nodes have none. `reverse`: images of the other
/// cloud's nodes; `loose`: rows of pieces that have no counterpart.
void find_counterparts(JudgedWay& way, const Positions& reverse, std::span<const Index> partners,
                       std::span<const Index> loose) {
    way.feet = feet_of(way.images, way.there, way.trees_there, partners);
    way.alone = alone_nodes(way, loose);
    way.unreached = unreached_nodes(way, reverse);
}

/// Where so much of a cloud lies beyond the ends of the other that this is a part of it: has what
/// doesn't lie there have unit area.
void count_without_beyond(JudgedSurface& here, const JudgedSurface& there, const Positions& images,
                          const Positions& ends) {
    Progress silent;  // nodes are few
    const BeyondPart beyond =
        beyond_part(there.at_unit_area(gather(images, here.rows)), there.at_unit_area(ends),
                    kEndNear, Values::Ones(here.count()), silent);
    here.scale_up(1.0 / std::sqrt(beyond.left));
}

}  // namespace

LocalConfidence measure_local_confidence(const JudgedMap& judged, std::span<const Feature> features,
                                         Progress& progress) {
    const auto& [map, quality, diagnostics] = judged;
    const Alternatives& others = diagnostics.alternatives;
    std::array<std::optional<OrderedNeighbors>, 2> found;
    std::array<std::optional<JudgedSurface>, 2> surfaces;
    {
        const Progress::Part part(progress, 0.0, 0.6);
        on_both(progress, [&](bool is_source, Progress& its) {
            const std::size_t k = is_source ? 0 : 1;
            const Cloud& cloud = is_source ? map.source : map.target;
            const OrderedNeighbors* known = is_source ? map.source_neighbors : map.target_neighbors;
            if (!known)
                known = &found[k].emplace(ordered_neighbors(cloud.positions, kNeighbors, its));
            surfaces[k].emplace(cloud, *known, its);
        });
    }
    JudgedSurface &source = *surfaces[0], &target = *surfaces[1];
    count_without_beyond(source, target, map.source_images,
                         gather(map.target.positions, diagnostics.target_ends));
    count_without_beyond(target, source, map.target_images,
                         gather(map.source.positions, diagnostics.source_ends));
    std::array<std::optional<NodeTrees>, 2> trees;
    parallel_invoke(2, [&](int k, bool) { trees[to_size(k)].emplace(k == 0 ? source : target); });
    const NodeTrees &of_source = *trees[0], &of_target = *trees[1];
    JudgedWay there{source,
                    target,
                    of_source,
                    of_target,
                    quality.source,
                    quality.source_to_target,
                    target.at_unit_area(gather(map.source_images, source.rows)),
                    target.at_unit_area(gather(map.target.positions, diagnostics.target_ends)),
                    {},
                    others.source_rows,
                    &OtherMaps::source};
    JudgedWay back{target,
                   source,
                   of_target,
                   of_source,
                   quality.target,
                   quality.target_to_source,
                   source.at_unit_area(gather(map.target_images, target.rows)),
                   source.at_unit_area(gather(map.source.positions, diagnostics.source_ends)),
                   {},
                   others.target_rows,
                   &OtherMaps::target};
    std::array<NodeMeans, 2> means;
    parallel_invoke(2, [&](int k, bool) {  // nodes are few
        JudgedWay& way = k == 0 ? there : back;
        find_counterparts(way, (k == 0 ? back : there).images, partners_of(way.here, map, k == 0),
                          k == 0 ? diagnostics.source_loose : diagnostics.target_loose);
        means[to_size(k)] = means_at_nodes(way);
    });
    const WeighedMaps weighed_others = weighed(others, there, features);
    Values on_source, on_target;
    {
        const Progress::Part part(progress, 0.6, 0.8);
        on_both(progress, [&](bool is_source, Progress& its) {
            (is_source ? on_source : on_target) = confidence_at_nodes(
                is_source ? there : back, means[is_source ? 0 : 1], weighed_others, its);
        });
    }
    LocalConfidence result;
    const auto judge = [&](const JudgedWay& way, const Values& at_nodes, const Values& at_others,
                           bool is_source) {
        const Progress::Part part(progress, is_source ? 0.8 : 0.9, is_source ? 0.9 : 1.0);
        if (const auto mean = mean_with_counterpart(way, at_nodes))
            result.right = std::min(result.right, *mean);
        return at_points(way, at_nodes, at_others, progress);
    };
    result.source = judge(there, on_source, on_target, true);
    result.target = judge(back, on_target, on_source, false);
    auto [places, warning] = doubtful_places(
        judged_nodes(there, on_source), judged_nodes(back, on_target), result.right, map, features);
    result.doubtful = std::move(places);
    result.warning = std::move(warning);
    return result;
}

}  // namespace pointmorph

#include "registration/marks.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

constexpr double kHardRegion = 10.0;  // weight that a hard region has at least

/// Rows of a curve that show the pose, at the same shares of the length.
void add_pose_pairs(const MarkedCurve& curve, const KdTree<3>& source,
                    const Normals& source_normals, const KdTree<3>& target,
                    const Normals& target_normals, std::vector<IndexPair>& pairs) {
    constexpr Index kPlaces = 9;
    const auto row = [](const TracedCurve& traced, double share, const KdTree<3>& tree,
                        const Normals& normals) {
        return nearest_on_sheet(tree, normals, traced.at(share).transpose(),
                                traced.normals.row(traced.before(share)));
    };
    for (Index k = 0; k < kPlaces; ++k) {
        const double share = static_cast<double>(k) / (kPlaces - (curve.source.closed ? 0 : 1));
        pairs.push_back({row(curve.source, share, source, source_normals),
                         row(curve.target, share, target, target_normals)});
    }
}

/// A column for each region: how far every one of `count` points belongs to it. No rows without
/// regions.
Labels memberships(std::span<const MarkedRegion> regions, Eigen::Index count,
                   Marked Feature::*side) {
    if (regions.empty()) return {};
    Labels labels = Labels::Zero(count, Labels::ColsAtCompileTime);
    for (std::size_t r = 0; r < regions.size(); ++r) {
        const Marked& marked = regions[r].feature->*side;
        for (std::size_t i = 0; i < marked.rows.size(); ++i)
            labels(marked.rows[i], static_cast<Eigen::Index>(r)) = marked.weight(i);
    }
    return labels;
}

TracedCurve moved(TracedCurve curve, const Similarity& move) {
    curve.places = move.apply(curve.places);
    curve.normals = move.rotated(curve.normals);
    for (double& length : curve.lengths) length *= move.scale;
    return curve;
}

/// Places of one kind of mark, and how much they pull.
struct GuidePlaces {
    std::vector<CurvePlaces> places;
    std::vector<double> weights;  ///< one for each place of all
};

GuidePlaces guide_places(const CoarsePair& shapes, const Marks& marks, double node_spacing,
                         const RegistrationOptions& options) {
    GuidePlaces guides;
    const auto add_rows = [&](Index s, Index t, double weight) {
        const auto place = [](const CoarseShape& shape, Index cloud_row) {
            return std::ranges::find(shape.cloud_rows, cloud_row) - shape.cloud_rows.begin();
        };
        const auto i = place(shapes.source, s), j = place(shapes.target, t);
        guides.places.push_back({shapes.source.positions.row(i), shapes.target.positions.row(j),
                                 shapes.source.normals.row(i), shapes.target.normals.row(j)});
        guides.weights.push_back(weight);
    };
    for (const Feature* f : marks.soft_points)
        add_rows(f->source.rows.front(), f->target.rows.front(), options.soft_weight * f->weight);
    for (const MarkedRegion& region : marks.regions)
        add_rows(region.centers.source, region.centers.target, 0.0);
    for (const MarkedCurve& curve : marks.curves) {
        CurvePlaces along = places_along(curve, 0.5 * node_spacing);
        const double length = std::max(curve.source.length(), curve.target.length());
        const double strength =
            curve.hard ? options.feature_weight : options.soft_weight * curve.weight;
        const double part = length / node_spacing / static_cast<double>(along.source.rows());
        guides.weights.insert(guides.weights.end(), to_size(along.source.rows()),
                              strength * std::min(1.0, part));
        guides.places.push_back(std::move(along));
    }
    return guides;
}

}  // namespace

Index central_row(const Marked& marked, const Positions& positions) {
    Eigen::RowVector3d mean = Eigen::RowVector3d::Zero();
    double sum = 0.0, largest = 0.0;
    for (std::size_t i = 0; i < marked.rows.size(); ++i) {
        mean += marked.weight(i) * positions.row(marked.rows[i]);
        sum += marked.weight(i);
        largest = std::max(largest, marked.weight(i));
    }
    mean /= sum;
    Index center = -1;
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < marked.rows.size(); ++i) {
        const double squared = (positions.row(marked.rows[i]) - mean).squaredNorm();
        if (marked.weight(i) < 0.5 * largest || squared >= nearest) continue;
        nearest = squared;
        center = marked.rows[i];
    }
    return center;
}

Marks marks_of(std::span<const Feature> features, const OrientedView& source,
               const OrientedView& target, Progress& progress) {
    std::optional<KdTree<3>> source_tree, target_tree;
    if (std::ranges::find(features, FeatureKind::kCurve, &Feature::kind) != features.end())
        on_both(progress, [&](bool is_source, Progress&) {
            (is_source ? source_tree : target_tree)
                .emplace(is_source ? source.positions : target.positions);
        });
    Marks marks;
    marks.pinned = pinned_pairs(features);
    for (const Feature& f : features) {
        if (f.kind == FeatureKind::kPoint) {
            if (!f.hard) marks.soft_points.push_back(&f);
            marks.pose_pairs.push_back({f.source.rows.front(), f.target.rows.front()});
            ++marks.pose_points;
        } else if (f.kind == FeatureKind::kCurve) {
            const auto traced = [&](const KdTree<3>& tree, const Normals& normals,
                                    const Marked& marked) {
                return trace_curve(tree, normals, marked.rows, f.closed, progress);
            };
            marks.curves.push_back({traced(*source_tree, source.normals, f.source),
                                    traced(*target_tree, target.normals, f.target), f.hard,
                                    f.weight});
            add_pose_pairs(marks.curves.back(), *source_tree, source.normals, *target_tree,
                           target.normals, marks.pose_pairs);
        } else {
            const IndexPair centers{central_row(f.source, source.positions),
                                    central_row(f.target, target.positions)};
            marks.regions.push_back({&f, centers});
            marks.pose_pairs.push_back(centers);
        }
    }
    marks.source_members = memberships(marks.regions, source.positions.rows(), &Feature::source);
    marks.target_members = memberships(marks.regions, target.positions.rows(), &Feature::target);
    return marks;
}

std::vector<MarkedCurve> with_target_moved(std::vector<MarkedCurve> curves,
                                           const Similarity& move) {
    for (MarkedCurve& curve : curves) curve.target = moved(std::move(curve.target), move);
    return curves;
}

CurvePlaces places_along(const MarkedCurve& curve, double spacing) {
    const double length = std::max(curve.source.length(), curve.target.length());
    const bool closed = curve.source.closed;
    const auto steps = std::max<Eigen::Index>(closed ? 3 : 1, std::lround(length / spacing));
    const Eigen::Index count = steps + (closed ? 0 : 1);
    CurvePlaces places{Positions(count, 3), Positions(count, 3), Normals(count, 3),
                       Normals(count, 3)};
    for (Eigen::Index k = 0; k < count; ++k) {
        const double share = static_cast<double>(k) / static_cast<double>(steps);
        places.source.row(k) = curve.source.at(share).transpose();
        places.target.row(k) = curve.target.at(share).transpose();
        places.source_normals.row(k) = curve.source.normals.row(curve.source.before(share));
        places.target_normals.row(k) = curve.target.normals.row(curve.target.before(share));
    }
    return places;
}

std::array<Guides, 2> guides_of(const CoarsePair& shapes, const Marks& marks, double node_spacing,
                                const RegistrationOptions& options) {
    const auto [places, weights] = guide_places(shapes, marks, node_spacing, options);
    if (places.empty()) return {};
    const auto guides = [&, &places = places, &weights = weights](const CoarseShape& shape,
                                                                  Positions CurvePlaces::*positions,
                                                                  Normals CurvePlaces::*normals) {
        const KdTree<3> tree(shape.positions);
        Guides result;
        result.weights =
            Eigen::Map<const Values>(weights.data(), static_cast<Eigen::Index>(weights.size()));
        result.places.resize(result.weights.size(), 3);
        for (const CurvePlaces& part : places)
            for (Eigen::Index k = 0; k < (part.*positions).rows(); ++k) {
                result.places.row(result.size()) = (part.*positions).row(k);
                result.coarse_rows.push_back(nearest_on_sheet(
                    tree, shape.normals, (part.*positions).row(k), (part.*normals).row(k)));
            }
        return result;
    };
    return {guides(shapes.source, &CurvePlaces::source, &CurvePlaces::source_normals),
            guides(shapes.target, &CurvePlaces::target, &CurvePlaces::target_normals)};
}

RegionLabels region_labels(Labels members, std::span<const MarkedRegion> regions,
                           const RegistrationOptions& options) {
    if (regions.empty()) return {};
    RegionLabels result{std::move(members), {}};
    result.pulls = Values::Zero(result.labels.rows());
    for (std::size_t r = 0; r < regions.size(); ++r) {
        const Feature& f = *regions[r].feature;
        auto label = result.labels.col(static_cast<Eigen::Index>(r));
        const double weight = f.hard ? std::max(kHardRegion, f.weight) : f.weight;
        result.pulls += options.region_weight * weight * label;
        label *= options.label_distance * std::min(1.0, weight);
    }
    return result;
}

DynamicRows hard_region_members(std::span<const Feature> features, Marked Feature::*side,
                                Eigen::Index points) {
    std::vector<Values> columns;
    for (const Feature& feature : features) {
        if (feature.kind != FeatureKind::kRegion || !feature.hard) continue;
        Values& column = columns.emplace_back(Values::Zero(points));
        const Marked& marked = feature.*side;
        for (std::size_t i = 0; i < marked.rows.size(); ++i)
            column[marked.rows[i]] = marked.weight(i);
    }
    DynamicRows members(columns.empty() ? 0 : points, static_cast<Eigen::Index>(columns.size()));
    for (std::size_t c = 0; c < columns.size(); ++c)
        members.col(static_cast<Eigen::Index>(c)) = columns[c];
    return members;
}

Pairing pairs_within_regions(const RegionPoints& source, const RegionPoints& target,
                             std::span<const IndexPair> pinned, Progress& progress) {
    if (source.members.cols() == 0)
        return mutual_pairs<12>(source.points, target.points, pinned, progress);
    return mutual_pairs<32>(labeled_points(source.points, source.members),
                            labeled_points(target.points, target.members), pinned, progress);
}

}  // namespace pointmorph

#include "morph/point_features.hpp"

#include <algorithm>
#include <cmath>

#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

bool contains(std::span<const Index> rows, Index row) {
    return std::ranges::find(rows, row) != rows.end();
}

/// Adds pairs along a curve, its ends first: the rows nearest to places at the same shares of the
/// length, the more the longer it is. Leaves out rows that are taken, and pairs that lie on one rim
/// only.
void add_curve(std::vector<PointFeature>& features, const RouteInput& input, const Rims& rims,
               const Feature& curve, Progress& progress) {
    constexpr double kApart = 0.3;  // of the unit ball's radius
    constexpr int kMost = 9;
    const PreparedShape &source = input.source, &target = input.target;
    const KdTree<3> source_tree(source.positions), target_tree(target.positions);
    const TracedCurve on_source =
        trace_curve(source_tree, source.normals, curve.source.rows, curve.closed, progress);
    const TracedCurve on_target =
        trace_curve(target_tree, target.normals, curve.target.rows, curve.closed, progress);
    const double length = std::max(on_source.length(), on_target.length());
    const int steps =
        std::clamp(static_cast<int>(std::lround(length / kApart)), curve.closed ? 3 : 1, kMost - 1);
    const auto row = [](const TracedCurve& traced, const KdTree<3>& tree, const Normals& normals,
                        double share) {
        return nearest_on_sheet(tree, normals, traced.at(share).transpose(),
                                traced.normals.row(traced.before(share)));
    };
    const auto add = [&](int step, double share) {
        const IndexPair rows{row(on_source, source_tree, source.normals, share),
                             row(on_target, target_tree, target.normals, share)};
        const bool taken = std::ranges::any_of(features, [&](const PointFeature& f) {
            return f.rows.source == rows.source || f.rows.target == rows.target;
        });
        if (!taken && contains(rims.source, rows.source) == contains(rims.target, rows.target))
            features.push_back({curve.name + " " + std::to_string(step), rows});
    };
    add(0, 0.0);
    if (!curve.closed) add(steps, 1.0);
    for (int step = 1; step < steps; ++step) add(step, static_cast<double>(step) / steps);
}

}  // namespace

std::vector<PointFeature> point_features(const RouteInput& input, const Rims& rims,
                                         Progress& progress) {
    std::vector<PointFeature> result;
    for (const Feature& f : input.features) {
        if (f.kind == FeatureKind::kPoint)
            result.push_back({f.name, {f.source.rows.front(), f.target.rows.front()}});
        else if (f.kind == FeatureKind::kCurve)
            add_curve(result, input, rims, f, progress);
    }
    return result;
}

std::vector<IndexPair> rows_of(std::span<const PointFeature> features) {
    std::vector<IndexPair> rows;
    for (const PointFeature& f : features) rows.push_back(f.rows);
    return rows;
}

}  // namespace pointmorph

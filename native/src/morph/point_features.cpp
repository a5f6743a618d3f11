#include "morph/point_features.hpp"

#include <algorithm>
#include <cmath>

#include "pointmorph/base/error.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

/// Pairs along a curve, its ends first: rows nearest to places at the same shares of the length, as
/// many as the length asks for. None of a row that is taken, and none that lies on one boundary
/// only.
void add_curve(std::vector<PointFeature>& features, const Side& source, const Side& target,
               const Feature& curve, Progress& progress) {
    constexpr double kApart = 0.3;  // of the unit ball's radius
    constexpr int kMost = 9;
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
        const auto on_boundary = [](const Side& side, Index i) {
            return std::ranges::find(side.loop, i) != side.loop.end();
        };
        if (!taken && on_boundary(source, rows.source) == on_boundary(target, rows.target))
            features.push_back({curve.name + " " + std::to_string(step), rows});
    };
    add(0, 0.0);
    if (!curve.closed) add(steps, 1.0);
    for (int step = 1; step < steps; ++step) add(step, static_cast<double>(step) / steps);
}

}  // namespace

std::vector<PointFeature> point_features(const Side& source, const Side& target,
                                         std::span<const Feature> features,
                                         const MorphOptions& options, MorphReport& report,
                                         Progress& progress) {
    std::vector<PointFeature> result;
    bool soft = false;
    for (const Feature& f : features) {
        if (f.kind == FeatureKind::kPoint)
            result.push_back({f.name, {f.source.rows.front(), f.target.rows.front()}});
        else if (f.kind == FeatureKind::kCurve)
            add_curve(result, source, target, f, progress);
        else if (options.method == Method::kPaper)
            throw FeatureError("feature \"" + f.name + "\"", "points and curves with method paper",
                               "a region",
                               "Only method auto knows regions: take that, or mark "
                               "points along the region's border.");
        soft = soft || !f.hard;
    }
    if (soft && options.method == Method::kPaper)
        report.warnings.emplace_back(
            "Method paper has no soft features: all points, and some of each curve, are brought "
            "together exactly.");
    return result;
}

}  // namespace pointmorph

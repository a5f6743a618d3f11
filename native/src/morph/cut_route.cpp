#include "morph/cut_route.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "morph/patch_cloud.hpp"
#include "morph/point_features.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/disk/decomposition.hpp"

namespace pointmorph {

namespace {

/// One patch of a cut shape.
PatchCloud patch_of(const Side& side, const Decomposition& cut, Patch patch) {
    std::vector<Index> rows;
    for (Index i = 0; i < static_cast<Index>(cut.patches.size()); ++i)
        if (cut.patches[to_size(i)] == patch) rows.push_back(i);
    return PatchCloud(side, std::move(rows), cut.curve);
}

/// Onto the unit sphere; the equator is the circle.
Eigen::RowVector3d lifted(const Eigen::RowVector2d& u, bool above) {
    const double squared = u.squaredNorm();
    const double height = (1.0 - squared) / (1.0 + squared);
    return {2.0 * u.x() / (1.0 + squared), 2.0 * u.y() / (1.0 + squared), above ? height : -height};
}

/// Features inside the patches that don't lie on the same side of both curves, and how many there
/// are inside.
struct Astray {
    std::vector<std::size_t> features;
    std::size_t inside = 0;

    Astray(const Decomposition& source_cut, const Decomposition& target_cut,
           std::span<const PointFeature> known) {
        for (std::size_t k = 0; k < known.size(); ++k) {
            const Patch s = source_cut.patches[to_size(known[k].rows.source)];
            if (s == Patch::kCurve) continue;
            ++inside;
            if (s != target_cut.patches[to_size(known[k].rows.target)]) features.push_back(k);
        }
    }

    /// The loops run round the models in opposite senses.
    bool is_mirrored() const { return features.size() == inside && inside > 1; }

    std::string names(std::span<const PointFeature> known) const {
        std::string names;
        for (const std::size_t k : features)
            names += (names.empty() ? "\"" : ", \"") + known[k].name + "\"";
        return names;
    }

    void check(std::span<const PointFeature> known) const {
        if (features.empty()) return;
        if (is_mirrored())
            throw FeatureError("loop", "a loop that runs round both models in the same sense",
                               "all other features (" + names(known) + ") on opposite sides of it",
                               "Check left and right: the loop's features are swapped on one of "
                               "the models, or the normals of one point inwards.");
        const bool one = features.size() == 1;
        throw FeatureError("loop",
                           "every other feature on the same side of the loop on both models",
                           names(known) + (one ? " left of it on one model and right on the other"
                                               : " on opposite sides"),
                           "Take " + std::string(one ? "it" : "them") +
                               " into the loop, move the mark, or leave it out.");
    }
};

/// The loop's features would fit much better if one model were a mirror image: left and right are
/// probably swapped.
bool looks_mirrored(const Decomposition& source, const Decomposition& target,
                    const std::array<std::vector<double>, 2>& angles) {
    // The curves as wholes: points at equal angles.
    constexpr int kSamples = 256;
    const auto sampled = [&](const Decomposition& cut, const std::vector<double>& angle) {
        Positions points(kSamples, 3);
        const auto count = angle.size();
        const double turn = 2.0 * std::acos(-1.0);
        std::size_t k = 0;
        for (int i = 0; i < kSamples; ++i) {
            const double goal = angle[0] + turn * i / kSamples;
            while (k + 1 < count && angle[k + 1] <= goal) ++k;
            points.row(i) = cut.curve.points.row(static_cast<Eigen::Index>(k));
        }
        return points;
    };
    return fits_better_mirrored(sampled(source, angles[0]), sampled(target, angles[1]));
}

}  // namespace

CutRoute match_in_patches(Side& source, Side& target, const MorphInput& input,
                          std::span<const Feature> marked, const MorphOptions& options,
                          MorphReport& report, Progress& progress) {
    progress.enter("decomposition");
    // The loop's features first, in its order.
    std::vector<PointFeature> known =
        point_features(source, target, marked, options, report, progress);
    const auto free = std::ranges::stable_partition(known, [&](const PointFeature& f) {
        return std::ranges::find(input.loop, f.name) != input.loop.end();
    });
    const std::span in_loop(known.begin(), free.begin());
    std::ranges::sort(in_loop, {}, [&](const PointFeature& f) {
        return std::ranges::find(input.loop, f.name) - input.loop.begin();
    });
    const auto cut_open = [&](const Side& side, Index IndexPair::*row, double first, double last,
                              std::span<const Patch> wanted = {}) {
        const Progress::Part part(progress, first, last);
        std::vector<Index> rows;
        for (const PointFeature& f : known) rows.push_back(f.rows.*row);
        const KdTree<3> tree(side.positions);
        return decompose({side.positions, side.normals, side.nearest, side.cloud.name}, tree,
                         {rows, input.loop, wanted}, options.decomposition, progress);
    };
    Decomposition source_cut = cut_open(source, &IndexPair::source, 0.0, 0.4);
    Decomposition target_cut = cut_open(target, &IndexPair::target, 0.4, 0.8);
    const Astray astray(source_cut, target_cut, known);
    if (!astray.features.empty() && !astray.is_mirrored()) {
        // The curve that passes nearer to the feature is led round it, to where the other has it.
        const auto distance = [](const Side& side, const Decomposition& cut, Index row) {
            return (cut.curve.points.rowwise() - side.positions.row(row))
                       .rowwise()
                       .norm()
                       .minCoeff() /
                   curve_length(cut.curve.points);
        };
        std::array<std::vector<Patch>, 2> wanted;
        std::array<std::string, 2> names;
        for (std::size_t k = in_loop.size(); k < known.size(); ++k) {
            wanted[0].push_back(source_cut.patches[to_size(known[k].rows.source)]);
            wanted[1].push_back(target_cut.patches[to_size(known[k].rows.target)]);
        }
        constexpr double kNear = 0.05;  // farther ones were marked somewhere else
        for (const std::size_t k : astray.features) {
            const double s = distance(source, source_cut, known[k].rows.source);
            const double t = distance(target, target_cut, known[k].rows.target);
            if (std::min(s, t) > kNear) astray.check(known);
            const std::size_t led = s <= t ? 0 : 1, place = k - in_loop.size();
            wanted[led][place] = wanted[1 - led][place];
            names[led] += (names[led].empty() ? "\"" : ", \"") + known[k].name + "\"";
        }
        try {
            if (!names[0].empty())
                source_cut = cut_open(source, &IndexPair::source, 0.8, 0.9, wanted[0]);
            if (!names[1].empty())
                target_cut = cut_open(target, &IndexPair::target, 0.9, 1.0, wanted[1]);
        } catch (const Error&) {  // the way round crosses the loop, or leaves no patch
            astray.check(known);
        }
        for (const std::size_t side : {0u, 1u})
            if (!names[side].empty())
                report.warnings.emplace_back(
                    "The cut of " + (side == 0 ? source : target).cloud.name + " was led round " +
                    names[side] + ", to have it on the same side as on the other model.");
    }
    Astray(source_cut, target_cut, known).check(known);
    const auto angles = rim_angles(source_cut.curve, source_cut.corners, target_cut.curve,
                                   target_cut.corners, options.parameterization.boundary_spacing);
    if (looks_mirrored(source_cut, target_cut, angles))
        report.warnings.emplace_back(
            "The loop fits much better when one model is mirrored: check that left and right are "
            "not swapped and that the normals of both point outwards.");

    CutRoute route;
    route.source.resize(source.positions.rows(), 3);
    route.target.resize(target.positions.rows(), 3);
    const auto spread = [&](KdTree<3>::Points& sphere, const PatchCloud& cloud,
                            const DiskPoints& disk, bool above) {
        for (std::size_t i = 0; i < cloud.rows.size(); ++i)
            sphere.row(cloud.rows[i]) = lifted(disk.row(static_cast<Eigen::Index>(i)), above);
    };
    for (const Patch patch : {Patch::kLeft, Patch::kRight}) {
        const bool above = patch == Patch::kLeft;
        const PatchCloud source_patch = patch_of(source, source_cut, patch);
        const PatchCloud target_patch = patch_of(target, target_cut, patch);
        progress.enter("parameterization");
        const auto onto_disk = [&](const Side& side, const PatchCloud& cloud,
                                   const std::vector<double>& angle, ParameterizationReport& said,
                                   double first, double last) {
            const Progress::Part part(progress, first, last);
            said.boundary_points = static_cast<Index>(cloud.loop.size());
            return on_disk(side, cloud, angle, options, said, report, progress);
        };
        const double done = above ? 0.0 : 0.5;
        DiskPoints source_disk = onto_disk(source, source_patch, angles[0],
                                           report.source_parameterization, done, done + 0.25);
        DiskPoints target_disk = onto_disk(target, target_patch, angles[1],
                                           report.target_parameterization, done + 0.25, done + 0.5);

        progress.enter("alignment");
        std::vector<IndexPair> inside;
        for (const auto& [name, rows] : known)
            if (source_cut.patches[to_size(rows.source)] == patch)
                inside.push_back(
                    {source_patch.place(rows.source), target_patch.place(rows.target)});
        const auto tips = paired_extremities(
            source_cut.unmarked, target_cut.unmarked, kLargestDifference, [&](Index s, Index t) {
                return source_cut.patches[to_size(s)] != patch ||
                               target_cut.patches[to_size(t)] != patch
                           ? kNoPair
                           : (source_disk.row(source_patch.place(s)) -
                              target_disk.row(target_patch.place(t)))
                                 .norm();
            });
        for (const auto& [s, t] : tips) {
            inside.push_back({source_patch.place(s), target_patch.place(t)});
            report.tips.push_back({source.order[to_size(s)], target.order[to_size(t)]});
        }
        const Alignment alignment =
            align_features(source_disk, target_disk, inside, true, options.alignment, progress);
        report.feature_residual = std::max(report.feature_residual, alignment.residual);
        report.alignment_sweeps = std::max(report.alignment_sweeps, alignment.sweeps);
        spread(route.source, source_patch, source_disk, above);
        spread(route.target, target_patch, target_disk, above);
    }
    for (std::size_t k = 0; k < in_loop.size(); ++k) {
        const double angle = angles[0][to_size(source_cut.corners[k])];
        const Eigen::RowVector3d corner(std::cos(angle), std::sin(angle), 0.0);
        route.source.row(in_loop[k].rows.source) = corner;
        route.target.row(in_loop[k].rows.target) = corner;
    }

    progress.enter("pairing");
    std::vector<IndexPair> features;
    for (const PointFeature& f : known) features.push_back(f.rows);
    route.pairs = pair_points<3>(route.source, route.target, features, options.pairing, progress);
    return route;
}

}  // namespace pointmorph

#include "morph/cut_route.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "morph/point_features.hpp"
#include "morph/words.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/similarity.hpp"

namespace pointmorph {

namespace {

/// The features, those of the loop first and in its order.
struct LoopFeatures {
    std::vector<PointFeature> all;
    std::size_t in_loop = 0;

    LoopFeatures(std::vector<PointFeature> features, std::span<const std::string> loop)
        : all(std::move(features)) {
        const auto place = [&](const PointFeature& f) {
            return std::ranges::find(loop, f.name) - loop.begin();
        };
        const auto rest = std::ranges::stable_partition(all, [&](const PointFeature& f) {
            return place(f) != static_cast<std::ptrdiff_t>(loop.size());
        });
        in_loop = to_size(rest.begin() - all.begin());
        std::ranges::sort(all.begin(), rest.begin(), {}, place);
    }
};

struct Cuts {
    Decomposition source, target;
};

/// Features inside the patches that don't lie on the same side of both curves, and how many there
/// are inside.
struct Astray {
    std::vector<std::size_t> features;
    std::size_t inside = 0;

    Astray(const Cuts& cuts, std::span<const PointFeature> known) {
        for (std::size_t k = 0; k < known.size(); ++k) {
            const Patch s = cuts.source.patches[to_size(known[k].rows.source)];
            if (s == Patch::kCurve) continue;
            ++inside;
            if (s != cuts.target.patches[to_size(known[k].rows.target)]) features.push_back(k);
        }
    }

    /// The loops run round the models in opposite directions.
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
            throw FeatureError("loop", "a loop that runs around both models in the same direction",
                               "all other features (" + names(known) + ") on opposite sides of it",
                               "Check left and right: the loop's features are swapped on one of "
                               "the models, or the normals of one point inward.");
        const bool one = features.size() == 1;
        throw FeatureError("loop",
                           "every other feature on the same side of the loop on both models",
                           names(known) + (one ? " left of it on one model and right on the other"
                                               : " on opposite sides"),
                           "Add " + std::string(one ? "it" : "them") +
                               " to the loop, move the mark, or remove it.");
    }
};

/// How far a point lies from the curve, in lengths of the curve.
double distance_from_curve(const PreparedShape& shape, const Decomposition& cut, Index row) {
    return (cut.curve.points.rowwise() - shape.positions.row(row)).rowwise().norm().minCoeff() /
           curve_length(cut.curve.points);
}

/// What is cut, and along which of its features.
struct CutTask {
    const RouteInput& input;
    const LoopFeatures& known;
    std::span<const std::string> loop;
    const DecompositionOptions& options;
};

/// Both shapes cut so that all features lie on the same side of both curves. Where a feature
/// doesn't, the curve that passes nearer to it is led round it, to where the other one has it.
Cuts cut_alike(const CutTask& task, const CutGrounds& grounds, std::vector<std::string>& warnings,
               Progress& progress) {
    const RouteInput& input = task.input;
    const LoopFeatures& known = task.known;
    std::vector<Index> source_rows, target_rows;
    for (const PointFeature& f : known.all) {
        source_rows.push_back(f.rows.source);
        target_rows.push_back(f.rows.target);
    }
    const auto cut = [&](bool is_source, Progress& its, std::span<const Patch> wanted = {}) {
        return decompose(grounds[is_source],
                         {is_source ? source_rows : target_rows, task.loop, wanted}, task.options,
                         its);
    };
    Cuts cuts;
    {
        const Progress::Part part(progress, 0.2, 0.8);
        on_both(progress, [&](bool is_source, Progress& its) {
            (is_source ? cuts.source : cuts.target) = cut(is_source, its);
        });
    }
    const Astray astray(cuts, known.all);
    if (astray.features.empty()) return cuts;
    if (astray.is_mirrored()) astray.check(known.all);

    std::array<std::vector<Patch>, 2> wanted;
    std::array<std::string, 2> names;
    for (std::size_t k = known.in_loop; k < known.all.size(); ++k) {
        wanted[0].push_back(cuts.source.patches[to_size(source_rows[k])]);
        wanted[1].push_back(cuts.target.patches[to_size(target_rows[k])]);
    }
    constexpr double kNear = 0.05;  // farther ones were marked somewhere else
    for (const std::size_t k : astray.features) {
        const double s = distance_from_curve(input.source, cuts.source, source_rows[k]);
        const double t = distance_from_curve(input.target, cuts.target, target_rows[k]);
        if (std::min(s, t) > kNear) astray.check(known.all);
        const std::size_t led = s <= t ? 0 : 1, place = k - known.in_loop;
        wanted[led][place] = wanted[1 - led][place];
        names[led] += (names[led].empty() ? "\"" : ", \"") + known.all[k].name + "\"";
    }
    try {
        const Progress::Part part(progress, 0.8, 1.0);
        on_both(progress, [&](bool is_source, Progress& its) {
            const std::size_t k = is_source ? 0 : 1;
            if (!names[k].empty())
                (is_source ? cuts.source : cuts.target) = cut(is_source, its, wanted[k]);
        });
    } catch (const Error&) {  // the way round crosses the loop, or leaves no patch
        astray.check(known.all);
    }
    for (const std::size_t k : {0u, 1u})
        if (!names[k].empty())
            warnings.push_back(
                cut_was_led_around((k == 0 ? input.source : input.target).name, names[k]));
    Astray(cuts, known.all).check(known.all);
    return cuts;
}

using RimAngles = std::array<std::vector<double>, 2>;

/// The loop's features would fit much better if one model were a mirror image: left and right are
/// probably swapped.
bool looks_mirrored(const Cuts& cuts, const RimAngles& angles) {
    // The curves as wholes: points at equal angles.
    constexpr int kSamples = 256;
    const auto sampled = [&](const Decomposition& cut, const std::vector<double>& angle) {
        Positions points(kSamples, 3);
        const auto count = angle.size();
        const double circle = 2.0 * std::acos(-1.0);
        std::size_t k = 0;
        for (int i = 0; i < kSamples; ++i) {
            const double goal = angle[0] + circle * i / kSamples;
            while (k + 1 < count && angle[k + 1] <= goal) ++k;
            points.row(i) = cut.curve.points.row(static_cast<Eigen::Index>(k));
        }
        return points;
    };
    return fits_better_mirrored(sampled(cuts.source, angles[0]), sampled(cuts.target, angles[1]));
}

PatchCloud patch_of(const PreparedShape& shape, const Decomposition& cut, Patch patch) {
    std::vector<Index> rows;
    for (Index i = 0; i < to_index(cut.patches.size()); ++i)
        if (cut.patches[to_size(i)] == patch) rows.push_back(i);
    return PatchCloud(shape, std::move(rows), cut.curve);
}

/// From the disk onto the unit sphere; the rim is the equator.
Eigen::RowVector3d on_sphere(const Eigen::RowVector2d& u, bool above) {
    const double squared = u.squaredNorm();
    const double height = (1.0 - squared) / (1.0 + squared);
    return {2.0 * u.x() / (1.0 + squared), 2.0 * u.y() / (1.0 + squared), above ? height : -height};
}

/// Lays both patches of both shapes onto the disk, aligned, and from there onto their halves of the
/// sphere, and gathers what comes of it.
class PatchLayout {
public:
    PatchLayout(const RouteInput& input, const Cuts& cuts, const RimAngles& angles,
                std::span<const PointFeature> known, const PatchOptions& options,
                RouteResult& result)
        : input_(input),
          cuts_(cuts),
          angles_(angles),
          known_(known),
          options_(options),
          result_(result) {
        result.source_domain.resize(input.source.size(), 3);
        result.target_domain.resize(input.target.size(), 3);
    }

    void lay_out(Progress& progress) {
        progress.enter("parameterization");
        std::array<LaidOut, 2> patches;  // by Patch
        parallel_invoke(4, progress, [&](int k, Progress& its) {
            lay_onto_disk(k % 2 == 0, static_cast<Patch>(k / 2), patches[to_size(k / 2)], its);
        });
        for (LaidOut& patch : patches) report(patch);
        progress.enter("alignment");
        for (const Patch patch : {Patch::kLeft, Patch::kRight}) {
            LaidOut& laid_out = patches[to_size(static_cast<int>(patch))];
            align(patch, laid_out, progress);
            parallel_invoke(2, [&](int k, bool) { spread(k == 0, patch, laid_out[to_size(k)]); });
        }
    }

private:
    struct OnDisk {
        std::optional<PatchCloud> cloud;
        PatchOnDisk disk;
    };
    /// One patch of source and target.
    using LaidOut = std::array<OnDisk, 2>;

    const PreparedShape& shape(bool is_source) const {
        return is_source ? input_.source : input_.target;
    }

    void lay_onto_disk(bool is_source, Patch patch, LaidOut& laid_out, Progress& progress) const {
        auto& [cloud, disk] = laid_out[is_source ? 0 : 1];
        cloud = patch_of(shape(is_source), is_source ? cuts_.source : cuts_.target, patch);
        disk = on_disk(shape(is_source), *cloud, angles_[is_source ? 0 : 1], options_, progress);
    }

    void report(const LaidOut& patch) {
        for (const bool is_source : {true, false}) {
            const auto& [cloud, disk] = patch[is_source ? 0 : 1];
            RouteFacts& facts = result_.facts;
            auto& said = is_source ? facts.source_parameterization : facts.target_parameterization;
            said.add(disk.facts);
            said.boundary_points = to_index(cloud->loop.size());
            warn_of_joined(disk, shape(is_source), result_.warnings);
        }
    }

    void align(Patch patch, LaidOut& laid_out, Progress& progress) {
        RouteFacts& facts = result_.facts;
        const PatchCloud &source = *laid_out[0].cloud, &target = *laid_out[1].cloud;
        DiskPoints &on_source = laid_out[0].disk.points, &on_target = laid_out[1].disk.points;
        std::vector<IndexPair> inside;
        for (const auto& [name, rows] : known_)
            if (cuts_.source.patches[to_size(rows.source)] == patch)
                inside.push_back({source.patch_row(rows.source), target.patch_row(rows.target)});
        const auto extremities = paired_extremities(
            cuts_.source.unmarked, cuts_.target.unmarked, kLargestDifference,
            [&](Index s, Index t) {
                if (cuts_.source.patches[to_size(s)] != patch ||
                    cuts_.target.patches[to_size(t)] != patch)
                    return kNoPair;
                return (on_source.row(source.patch_row(s)) - on_target.row(target.patch_row(t)))
                    .norm();
            });
        for (const auto& [s, t] : extremities) {
            inside.push_back({source.patch_row(s), target.patch_row(t)});
            facts.extremities.push_back({s, t});
        }
        const Alignment alignment =
            align_features(on_source, on_target, inside, true, options_.alignment, progress);
        facts.feature_residual = std::max(facts.feature_residual, alignment.residual);
        facts.alignment_sweeps = std::max(facts.alignment_sweeps, alignment.sweeps);
    }

    void spread(bool is_source, Patch patch, const OnDisk& on_disk) {
        DomainPoints& sphere = is_source ? result_.source_domain : result_.target_domain;
        for (std::size_t i = 0; i < on_disk.cloud->rows.size(); ++i)
            sphere.row(on_disk.cloud->rows[i]) = on_sphere(
                on_disk.disk.points.row(static_cast<Eigen::Index>(i)), patch == Patch::kLeft);
    }

    const RouteInput& input_;
    const Cuts& cuts_;
    const RimAngles& angles_;
    std::span<const PointFeature> known_;
    const PatchOptions& options_;
    RouteResult& result_;
};

}  // namespace

CutGrounds::CutGrounds(const RouteInput& input, std::span<const IndexPair> features,
                       const DecompositionOptions& options, Progress& progress) {
    on_both(progress, [&](bool is_source, Progress& its) {
        const PreparedShape& shape = is_source ? input.source : input.target;
        Side& side = sides_[is_source ? 0 : 1];
        std::vector<Index> rows;
        for (const IndexPair& f : features) rows.push_back(is_source ? f.source : f.target);
        side.tree.emplace(shape.tree());
        side.ground.emplace(shape.surface(), *side.tree, rows, options, its);
    });
}

bool CutGrounds::have(std::span<const IndexPair> features) const {
    std::vector<Index> on_source, on_target;
    for (const IndexPair& f : features) {
        on_source.push_back(f.source);
        on_target.push_back(f.target);
    }
    return (*this)[true].has(on_source) && (*this)[false].has(on_target);
}

RouteResult match_in_patches(const RouteInput& input, std::span<const std::string> loop,
                             const CutGrounds* known_grounds, const CutRouteOptions& options,
                             Progress& progress) {
    RouteResult result;
    result.domain = "cut";
    progress.enter("decomposition");
    const LoopFeatures known(point_features(input, {}, progress), loop);
    std::optional<CutGrounds> own;
    if (!known_grounds || !known_grounds->have(rows_of(known.all))) {
        const Progress::Part part(progress, 0.0, 0.2);
        own.emplace(input, rows_of(known.all), options.decomposition, progress);
    }
    const Cuts cuts = cut_alike({input, known, loop, options.decomposition},
                                own ? *own : *known_grounds, result.warnings, progress);
    const RimAngles angles =
        rim_angles(cuts.source.curve, cuts.source.corners, cuts.target.curve, cuts.target.corners,
                   options.patches.parameterization.boundary_spacing);
    if (looks_mirrored(cuts, angles)) result.warnings.push_back(fits_mirrored("The loop fits"));

    PatchLayout layout(input, cuts, angles, known.all, options.patches, result);
    layout.lay_out(progress);
    for (std::size_t k = 0; k < known.in_loop; ++k) {
        const double angle = angles[0][to_size(cuts.source.corners[k])];
        const Eigen::RowVector3d corner(std::cos(angle), std::sin(angle), 0.0);
        result.source_domain.row(known.all[k].rows.source) = corner;
        result.target_domain.row(known.all[k].rows.target) = corner;
    }

    progress.enter("pairing");
    KdTree<3>::Points source_sphere, target_sphere;
    parallel_invoke(2, [&](int k, bool) {
        (k == 0 ? source_sphere : target_sphere) =
            k == 0 ? result.source_domain : result.target_domain;
    });
    result.pairs = pair_points<3>(source_sphere, target_sphere, rows_of(known.all),
                                  options.patches.pairing, progress);
    return result;
}

}  // namespace pointmorph

#include "pointmorph/morph.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <utility>

#include "pointmorph/covariance.hpp"
#include "pointmorph/error.hpp"
#include "pointmorph/kd_tree.hpp"
#include "pointmorph/neighborhoods.hpp"
#include "pointmorph/parallel.hpp"

namespace pointmorph {

namespace {

/// Fewer points can't have an inside, a boundary and neighbourhoods.
constexpr Index kMinimumPoints = 16;

/// Mirroring one disk must bring the features this much closer before estimated normals are taken
/// to point inwards on one side.
constexpr double kMirrorFactor = 0.5;

void check_features(const Cloud& cloud, std::span<const Feature> features, Index Feature::*row_of) {
    std::unordered_map<Index, std::string> taken;
    for (const Feature& feature : features) {
        const std::string subject = "feature \"" + feature.name + "\"";
        const Index row = feature.*row_of;
        if (row < 0 || row >= cloud.size())
            throw FeatureError(
                subject, "a point of " + cloud.name + ", 0 to " + std::to_string(cloud.size() - 1),
                "point " + std::to_string(row), "Mark it again on " + cloud.name + ".");
        const auto [other, is_new] = taken.emplace(row, feature.name);
        if (!is_new)
            throw FeatureError(
                subject, "a point of its own on " + cloud.name,
                "point " + std::to_string(row) + ", which is \"" + other->second + "\" already",
                "Move or remove one of the two.");
    }
}

/// Open patches have their boundary; a loop is for closed models.
void check_loop(const MorphInput& input) {
    for (std::size_t i = 0; i < input.loop.size(); ++i) {
        const auto& name = input.loop[i];
        if (std::ranges::find(input.features, name, &Feature::name) == input.features.end())
            throw FeatureError("loop", "names of features", "\"" + name + "\", which isn't one",
                               "Mark that feature on both models, or take it out of the loop.");
        if (std::find(input.loop.begin(), input.loop.begin() + static_cast<std::ptrdiff_t>(i),
                      name) != input.loop.begin() + static_cast<std::ptrdiff_t>(i))
            throw FeatureError("loop", "each feature once", "\"" + name + "\" twice",
                               "Take one of the two out of the loop.");
    }
    if (!input.loop.empty() && input.loop.size() < 3)
        throw FeatureError("loop", "at least 3 features", std::to_string(input.loop.size()),
                           "Add features to the loop, or leave it out.");
}

/// One of the two shapes on its way through the stages: normalised, in spatial order.
struct Side {
    explicit Side(Cloud& as_given) : cloud(as_given) {}

    Cloud& cloud;              ///< as given; missing normals and radii are filled in
    std::vector<Index> order;  ///< row here → row as given
    std::vector<Index> rank;   ///< the inverse
    double scale = 1.0;        ///< unit of the cloud as given
    Positions positions;
    Normals normals;
    bool normals_given = false;
    Neighborhoods nearest;
    BoundaryLoop loop;
    std::vector<Index> features;
    DiskPoints disk;

    void order_points() {
        order = spatial_order(cloud.positions);
        rank = inverse_order(order);
        const Normalization unit = normalization(cloud.positions);
        scale = unit.scale;
        positions = unit.apply(gather(cloud.positions, order));
        normals_given = cloud.normals.rows() > 0;
        if (normals_given) normals = gather(cloud.normals, order).rowwise().normalized();
    }

    void find_normals(Progress& progress) {
        if (!normals_given) {
            normals = covariance_analysis(positions, nearest, progress).normals;
            orient_normals(positions, nearest, normals, progress);
        }
        if (cloud.radii.rows() == 0) {
            const Values spacing = local_spacing(positions, nearest);
            cloud.radii.resize(spacing.size());
            for (std::size_t i = 0; i < order.size(); ++i)
                cloud.radii[order[i]] = spacing[static_cast<Eigen::Index>(i)] * scale;
        }
    }

    /// The boundary given, or the longest that is found.
    void find_boundary(const BoundaryLoop& given, const BoundaryOptions& options,
                       std::vector<std::string>& warnings, Progress& progress) {
        if (!given.empty()) {
            BoundaryLoop ranked;
            for (const Index row : given) {
                if (row < 0 || row >= cloud.size())
                    throw FeatureError("boundary of " + cloud.name,
                                       "points 0 to " + std::to_string(cloud.size() - 1),
                                       "point " + std::to_string(row), "Give the boundary again.");
                ranked.push_back(rank[static_cast<std::size_t>(row)]);
            }
            loop = oriented_loop(positions, normals, nearest, std::move(ranked), cloud.name);
            return;
        }
        auto loops = find_boundary_loops(positions, normals, nearest, options, progress);
        if (loops.empty())
            throw TopologyError(cloud.name, "an open patch with a boundary", "a closed surface",
                                "Cut it open (delete the faces inside a loop), or give the rows of "
                                "its boundary.");
        loop = std::move(loops.front());
        if (loops.size() > 1)
            warnings.push_back(cloud.name + ": the longest of " + std::to_string(loops.size()) +
                               " boundary loops goes to the rim of the disk, the others are "
                               "treated as holes in the patch.");
    }

    /// Turns a surface whose estimated normals pointed inwards.
    void flip() {
        normals = -normals;
        std::reverse(loop.begin(), loop.end());
        disk.col(1) *= -1.0;
    }

    /// Rows as given of rows here.
    std::vector<Index> as_given(std::span<const Index> rows) const {
        std::vector<Index> result;
        for (const Index row : rows) result.push_back(order[static_cast<std::size_t>(row)]);
        return result;
    }

    /// Puts normals that were estimated into the cloud.
    void hand_over_normals() {
        if (normals_given) return;
        cloud.normals.resize(normals.rows(), 3);
        for (std::size_t i = 0; i < order.size(); ++i)
            cloud.normals.row(order[i]) = normals.row(static_cast<Eigen::Index>(i));
    }
};

/// Runs both at once where there are two threads.
template <class Left, class Right>
void both(Left&& left, Right&& right) {
    parallel_invoke(2, [&](int side, bool) { side == 0 ? left() : right(); });
}

/// Positions of the boundary features in their loops. A feature lies on both boundaries or on
/// neither.
std::vector<IndexPair> boundary_features(const Side& source, const Side& target,
                                         std::span<const Feature> features) {
    const auto positions_in = [](const Side& side) {
        std::unordered_map<Index, Index> result;
        for (std::size_t i = 0; i < side.loop.size(); ++i)
            result.emplace(side.loop[i], static_cast<Index>(i));
        return result;
    };
    const auto on_source = positions_in(source), on_target = positions_in(target);
    std::vector<IndexPair> result;
    for (std::size_t i = 0; i < features.size(); ++i) {
        const auto s = on_source.find(source.features[i]);
        const auto t = on_target.find(target.features[i]);
        if ((s == on_source.end()) != (t == on_target.end())) {
            const bool source_has_it = s != on_source.end();
            const std::string& has = source_has_it ? source.cloud.name : target.cloud.name;
            const std::string& lacks = source_has_it ? target.cloud.name : source.cloud.name;
            throw FeatureError(
                "feature \"" + features[i].name + "\"", "a place on both boundaries or on neither",
                "one on the boundary of " + has + " and inside " + lacks,
                "Move it onto the boundary of " + lacks + ", or off that of " + has + ".");
        }
        if (s != on_source.end()) result.push_back({s->second, t->second});
    }
    return result;
}

/// Summed squared distance of the features after the best rotation of the source disk.
double misfit(const DiskPoints& source, const DiskPoints& target,
              std::span<const IndexPair> features) {
    const double angle = best_rotation(source, target, features);
    const Eigen::Rotation2Dd rotation(angle);
    double sum = 0.0;
    for (const auto& [s, t] : features)
        sum += (rotation * source.row(s).transpose() - target.row(t).transpose()).squaredNorm();
    return sum;
}

ParameterizationReport report_of(const Parameterization& p, std::size_t boundary_points) {
    return {p.unknowns, p.iterations, p.relative_residual, p.solve_seconds,
            static_cast<Index>(boundary_points)};
}

}  // namespace

struct Morph::Paths {
    std::mutex mutex;
    std::optional<Path<float>> single;
    std::optional<Path<double>> full;
};

Morph::~Morph() = default;

Morph::Morph(MorphInput input, const MorphOptions& options, Progress& progress)
    : options_(options),
      source_(std::move(input.source)),
      target_(std::move(input.target)),
      paths_(std::make_unique<Paths>()) {
    const ThreadCount threads(options.threads);
    const auto start = std::chrono::steady_clock::now();
    Side source(source_), target(target_);

    progress.enter("cloud");
    validate(source_, kMinimumPoints);
    validate(target_, kMinimumPoints);
    check_features(source_, input.features, &Feature::source);
    check_features(target_, input.features, &Feature::target);
    check_loop(input);
    both([&] { source.order_points(); }, [&] { target.order_points(); });
    std::vector<IndexPair> features;
    for (const Feature& feature : input.features) {
        features.push_back({source.rank[static_cast<std::size_t>(feature.source)],
                            target.rank[static_cast<std::size_t>(feature.target)]});
        source.features.push_back(features.back().source);
        target.features.push_back(features.back().target);
    }

    progress.enter("neighborhoods");
    {
        std::optional<KdTree<3>> source_tree, target_tree;
        both([&] { source_tree.emplace(source.positions); },
             [&] { target_tree.emplace(target.positions); });
        const auto find = [&](Side& side, const KdTree<3>& tree, double first, double last) {
            const Progress::Part part(progress, first, last);
            side.nearest = nearest_neighbors(tree, options.covariance_neighbors, progress);
        };
        find(source, *source_tree, 0.0, 0.5);
        find(target, *target_tree, 0.5, 1.0);
    }

    progress.enter("covariance");
    source.find_normals(progress);
    target.find_normals(progress);

    progress.enter("boundary");
    source.find_boundary(input.source_boundary, options.boundary, report_.warnings, progress);
    target.find_boundary(input.target_boundary, options.boundary, report_.warnings, progress);

    if (!input.loop.empty())
        throw FeatureError("loop", "no loop for open patches, whose boundary is known",
                           "one of " + std::to_string(input.loop.size()) + " features",
                           "Leave the loop out.");

    progress.enter("parameterization");
    const auto& parameterization = options.parameterization;
    auto on_boundary = boundary_features(source, target, input.features);
    Side* const turnable = !target.normals_given   ? &target
                           : !source.normals_given ? &source
                                                   : nullptr;
    MatchedPins pins;
    const auto match = [&] {
        pins = match_pins(source.positions, source.loop, target.positions, target.loop,
                          parameterization.boundary_spacing, on_boundary);
    };
    try {
        match();
    } catch (const FeatureError&) {  // the order may only seem wrong, seen from the wrong side
        if (!turnable) throw;
        turnable->flip();
        on_boundary = boundary_features(source, target, input.features);
        match();
    }
    const auto onto_disk = [&](Side& side, std::span<const BoundaryPin> side_pins, double first,
                               double last) {
        const Progress::Part part(progress, first, last);
        const auto angles = boundary_angles(side.positions, side.loop,
                                            parameterization.boundary_spacing, side_pins);
        auto result = parameterize(side.positions, side.normals, side.nearest, side.loop, angles,
                                   parameterization, side.cloud.name, progress);
        const auto report = report_of(result, side.loop.size());
        side.disk = std::move(result.points);
        return report;
    };
    report_.source_parameterization = onto_disk(source, pins.source, 0.0, 0.5);
    report_.target_parameterization = onto_disk(target, pins.target, 0.5, 1.0);
    source.nearest = {};
    target.nearest = {};

    progress.enter("alignment");
    if (features.size() >= 3 && on_boundary.empty()) {
        DiskPoints mirrored = target.disk;
        mirrored.col(1) *= -1.0;
        const double straight = misfit(source.disk, target.disk, features);
        if (misfit(source.disk, mirrored, features) < kMirrorFactor * kMirrorFactor * straight) {
            if (turnable)
                turnable->flip();
            else
                report_.warnings.push_back(
                    "The features fit much better when one model is mirrored: check that left and "
                    "right are not swapped and that the normals of both point outwards.");
        }
    }
    const Alignment alignment = align_features(source.disk, target.disk, features,
                                               !on_boundary.empty(), options.alignment, progress);

    progress.enter("pairing");
    pairs_ = pair_points<2>(source.disk, target.disk, features, options.pairing, progress);
    for (IndexPair& pair : pairs_)
        pair = {source.order[static_cast<std::size_t>(pair.source)],
                target.order[static_cast<std::size_t>(pair.target)]};
    std::ranges::sort(pairs_);
    source.hand_over_normals();
    target.hand_over_normals();
    source_domain_ = gather(source.disk, source.rank);
    target_domain_ = gather(target.disk, target.rank);
    source_boundary_ = source.as_given(source.loop);
    target_boundary_ = target.as_given(target.loop);
    progress.finish();

    if ((source_.colors.rows() == 0) != (target_.colors.rows() == 0))
        report_.warnings.push_back((source_.colors.rows() == 0 ? source_.name : target_.name) +
                                   " has no colors: white is taken for it.");
    report_.method = "paper";
    report_.domain = "disk";
    report_.stages = progress.stages();
    report_.pairs = static_cast<Index>(pairs_.size());
    report_.feature_residual = alignment.residual;
    report_.alignment_rotation = alignment.rotation;
    report_.alignment_sweeps = alignment.sweeps;
    report_.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Positions Morph::source_to_target(Progress& progress) const {
    const ThreadCount threads(options_.threads);
    progress.enter("transfer");
    auto result = transfer<2>(KdTree<2>(target_domain_), target_.positions, source_domain_,
                              options_.transfer, progress);
    progress.finish();
    return result;
}

Positions Morph::target_to_source(Progress& progress) const {
    const ThreadCount threads(options_.threads);
    progress.enter("transfer");
    auto result = transfer<2>(KdTree<2>(source_domain_), source_.positions, target_domain_,
                              options_.transfer, progress);
    progress.finish();
    return result;
}

template <class Scalar>
const Path<Scalar>& Morph::path() const {
    const std::scoped_lock lock(paths_->mutex);
    auto& path = [this]() -> std::optional<Path<Scalar>>& {
        if constexpr (std::is_same_v<Scalar, float>)
            return paths_->single;
        else
            return paths_->full;
    }();
    if (!path) path.emplace(source_, target_, pairs_);
    return *path;
}

template const Path<float>& Morph::path<float>() const;
template const Path<double>& Morph::path<double>() const;

std::vector<Cracks> Morph::cracks(std::span<const double> times, Progress& progress) const {
    const ThreadCount threads(options_.threads);
    progress.enter("cracks");
    auto result = find_cracks(source_.positions, target_.positions, pairs_, times, progress);
    progress.finish();
    return result;
}

}  // namespace pointmorph

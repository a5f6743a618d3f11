#include "pointmorph/morph.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <utility>

#include "disk_route.hpp"
#include "pointmorph/error.hpp"
#include "pointmorph/kd_tree.hpp"
#include "pointmorph/neighborhoods.hpp"
#include "pointmorph/parallel.hpp"
#include "side.hpp"

namespace pointmorph {

namespace {

/// Fewer points can't have an inside, a boundary and neighbourhoods.
constexpr Index kMinimumPoints = 16;

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

/// An image for every point, or none at all.
void check_start(const RefinementStart& start, Index source, Index target) {
    const auto s = start.source_images.rows(), t = start.target_images.rows();
    if (s == 0 && t == 0) return;
    if (s != source || t != target || !start.source_images.allFinite() ||
        !start.target_images.allFinite())
        throw CloudError("start",
                         "finite images of " + std::to_string(source) + " and " +
                             std::to_string(target) + " points",
                         "those of " + std::to_string(s) + " and " + std::to_string(t),
                         "Take the maps of a morph of these very clouds, or none.");
}

/// A loop cuts closed models; open patches have their boundary.
void check_closed(Side& source, Side& target, const MorphInput& input, const MorphOptions& options,
                  Progress& progress) {
    progress.enter("boundary");
    const Index loops = source.find_boundary(input.source_boundary, options.boundary, progress) +
                        target.find_boundary(input.target_boundary, options.boundary, progress);
    if (loops > 0)
        throw FeatureError("loop", "no loop for open patches, whose boundary is known",
                           "one of " + std::to_string(input.loop.size()) + " features",
                           "Leave the loop out.");
}

/// Where a row lies: near a feature, or towards which sides of the bounding box.
std::string where(const Cloud& cloud, Index row, std::span<const Feature> features,
                  Index Feature::*row_of) {
    constexpr double kNear = 0.1;  // of the bounding box's diagonal
    double least =
        kNear *
        (cloud.positions.colwise().maxCoeff() - cloud.positions.colwise().minCoeff()).norm();
    std::string near;
    for (const Feature& feature : features) {
        const double distance =
            (cloud.positions.row(feature.*row_of) - cloud.positions.row(row)).norm();
        if (distance > least) continue;
        least = distance;
        near = "near \"" + feature.name + "\"";
    }
    if (!near.empty()) return near;
    return direction_in_words(normalization(cloud.positions).apply(cloud.positions), row);
}

/// What may be wrong with a map that isn't sure, and which mark would settle it.
std::string doubts(const MorphReport& report, const Cloud& source, const Cloud& target,
                   std::span<const Feature> features) {
    const auto number = [](double value) {
        std::array<char, 32> text{};
        std::snprintf(text.data(), text.size(), "%.2f", value);
        return std::string(text.data());
    };
    const auto point = [&](Index row) {
        return "point " + std::to_string(row) + " of " + source.name + " (" +
               where(source, row, features, &Feature::source) + ")";
    };
    std::string text =
        "Parts may have ended up in the wrong place (confidence " + number(report.confidence) + ")";
    std::string mark;
    if (!report.rivals.empty()) {
        const Rival& rival = report.rivals.front();
        const auto other = [&]() -> std::string {
            switch (rival.swap) {
                case Swap::kEnds:
                    return "with its two ends, such as head and tail, exchanged";
                case Swap::kSides:
                    return "with its sides, such as left and right, exchanged";
                case Swap::kTurned:
                    return "turned another way";
                default:
                    break;
            }
            std::string places;
            for (const Index place : rival.places) {
                const std::string words = where(source, place, features, &Feature::source);
                if (places.find(words) != std::string::npos) continue;
                places += (places.empty() ? "" : "; ") + words;
            }
            return "with other partners for parts of it (" + places + ")";
        };
        text += ": " + source.name + " fits " + target.name + " another way too, " + other() +
                ", with " + number(rival.ratio) + " times the energy";
        mark = point(rival.source) + ", which is on point " + std::to_string(rival.target) +
               " of " + target.name + " now and would be on point " +
               std::to_string(rival.rival_target);
    } else if (!report.proposals.empty()) {
        const Proposal& weakest =
            *std::ranges::min_element(report.proposals, {}, &Proposal::confidence);
        mark = point(weakest.source) + ", which is on point " + std::to_string(weakest.target) +
               " of " + target.name + " now";
    }
    text += ". Mark one place on both models to settle it";
    return text + (mark.empty() ? "." : ", say " + mark + ".");
}

/// Runs both at once where there are two threads.
template <class Left, class Right>
void both(Left&& left, Right&& right) {
    parallel_invoke(2, [&](int side, bool) { side == 0 ? left() : right(); });
}

}  // namespace

struct Morph::Paths {
    std::mutex mutex;
    std::optional<Path<float>> single;
    std::optional<Path<double>> full;
    std::optional<Motion> source_motion, target_motion;
};

struct Morph::Measured {
    std::mutex mutex;
    std::optional<Quality> quality;
};

Morph::~Morph() = default;

Morph::Morph(MorphInput input, const MorphOptions& options, Progress& progress)
    : options_(options),
      source_(std::move(input.source)),
      target_(std::move(input.target)),
      features_(input.features),
      paths_(std::make_unique<Paths>()),
      measured_(std::make_unique<Measured>()) {
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

    if (options.method == Method::kPaper || options.domain == Domain::kDisk) {
        DiskRoute route = match_in_disk(source, target, input, options, report_, progress);
        source_domain_ = gather(route.source, source.rank);
        target_domain_ = gather(route.target, target.rank);
        pairs_ = std::move(route.pairs);
        report_.domain = "disk";
        if (options.method == Method::kAuto) {
            progress.enter("transfer");
            const RefinementStart from_disk{transfer<2>(KdTree<2>(route.target), target.positions,
                                                        route.source, options.transfer, progress),
                                            transfer<2>(KdTree<2>(route.source), source.positions,
                                                        route.target, options.transfer, progress)};
            take(refine(source.positions, source.normals, target.positions, target.normals,
                        features, options.refinement, progress, &from_disk),
                 source, target);
        }
    } else {
        if (!input.loop.empty()) check_closed(source, target, input, options, progress);
        check_start(input.start, source_.size(), target_.size());
        std::optional<RefinementStart> earlier;
        if (input.start.source_images.rows() > 0)
            earlier = {target.unit.apply(gather(input.start.source_images, source.order)),
                       source.unit.apply(gather(input.start.target_images, target.order))};
        take(refine(source.positions, source.normals, target.positions, target.normals, features,
                    options.refinement, progress, earlier ? &*earlier : nullptr),
             source, target);
    }
    for (IndexPair& pair : pairs_)
        pair = {source.order[static_cast<std::size_t>(pair.source)],
                target.order[static_cast<std::size_t>(pair.target)]};
    std::ranges::sort(pairs_);
    source.hand_over_normals();
    target.hand_over_normals();
    source_boundary_ = source.as_given(source.loop);
    target_boundary_ = target.as_given(target.loop);
    progress.finish();

    if ((source_.colors.rows() == 0) != (target_.colors.rows() == 0))
        report_.warnings.push_back((source_.colors.rows() == 0 ? source_.name : target_.name) +
                                   " has no colors: white is taken for it.");
    report_.method = options.method == Method::kPaper ? "paper" : "auto";
    report_.stages = progress.stages();
    report_.pairs = static_cast<Index>(pairs_.size());
    report_.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void Morph::take(Refinement refinement, Side& source, Side& target) {
    if (refinement.inside_out) {
        Side* const turnable = !target.normals_given   ? &target
                               : !source.normals_given ? &source
                                                       : nullptr;
        if (turnable)
            turnable->flip();
        else
            report_.warnings.push_back(
                "The normals of one model point inwards: shading will turn over on the way. "
                "Recalculate them to point outwards.");
    }
    source_images_ = target.unit.restore(gather(refinement.source_images, source.rank));
    target_images_ = source.unit.restore(gather(refinement.target_images, target.rank));
    source_domain_ = gather(refinement.source_product, source.rank);
    target_domain_ = gather(refinement.target_product, target.rank);
    pairs_ = std::move(refinement.pairs);
    report_.domain = "product";
    report_.feature_residual = 0.0;  // features are put onto their partners to the bit
    report_.margin = refinement.margin;
    report_.confidence = refinement.confidence;
    report_.rivals = std::move(refinement.rivals);
    report_.proposals = std::move(refinement.proposals);
    const auto as_given = [](const Side& side, Index& row) {
        row = side.order[static_cast<std::size_t>(row)];
    };
    for (Rival& rival : report_.rivals) {
        for (Index& place : rival.places) as_given(source, place);
        as_given(source, rival.source);
        as_given(target, rival.target);
        as_given(target, rival.rival_target);
    }
    for (Proposal& proposal : report_.proposals) {
        as_given(source, proposal.source);
        as_given(target, proposal.target);
    }
    if (report_.confidence < options_.refinement.clear_confidence)
        report_.warnings.push_back(doubts(report_, source_, target_, features_));
}

Positions Morph::source_to_target(Progress& progress) const {
    return through_domain(source_images_, source_domain_, target_domain_, target_, progress);
}

Positions Morph::target_to_source(Progress& progress) const {
    return through_domain(target_images_, target_domain_, source_domain_, source_, progress);
}

Positions Morph::through_domain(const Positions& images, const DomainPoints& from,
                                const DomainPoints& to, const Cloud& other,
                                Progress& progress) const {
    if (images.rows() > 0) return images;
    const ThreadCount threads(options_.threads);
    progress.enter("transfer");
    const DiskPoints disk = to;
    auto result = transfer<2>(KdTree<2>(disk), other.positions, from, options_.transfer, progress);
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

template <class Scalar>
void Morph::frame(double t, const FrameView<Scalar>& out) const {
    const ThreadCount threads(options_.threads);
    const bool straight = options_.path == PathKind::kLinear || t == 0.0 || t == 1.0;
    path<Scalar>().frame(t, out);
    if (straight || (out.positions.empty() && out.normals.empty())) return;

    {
        const std::scoped_lock lock(paths_->mutex);
        if (!paths_->source_motion) {
            Progress silent;
            const Positions images = source_to_target(silent), back = target_to_source(silent);
            const GradualSimilarity similarity{fit_similarity(source_.positions, images),
                                               source_.positions.colwise().mean().transpose()};
            const bool bends = options_.path == PathKind::kRigid;
            Motion from(source_.positions, source_.normals.rowwise().normalized(), images,
                        similarity, bends, silent);
            paths_->target_motion.emplace(target_.positions, target_.normals.rowwise().normalized(),
                                          back, similarity.reversed(), bends, silent);
            paths_->source_motion.emplace(std::move(from));
        }
    }
    fade(paths_->source_motion->at(t), paths_->target_motion->at(1.0 - t), pairs_, t, out.positions,
         out.normals);
}

template void Morph::frame<float>(double, const FrameView<float>&) const;
template void Morph::frame<double>(double, const FrameView<double>&) const;

std::vector<Cracks> Morph::cracks(std::span<const double> times, Progress& progress) const {
    const ThreadCount threads(options_.threads);
    progress.enter("cracks");
    auto result = find_cracks(source_.positions, target_.positions, pairs_, times, progress);
    progress.finish();
    return result;
}

const Quality& Morph::quality(Progress& progress) const {
    const std::scoped_lock lock(measured_->mutex);
    auto& quality = measured_->quality;
    if (!quality) {
        const Positions source_images = source_to_target(progress);
        const Positions target_images = target_to_source(progress);
        const ThreadCount threads(options_.threads);
        progress.enter("quality");
        quality = measure_quality(source_, target_, source_images, target_images, pairs_, features_,
                                  progress);
        progress.finish();
    }
    return *quality;
}

}  // namespace pointmorph

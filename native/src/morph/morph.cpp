#include "pointmorph/morph/morph.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <mutex>
#include <numeric>
#include <optional>
#include <utility>

#include "morph/cut_route.hpp"
#include "morph/disk_route.hpp"
#include "morph/network_route.hpp"
#include "morph/prepared_shape.hpp"
#include "morph/product_route.hpp"
#include "morph/sphere_route.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

namespace {

/// Fewer points can't have an inside, a boundary and neighbourhoods.
constexpr Index kMinimumPoints = 16;

/// Open patches have their boundary; a loop is for closed models.
void check_loop(std::span<const std::string> loop, std::span<const Feature> features) {
    for (std::size_t i = 0; i < loop.size(); ++i) {
        const auto& name = loop[i];
        const auto feature = std::ranges::find(features, name, &Feature::name);
        if (feature == features.end())
            throw FeatureError("loop", "names of features", "\"" + name + "\", which isn't one",
                               "Mark that feature on both models, or take it out of the loop.");
        if (feature->kind != FeatureKind::kPoint)
            throw FeatureError("loop", "point features",
                               "\"" + name + "\", a " + name_of(feature->kind),
                               "Take it out of the loop, or mark a point.");
        if (std::find(loop.begin(), loop.begin() + static_cast<std::ptrdiff_t>(i), name) !=
            loop.begin() + static_cast<std::ptrdiff_t>(i))
            throw FeatureError("loop", "each feature once", "\"" + name + "\" twice",
                               "Take one of the two out of the loop.");
    }
    if (!loop.empty() && loop.size() < 3)
        throw FeatureError("loop", "at least 3 features", std::to_string(loop.size()),
                           "Add features to the loop, or leave it out.");
}

void check_loops(const MorphInput& input, const MorphOptions& options) {
    check_loop(input.loop, input.features);
    for (const auto& loop : input.more_loops) check_loop(loop, input.features);
    if (!input.more_loops.empty() && options.domain != Domain::kNetwork &&
        (options.domain != Domain::kAuto || options.method != Method::kPaper))
        throw OptionError("domain", "network, where several loops are given",
                          "another with " + std::to_string(input.more_loops.size() + 1) + " loops",
                          "Give one loop, or take domain network.");
}

/// Two point features may not share a place, even where it has a row for each.
void check_places(std::span<const Feature> features, const Cloud& source, const Cloud& target) {
    const auto check = [&](const Cloud& cloud, Marked Feature::*side) {
        std::map<Index, const Feature*> at;
        for (const Feature& f : features) {
            if (f.kind != FeatureKind::kPoint) continue;
            const auto [other, is_new] = at.try_emplace((f.*side).rows.front(), &f);
            if (!is_new)
                throw FeatureError("feature \"" + f.name + "\"", "a place of its own",
                                   "that of \"" + other->second->name + "\" on " + cloud.name,
                                   "Move or remove one of the two.");
        }
    };
    check(source, &Feature::source);
    check(target, &Feature::target);
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

/// A loop cuts closed models, also with holes; open patches have their boundary.
void check_closed(Side& side, const BoundaryLoop& boundary, std::size_t features,
                  const BoundaryOptions& options, Progress& progress) {
    progress.enter("boundary");
    side.find_boundary(boundary, options, progress);
    const bool open = side.is_open();
    side.loop.clear();
    if (open && features == 0)
        throw TopologyError(side.cloud.name, "a closed surface for a network of curves",
                            "an open patch, whose boundary is known",
                            "Take domain disk or method auto.");
    if (open)
        throw FeatureError("loop", "no loop for open patches, whose boundary is known",
                           "one of " + std::to_string(features) + " features, while " +
                               side.cloud.name + " is an open patch",
                           "Leave the loop out.");
}

/// Where a row lies: near a point or curve feature, or towards which sides of the bounding box.
std::string where(const Cloud& cloud, Index row, std::span<const Feature> features,
                  Marked Feature::*marked) {
    constexpr double kNear = 0.1;  // of the bounding box's diagonal
    double least =
        kNear *
        (cloud.positions.colwise().maxCoeff() - cloud.positions.colwise().minCoeff()).norm();
    std::string near;
    for (const Feature& feature : features) {
        if (feature.kind == FeatureKind::kRegion) continue;  // which has no place of its own
        for (const Index of : (feature.*marked).rows) {
            const double distance = (cloud.positions.row(of) - cloud.positions.row(row)).norm();
            if (distance > least) continue;
            least = distance;
            near = "near \"" + feature.name + "\"";
        }
    }
    if (!near.empty()) return near;
    return direction_in_words(normalization(cloud.positions).apply(cloud.positions), row);
}

/// What may be wrong with a map that isn't sure, and which mark would settle it.
std::string doubts(const Diagnostics& found, const Cloud& source, const Cloud& target,
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
        "Parts may have ended up in the wrong place (confidence " + number(found.confidence) + ")";
    std::string mark;
    if (!found.rivals.empty()) {
        const Rival& rival = found.rivals.front();
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
                ", " + number(rival.ratio) + " times as badly";
        mark = point(rival.source) + ", which is on point " + std::to_string(rival.target) +
               " of " + target.name + " now and would be on point " +
               std::to_string(rival.rival_target);
    } else if (!found.proposals.empty()) {
        const Proposal& weakest =
            *std::ranges::min_element(found.proposals, {}, &Proposal::confidence);
        mark = point(weakest.source) + ", which is on point " + std::to_string(weakest.target) +
               " of " + target.name + " now";
    }
    text += ". Mark one place on both models to settle it";
    return text + (mark.empty() ? "." : ", say " + mark + ".");
}

/// Of the point features, for the proposal of a loop.
FeatureReach reach_of(const Side& side, std::span<const Feature> points, Marked Feature::*marked,
                      const MorphOptions& options, Progress& progress) {
    std::vector<Index> rows;
    for (const Feature& f : points) rows.push_back((f.*marked).rows.front());
    return feature_reach({side.positions, side.normals, side.nearest, side.cloud.name},
                         KdTree<3>(side.positions), rows, options.decomposition, progress);
}

/// For what is quick as it is, and asks for borders and handles only.
TopologyOptions seen_quickly(TopologyOptions options) {
    options.points = std::min<Index>(options.points, 5000);
    options.cells = std::min<Index>(options.cells, 400);
    return options;
}

/// Whether the largest piece is a closed surface that isn't known to be without handles.
bool may_have_handles(const Topology& topology) {
    const Component& largest = topology.components.front();
    return !largest.is_open && largest.genus.value_or(1) > 0;
}

/// What a domain is called in a sentence.
std::string words_for(const std::string& domain) {
    return domain == "product" ? "product space" : domain;
}

/// Names of point features that a proposed loop passes; `features` are those of both sides.
std::vector<std::string> loop_through(const Side& source, const Side& target,
                                      std::span<const Feature> features,
                                      const MorphOptions& options, Progress& progress) {
    std::vector<Feature> points;
    std::ranges::copy_if(features, std::back_inserter(points),
                         [](const Feature& f) { return f.kind == FeatureKind::kPoint; });
    std::vector<std::string> loop;
    for (const Index k :
         propose_loop(reach_of(source, points, &Feature::source, options, progress),
                      reach_of(target, points, &Feature::target, options, progress)))
        loop.push_back(points[to_size(k)].name);
    if (loop.size() < 3)
        throw FeatureError("loop", "at least 3 features for domain cut",
                           std::to_string(loop.size()),
                           "Mark the tips of all limbs on both models.");
    return loop;
}

std::span<double> span_of(Positions& rows) {
    return {rows.data(), to_size(rows.size())};
}

/// Gives the first points their share of the radius and takes out those without any.
template <class Scalar>
void hide(const Values& shares, ResampledFrame<Scalar>& frame) {
    std::size_t to = 0;
    for (std::size_t from = 0; from < frame.ids.size(); ++from) {
        const auto row = static_cast<Eigen::Index>(from);
        const double share = row < shares.size() ? shares[row] : 1.0;
        if (!(share > 0.0)) continue;
        const auto move = [&](std::vector<Scalar>& values, std::size_t width) {
            std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(width * from), width,
                        values.begin() + static_cast<std::ptrdiff_t>(width * to));
        };
        move(frame.positions, 3);
        move(frame.normals, 3);
        move(frame.colors, 4);
        move(frame.velocities, 3);
        frame.radii[to] = static_cast<Scalar>(share * static_cast<double>(frame.radii[from]));
        frame.ids[to++] = frame.ids[from];
    }
    frame.positions.resize(3 * to);
    frame.normals.resize(3 * to);
    frame.colors.resize(4 * to);
    frame.velocities.resize(3 * to);
    frame.radii.resize(to);
    frame.ids.resize(to);
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

struct Morph::Resampled {
    std::mutex mutex;
    std::optional<Resampling> resampling;
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
      resampled_(std::make_unique<Resampled>()),
      measured_(std::make_unique<Measured>()) {
    const ThreadCount threads(options.threads);
    const auto start = std::chrono::steady_clock::now();
    Side source(source_), target(target_);

    progress.enter("cloud");
    validate(source_, kMinimumPoints);
    validate(target_, kMinimumPoints);
    validate(input.features, source_, target_);
    check_loops(input, options);
    both([&] { source.order_points(kMinimumPoints); },
         [&] { target.order_points(kMinimumPoints); });

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

    progress.enter("topology");
    {
        const bool quick = options.method == Method::kPaper && options.domain != Domain::kNetwork;
        const TopologyOptions seen = quick ? seen_quickly(options.topology) : options.topology;
        on_both(progress, [&](bool is_source, Progress& p) {
            (is_source ? source : target)
                .find_topology(is_source ? input.source_parts : input.target_parts,
                               options.boundary, seen, p);
        });
        for (Side* side : {&source, &target})
            if (side->turn_outwards())
                report_.warnings.push_back("The normals of " + side->cloud.name +
                                           " pointed inwards: they were turned.");
        for (Side* side : {&source, &target})
            if (const Index specks = side->leave_out_specks(options.covariance_neighbors, progress);
                specks > 0)
                report_.warnings.push_back(side->cloud.name + ": " + std::to_string(specks) +
                                           (specks == 1 ? " point in a separate speck goes"
                                                        : " points in separate specks go") +
                                           " where the nearest of the others goes.");
        const std::string difference =
            difference_in_words(source.topology, source_.name, target.topology, target_.name);
        if (!difference.empty()) report_.warnings.push_back(difference);
    }
    const std::vector<Feature> features = canonical(input.features, source.rank, target.rank);
    check_places(features, source_, target_);

    // The paper's method, left to choose, takes what the loops and the handles ask for.
    const bool chooses = options.method == Method::kPaper && options.domain == Domain::kAuto;
    if (chooses && input.loop.empty() && may_have_handles(source.topology) &&
        may_have_handles(target.topology)) {  // look again, closely
        progress.enter("topology");
        on_both(progress, [&](bool is_source, Progress& p) {
            (is_source ? source : target)
                .find_topology(is_source ? input.source_parts : input.target_parts,
                               options.boundary, options.topology, p);
        });
    }
    const bool network =
        options.domain == Domain::kNetwork ||
        (chooses && (!input.more_loops.empty() ||
                     (may_have_handles(source.topology) && may_have_handles(target.topology))));
    const bool cut = options.domain == Domain::kCut || (chooses && !network && !input.loop.empty());
    if (cut && input.loop.empty()) {
        progress.enter("decomposition");
        input.loop = loop_through(source, target, features, options, progress);
        std::string names;
        for (const std::string& name : input.loop) names += (names.empty() ? "" : ", ") + name;
        report_.warnings.push_back("No loop was given: both models were cut along " + names + ".");
    }
    report_.loop = input.loop;
    if (network || !input.loop.empty()) {
        progress.enter("boundary");
        check_closed(source, input.source_boundary, input.loop.size(), options.boundary, progress);
        check_closed(target, input.target_boundary, input.loop.size(), options.boundary, progress);
    }
    // Pairs and domain of the paper's way, or a map from them to start from.
    const auto adopt = [&]<int Dim>(auto route, const char* domain) {
        constexpr bool kHasImages = requires {
            route.source_images;
        };
        if (options.method == Method::kPaper) {
            source_domain_ = gather(route.source, source.rank);
            target_domain_ = gather(route.target, target.rank);
            if constexpr (kHasImages) {
                source_images_ = target.unit.restore(gather(route.source_images, source.rank));
                target_images_ = source.unit.restore(gather(route.target_images, target.rank));
            }
            pairs_ = std::move(route.pairs);
            report_.domain = domain;
            return;
        }
        std::optional<RefinementStart> images;
        if constexpr (kHasImages) {
            images = {std::move(route.source_images), std::move(route.target_images)};
        } else {
            progress.enter("transfer");
            images = {transfer<Dim>(KdTree<Dim>(route.target), target.positions, route.source,
                                    options.transfer, progress),
                      transfer<Dim>(KdTree<Dim>(route.source), source.positions, route.target,
                                    options.transfer, progress)};
        }
        take(match_in_product_space(source, target, features, images, options, report_, progress),
             source, target);
    };
    if (network) {
        adopt.operator()<2>(
            match_in_network(source, target, input, features, options, report_, progress),
            "network");
    } else if (cut) {
        adopt.operator()<3>(
            match_in_patches(source, target, input, features, options, report_, progress), "cut");
    } else if (options.domain == Domain::kSphere) {
        adopt.operator()<3>(
            match_on_sphere(source, target, input, features, options, report_, progress), "sphere");
    } else if (options.method == Method::kPaper || options.domain == Domain::kDisk) {
        adopt.operator()<2>(
            match_in_disk(source, target, input, features, options, report_, progress), "disk");
    } else {
        check_start(input.start, source_.size(), target_.size());
        std::optional<RefinementStart> earlier;
        if (input.start.source_images.rows() > 0)
            earlier = {target.unit.apply(gather(input.start.source_images, source.order)),
                       source.unit.apply(gather(input.start.target_images, target.order))};
        take(match_in_product_space(source, target, features, earlier, options, report_, progress),
             source, target);
    }
    pairs_ = as_given(pairs_, source, target);
    source.hand_over_normals();
    target.hand_over_normals();
    source_boundary_ = source.as_given(source.loop);
    target_boundary_ = target.as_given(target.loop);
    progress.finish();

    if ((source_.colors.rows() == 0) != (target_.colors.rows() == 0))
        report_.warnings.push_back((source_.colors.rows() == 0 ? source_.name : target_.name) +
                                   " has no colors: white is taken for it.");
    report_.choice = words_for(report_.domain) + ": " + in_words(source.topology, target.topology);
    report_.source_topology = {{}, std::move(source.topology.components), source.topology.strays};
    report_.target_topology = {{}, std::move(target.topology.components), target.topology.strays};
    report_.method = options.method == Method::kPaper ? "paper" : "auto";
    report_.stages = progress.stages();
    report_.pairs = static_cast<Index>(pairs_.size());
    report_.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Morph::Morph(Cloud source, Cloud target, Pairing pairs, RefinementStart images,
             const MorphOptions& options)
    : options_(options),
      source_(std::move(source)),
      target_(std::move(target)),
      pairs_(std::move(pairs)),
      source_images_(std::move(images.source_images)),
      target_images_(std::move(images.target_images)),
      paths_(std::make_unique<Paths>()),
      resampled_(std::make_unique<Resampled>()),
      measured_(std::make_unique<Measured>()) {
    const auto check = [&](const Cloud& cloud, Index IndexPair::*side) {
        validate(cloud, kMinimumPoints);
        if (cloud.normals.rows() == 0 || cloud.radii.rows() == 0)
            throw CloudError(cloud.name, "normals and radii", "none",
                             "Take those of frame(0) and frame(1) of the morph.");
        std::vector<char> in_a_pair(to_size(cloud.size()));
        for (const IndexPair& pair : pairs_) {
            const Index row = pair.*side;
            if (row < 0 || row >= cloud.size())
                throw CloudError(cloud.name,
                                 "pairs of its " + std::to_string(cloud.size()) + " points",
                                 "row " + std::to_string(row), "Take the morph's own pairs.");
            in_a_pair[to_size(row)] = 1;
        }
        if (std::ranges::find(in_a_pair, 0) != in_a_pair.end())
            throw CloudError(cloud.name, "every point in a pair", "some that aren't",
                             "Take the morph's own pairs.");
    };
    check(source_, &IndexPair::source);
    check(target_, &IndexPair::target);
    check_start({source_images_, target_images_}, source_.size(), target_.size());
    if (source_images_.rows() > 0) return;
    const auto mean_of_partners = [&](const Cloud& cloud, Index IndexPair::*side,
                                      const Cloud& other, Index IndexPair::*other_side) {
        Positions mean = Positions::Zero(cloud.size(), 3);
        Values count = Values::Zero(cloud.size());
        for (const IndexPair& pair : pairs_) {
            mean.row(pair.*side) += other.positions.row(pair.*other_side);
            count[pair.*side] += 1.0;
        }
        return Positions(mean.array().colwise() / count.array());
    };
    source_images_ = mean_of_partners(source_, &IndexPair::source, target_, &IndexPair::target);
    target_images_ = mean_of_partners(target_, &IndexPair::target, source_, &IndexPair::source);
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
    report_.diagnostics = refinement.diagnostics.with_rows(source.order, target.order);
    if (report_.diagnostics.confidence < options_.refinement.clear_confidence)
        report_.warnings.push_back(doubts(report_.diagnostics, source_, target_, features_));
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
    Positions result;
    if (to.cols() == 2) {
        const DiskPoints disk = to;
        result = transfer<2>(KdTree<2>(disk), other.positions, from, options_.transfer, progress);
    } else {
        const KdTree<3>::Points sphere = to;
        result = transfer<3>(KdTree<3>(sphere), other.positions, from, options_.transfer, progress);
    }
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

const Resampling& Morph::resampling(Progress& progress) const {
    const std::scoped_lock lock(resampled_->mutex);
    auto& resampling = resampled_->resampling;
    if (!resampling) {
        const ThreadCount threads(options_.threads);
        progress.enter("resampling");
        const auto frame_at = [this](double t) {
            const auto rows = static_cast<Eigen::Index>(pairs_.size());
            OrientedPoints cloud{Positions(rows, 3), Normals(rows, 3)};
            frame<double>(t, {span_of(cloud.positions), span_of(cloud.normals), {}, {}});
            return cloud;
        };
        resampling.emplace(source_, target_, pairs_, frame_at, options_.resampling, progress);
        progress.finish();
    }
    return *resampling;
}

/// Change of the pairs' places with t.
Positions Morph::velocities(double t) const {
    const auto rows = static_cast<Eigen::Index>(pairs_.size());
    Positions before(rows, 3), after(rows, 3);
    // On straight paths the whole way; else a piece short enough, but not the ends themselves,
    // whose own numbers differ from the path's by rounding.
    const bool straight = options_.path == PathKind::kLinear;
    constexpr double kStep = 1e-3, kInside = 1e-6;
    const double first = straight ? 0.0 : std::max(t - kStep, kInside);
    const double last = straight ? 1.0 : std::min(t + kStep, 1.0 - kInside);
    frame<double>(first, {span_of(before), {}, {}, {}});
    frame<double>(last, {span_of(after), {}, {}, {}});
    return (after - before) / (last - first);
}

template <class Scalar>
ResampledFrame<Scalar> Morph::resampled_frame(double t, Progress& progress) const {
    const Resampling& resampling = this->resampling(progress);
    const ThreadCount threads(options_.threads);
    const std::size_t pairs = pairs_.size();
    ResampledFrame<Scalar> result;
    result.positions.resize(3 * pairs);
    result.normals.resize(3 * pairs);
    result.colors.resize(4 * pairs);
    result.radii.resize(pairs);
    frame<Scalar>(t, {result.positions, result.normals, result.colors, result.radii});

    progress.enter("resampled frame");
    using Rows = Eigen::Matrix<Scalar, Eigen::Dynamic, 3, Eigen::RowMajor>;
    const auto rows = static_cast<Eigen::Index>(pairs);
    const Positions velocities = this->velocities(t);
    result.velocities.resize(3 * pairs);
    Eigen::Map<Rows>(result.velocities.data(), rows, 3) = velocities.template cast<Scalar>();
    result.ids.resize(pairs);
    std::iota(result.ids.begin(), result.ids.end(), 0);

    OrientedPoints cloud{
        Eigen::Map<const Rows>(result.positions.data(), rows, 3).template cast<double>(),
        Eigen::Map<const Rows>(result.normals.data(), rows, 3).template cast<double>()};
    cloud.normals.rowwise().normalize();  // at the ends they are as given
    const Resampling::Alive alive = resampling.at(t, cloud, progress);
    const std::size_t count = pairs + alive.ids.size();
    result.positions.resize(3 * count);
    result.normals.resize(3 * count);
    result.colors.resize(4 * count);
    result.radii.resize(count);
    result.velocities.resize(3 * count);
    result.ids.resize(count);
    parallel_for(static_cast<Index>(alive.ids.size()), progress, [&](Index begin, Index end) {
        for (auto i = to_size(begin); i < to_size(end); ++i) {
            const InsertedPoint& point = resampling.points()[to_size(alive.ids[i])];
            const auto row = static_cast<Eigen::Index>(i);
            const std::size_t to = pairs + i;
            const auto mean = [&](auto&& value) {
                double sum = 0.0;
                for (std::size_t c = 0; c < 3; ++c)
                    sum += point.weights[c] * static_cast<double>(value(to_size(point.pairs[c])));
                return sum;
            };
            for (std::size_t d = 0; d < 3; ++d) {
                const auto axis = static_cast<Eigen::Index>(d);
                result.positions[3 * to + d] = static_cast<Scalar>(alive.positions(row, axis));
                result.normals[3 * to + d] = static_cast<Scalar>(alive.normals(row, axis));
                result.velocities[3 * to + d] = static_cast<Scalar>(mean([&](std::size_t pair) {
                    return velocities(static_cast<Eigen::Index>(pair), axis);
                }));
            }
            for (std::size_t d = 0; d < 4; ++d)
                result.colors[4 * to + d] = static_cast<Scalar>(
                    mean([&](std::size_t pair) { return result.colors[4 * pair + d]; }));
            result.radii[to] = static_cast<Scalar>(
                alive.share[row] * mean([&](std::size_t pair) { return result.radii[pair]; }));
            result.ids[to] = static_cast<Index>(pairs) + alive.ids[i];
        }
    });
    if (!resampling.hidden().empty()) hide(resampling.pair_shares(t), result);
    progress.finish();
    return result;
}

template ResampledFrame<float> Morph::resampled_frame<float>(double, Progress&) const;
template ResampledFrame<double> Morph::resampled_frame<double>(double, Progress&) const;

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
        quality = measure_quality({source_, target_, source_images, target_images, pairs_},
                                  features_, progress);
        progress.finish();
    }
    return *quality;
}

Decomposition decompose(Cloud cloud, std::span<const Index> loop,
                        std::span<const std::string> names, const MorphOptions& options,
                        Progress& progress) {
    const ThreadCount threads(options.threads);
    progress.enter("cloud");
    validate(cloud, kMinimumPoints);
    std::vector<Feature> features;
    for (std::size_t k = 0; k < loop.size(); ++k)
        features.push_back(point_feature(names[k], loop[k], loop[k]));
    validate(features, cloud, cloud);
    check_loop(names, features);
    Side side(cloud);
    side.order_points(kMinimumPoints);
    std::vector<Index> rows;
    for (const Index row : loop) rows.push_back(side.rank[to_size(row)]);

    progress.enter("neighborhoods");
    const KdTree<3> tree(side.positions);
    side.nearest = nearest_neighbors(tree, options.covariance_neighbors, progress);
    progress.enter("covariance");
    side.find_normals(progress);
    progress.enter("boundary");
    check_closed(side, {}, loop.size(), options.boundary, progress);
    progress.enter("decomposition");
    Decomposition cut = decompose({side.positions, side.normals, side.nearest, cloud.name}, tree,
                                  {rows, names}, options.decomposition, progress);
    progress.finish();
    cut.curve.points = side.unit.restore(cut.curve.points);
    std::vector<Patch> patches(cut.patches.size());
    for (std::size_t i = 0; i < patches.size(); ++i)
        patches[i] = cut.patches[to_size(side.rank[i])];
    cut.patches = std::move(patches);
    return cut;
}

namespace {

/// As the routes want it, closed.
void prepare_closed(Side& side, std::size_t features, const MorphOptions& options,
                    Progress& progress) {
    side.order_points(kMinimumPoints);
    progress.enter("neighborhoods");
    side.nearest =
        nearest_neighbors(KdTree<3>(side.positions), options.covariance_neighbors, progress);
    progress.enter("covariance");
    side.find_normals(progress);
    check_closed(side, {}, features, options.boundary, progress);
}

}  // namespace

std::vector<std::string> propose_loop(Cloud source, Cloud target, std::vector<Feature> features,
                                      const MorphOptions& options, Progress& progress) {
    const ThreadCount threads(options.threads);
    progress.enter("cloud");
    validate(source, kMinimumPoints);
    validate(target, kMinimumPoints);
    validate(features, source, target);
    Side from(source), to(target);
    for (Side* side : {&from, &to}) prepare_closed(*side, features.size(), options, progress);
    progress.enter("decomposition");
    std::vector<std::string> loop =
        loop_through(from, to, canonical(features, from.rank, to.rank), options, progress);
    progress.finish();
    return loop;
}

NamedNetwork trace_network(MorphInput input, const MorphOptions& options, Progress& progress) {
    const ThreadCount threads(options.threads);
    progress.enter("cloud");
    validate(input.source, kMinimumPoints);
    validate(input.target, kMinimumPoints);
    validate(input.features, input.source, input.target);
    MorphOptions chosen = options;
    chosen.domain = Domain::kNetwork;
    check_loops(input, chosen);
    Side source(input.source), target(input.target);
    for (Side* side : {&source, &target}) {
        prepare_closed(*side, 0, options, progress);
        progress.enter("topology");
        side->find_topology(side == &source ? input.source_parts : input.target_parts,
                            options.boundary, options.topology, progress);
        side->turn_outwards();
    }
    const std::vector<Feature> features = canonical(input.features, source.rank, target.rank);
    check_places(features, input.source, input.target);
    MorphReport report;
    TracedNetwork traced =
        traced_network(source, target, input, features, options, report, progress);
    progress.finish();
    NamedNetwork result{std::move(traced.network), std::move(traced.names)};
    const std::array<const Side*, 2> sides{&source, &target};
    for (const std::size_t m : {0u, 1u}) {
        for (NetworkCurve& curve : result.network.curves)
            curve.on[m].points = sides[m]->unit.restore(curve.on[m].points);
        std::vector<Index> labels;
        for (const Index row : sides[m]->rank)
            labels.push_back(result.network.labels[m][to_size(row)]);
        result.network.labels[m] = std::move(labels);
    }
    return result;
}

}  // namespace pointmorph

#include "pointmorph/morph/morph.hpp"

#include <algorithm>
#include <chrono>
#include <numeric>
#include <ranges>
#include <utility>

#include "base/unused_memory.hpp"
#include "base/work_aside.hpp"
#include "morph/found_map.hpp"
#include "morph/input_checks.hpp"
#include "morph/mesh_side.hpp"
#include "morph/morph_caches.hpp"
#include "morph/prepared_shape.hpp"
#include "morph/routes.hpp"
#include "morph/words.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/morph/live_morph.hpp"
#include "registration/pinning.hpp"

namespace pointmorph {

namespace {

void append(std::vector<std::string>& warnings, const std::vector<std::string>& more) {
    warnings.insert(warnings.end(), more.begin(), more.end());
}

Topology without_labels(Topology topology) {
    topology.labels.clear();
    return topology;
}

/// Whether both have the same vertices and faces, and features that match each with itself.
bool is_same_mesh(const Cloud& source, const Cloud& target, std::span<const Feature> features) {
    return source.size() == target.size() && source.faces.size() > 0 &&
           source.faces.offsets == target.faces.offsets &&
           source.faces.corners == target.faces.corners && source.positions == target.positions &&
           std::ranges::all_of(features,
                               [](const Feature& f) { return f.source.rows == f.target.rows; });
}

/// The mean of each row's partners.
Positions mean_of_partners(Index rows, const Pairing& pairs, Index IndexPair::*side,
                           const Positions& other, Index IndexPair::*other_side) {
    Positions mean = Positions::Zero(rows, 3);
    Values count = Values::Zero(rows);
    for (const IndexPair& pair : pairs) {
        mean.row(pair.*side) += other.row(pair.*other_side);
        count[pair.*side] += 1.0;
    }
    return Positions(mean.array().colwise() / count.array());
}

/// What was found of a cloud with that many points; none where some stood for several, or for
/// none, and where fewer neighbors were looked up than are measured with.
std::optional<OrderedNeighbors> known_neighbors(PreparedShape shape, Index points) {
    const bool enough = shape.size() == points && to_index(shape.nearest[0].size()) >=
                                                      std::min(kNeighborsToMeasure, points - 1);
    if (!enough) return std::nullopt;
    return OrderedNeighbors{std::move(shape.given_rows), std::move(shape.nearest)};
}

const std::vector<std::shared_ptr<const Morph>>& checked(
    const std::vector<std::shared_ptr<const Morph>>& legs) {
    if (legs.empty() || std::ranges::find(legs, nullptr) != legs.end())
        throw CloudError("chain", "at least one morph, and no empty one", "none",
                         "Give morphs of the same points, in order.");
    return legs;
}

}  // namespace

/// Of many points, next to each other: the system takes its time to take pages back.
Morph::~Morph() {
    const ThreadCount threads(options_.threads);
    free_both(source_.size() + target_.size(), [this](bool is_source) {
        (is_source ? source_ : target_) = {};
        (is_source ? source_domain_ : target_domain_).resize(0, 0);
        (is_source ? source_images_ : target_images_).resize(0, 3);
        (is_source ? caches_->source_neighbors : caches_->target_neighbors).reset();
        (is_source ? caches_->source_motion : caches_->target_motion).reset();
    });
}

Morph::Morph(MorphInput input, const MorphOptions& options, Progress& progress)
    : options_(options),
      features_(input.features),
      source_parts_(input.source_parts),
      target_parts_(input.target_parts),
      caches_(std::make_unique<Caches>()) {
    const ThreadCount threads(options.threads);
    const auto start = std::chrono::steady_clock::now();
    progress.enter("cloud");
    check_shapes(input, options);
    check_loops(input, options);
    check_start(input.start, input.source, input.target);
    if (options.method == Method::kPaper) check_for_paper(input.features);
    delays_ = delays(input.source.positions, input.delays, options.stagger);
    MeshSides meshes = mesh_sides(input, options, progress);
    if (meshes.any()) {
        append(report_.warnings, turned_faces(input, meshes));
        find_map(sampled_input(input, meshes), FoundOn::kSamples, progress);
        meshes_ = std::make_unique<const MeshMorph>(MeshMorph{
            std::make_shared<const MeshSides>(std::move(meshes)), source_images_, target_images_,
            std::move(input.source_holds), std::move(input.target_holds)});
        carry(std::move(input), {}, progress);
    } else {
        find_map(std::move(input), FoundOn::kPoints, progress);
    }
    conclude(progress, start);
}

Morph::Morph(MorphInput input, const MorphOptions& options, Progress& progress,
             const std::string& why)
    : Morph(std::move(input), options, progress) {
    report_.update = why;
    report_.warnings.push_back(why);
}

Morph::Morph(FoundMap found, const MorphOptions& options, Progress& progress)
    : options_(options),
      source_(std::move(found.source)),
      target_(std::move(found.target)),
      features_(found.input.features),
      source_parts_(found.input.source_parts),
      target_parts_(found.input.target_parts),
      caches_(std::make_unique<Caches>()) {
    delays_ = delays(found.input.source.positions, found.input.delays, options.stagger);
    take(std::move(found.correspondence));
    report_.method = "auto";
    report_.update = "updated";
    if (found.sides) {
        meshes_ = std::make_unique<const MeshMorph>(
            MeshMorph{std::move(found.sides), source_images_, target_images_,
                      found.input.source_holds, found.input.target_holds});
        carry(std::move(found.input), found.offsets, progress);
    }
    report_.diagnostics = found.judged.followed_by(report_.diagnostics);
    if (found.images.source_images.rows() > 0) {
        source_images_ = std::move(found.images.source_images);
        target_images_ = std::move(found.images.target_images);
    }
    conclude(progress, found.began);
}

/// What is told of any map once it is there.
void Morph::conclude(Progress& progress, std::chrono::steady_clock::time_point began) {
    progress.finish();
    of_shapes_ = report_.warnings.size();
    if (report_.diagnostics.confidence < options_.refinement.clear_confidence)
        report_.warnings.push_back(doubts(report_.diagnostics, source_, target_, features_));
    append(report_.warnings, color_warnings(source_, target_));
    if (options_.path_kind() == PathKind::kLinear)
        append(report_.warnings, straight_path_warnings(source_, target_, pairs_));
    report_.stages = progress.stages();
    report_.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}

std::vector<std::string> Morph::warnings_of_shapes() const {
    const auto first = report_.warnings.begin();
    return {first, first + static_cast<std::ptrdiff_t>(of_shapes_)};
}

MorphInput Morph::input() const {
    MorphInput input{.source = source_, .target = target_, .features = features_};
    input.start = {source_images_, target_images_};
    input.source_parts = source_parts_;
    input.target_parts = target_parts_;
    if (meshes_) {
        input.source_holds = meshes_->source_holds;
        input.target_holds = meshes_->target_holds;
    }
    input.delays = delays_;
    return input;
}

Morph Morph::updated(std::vector<Feature> features, Progress& progress) const {
    return LiveMorph(*this, progress).updated(std::move(features), progress);
}

/// From both clouds to the map between their points.
void Morph::find_map(MorphInput input, FoundOn rows, Progress& progress) {
    keep_unused_memory(input.source.size() + input.target.size());
    const bool paper = options_.method == Method::kPaper;
    const MorphOptions& options = options_;
    PreparedShapes shapes = prepare_both(input, preparation(options), progress);
    append(report_.warnings, preparation_warnings(shapes, !paper));
    if (!input.source_counts.empty()) append(report_.warnings, handle_warnings(shapes));
    const std::vector<Feature> features =
        canonical(input.features, shapes.source.sorted_rows, shapes.target.sorted_rows);
    check_places(features, shapes.source, shapes.target);
    if (paper) append(report_.warnings, paper_warnings(features));

    source_ = std::move(input.source);
    target_ = std::move(input.target);
    std::optional<WorkAside> aside;
    if (options.expects_frames && rows == FoundOn::kPoints &&
        source_.size() + target_.size() < kManyPoints && options.path_kind() != PathKind::kLinear) {
        on_both(progress, [&](bool is_source, Progress&) {
            (is_source ? caches_->source_ground : caches_->target_ground).normals =
                completed_normals((is_source ? source_ : target_).normals,
                                  is_source ? shapes.source : shapes.target)
                    .rowwise()
                    .normalized();
        });
        aside.emplace([this](Progress& its) { make_grounds(its); });
    }
    Correspondence found =
        find_correspondence(std::move(shapes), std::move(input), features, options, progress);
    aside.reset();
    take(std::move(found));
    report_.method = paper ? "paper" : "auto";
}

/// What paths take of both clouds alone, as far as there is time.
void Morph::make_grounds(Progress& progress) {
    for (const bool is_source : {true, false}) {
        auto& [normals, ground] = is_source ? caches_->source_ground : caches_->target_ground;
        ground.emplace((is_source ? source_ : target_).positions, normals, options_.path_kind(),
                       progress);
    }
    for (auto* its : {&caches_->source_ground, &caches_->target_ground})
        its->ground->follow(its->normals, progress);
}

/// From sorted rows to given ones: the one place where a route's result becomes the morph's own.
void Morph::take(Correspondence found) {
    PreparedShape &source = found.shapes.source, &target = found.shapes.target;
    RouteResult& result = found.result;
    if (result.genus)
        for (PreparedShape* shape : {&source, &target})
            shape->topology.components.front().genus = result.genus;

    parallel_invoke(3, [&](int k, bool) {
        if (k == 0) {  // takes as long as both others
            pairs_ = to_given(result.pairs, source, target);
            return;
        }
        const bool is_source = k == 1;
        const PreparedShape &here = is_source ? source : target,
                            &there = is_source ? target : source;
        Cloud& cloud = is_source ? source_ : target_;
        cloud = completed(std::move(cloud), here);
        (is_source ? source_domain_ : target_domain_) =
            gather(is_source ? result.source_domain : result.target_domain, here.sorted_rows);
        Positions& images = is_source ? result.images.source_images : result.images.target_images;
        if (images.rows() > 0)
            (is_source ? source_images_ : target_images_) =
                there.unit.restore(gather(images, here.sorted_rows));
        (is_source ? result.source_domain : result.target_domain).resize(0, 0);
        images.resize(0, 3);
    });
    source_boundary_ = to_given(result.source_boundary, source);
    target_boundary_ = to_given(result.target_boundary, target);

    RouteFacts& facts = report_;
    facts = std::move(result.facts);
    facts.diagnostics = facts.diagnostics.with_rows(source.given_rows, target.given_rows);
    for (auto& [s, t] : facts.extremities)
        s = source.given_rows[to_size(s)], t = target.given_rows[to_size(t)];
    append(report_.warnings, result.warnings);
    report_.domain = result.domain;
    report_.choice = choice_in_words(result.domain, source.topology, target.topology);
    report_.source_topology = without_labels(std::move(source.topology));
    report_.target_topology = without_labels(std::move(target.topology));
    report_.pairs = to_index(pairs_.size());
    caches_->source_neighbors = known_neighbors(std::move(source), source_.size());
    caches_->target_neighbors = known_neighbors(std::move(target), target_.size());
}

/// From samples of faces to the vertices: all that has rows or images. `offsets`, where there are
/// any, are added to the images of vertices, and marks met smoothly: they needn't be samples.
void Morph::carry(MorphInput input, const RefinementStart& offsets, Progress& progress) {
    progress.enter("vertices");
    const MeshSides& meshes = meshes_->sides();
    // Gives the vertex of each row that the map was found with.
    const auto carry_side = [&](const std::optional<MeshSide>& mesh, Cloud& given, Cloud& cloud,
                                Positions& images, SampleValues& domain, BoundaryLoop& boundary,
                                std::optional<OrderedNeighbors>& neighbors) {
        std::vector<Index> vertices(to_size(cloud.size()));
        std::iota(vertices.begin(), vertices.end(), 0);
        if (!mesh) return vertices;
        neighbors.reset();
        vertices = mesh->vertices_of_samples();
        cloud = mesh->completed(std::move(given));
        images = mesh->images(images, progress);
        domain = mesh->values(domain, progress);
        boundary = rows_along(vertices, boundary);
        return vertices;
    };
    const std::vector<Index> source_vertices =
        carry_side(meshes.source, input.source, source_, source_images_, source_domain_,
                   source_boundary_, caches_->source_neighbors);
    const std::vector<Index> target_vertices =
        carry_side(meshes.target, input.target, target_, target_images_, target_domain_,
                   target_boundary_, caches_->target_neighbors);
    const std::vector<IndexPair> pinned = pinned_pairs(input.features);
    if (offsets.source_images.rows() > 0) {
        source_images_ += offsets.source_images;
        target_images_ += offsets.target_images;
        meet_smoothly(pinned);
    }
    if (is_same_mesh(source_, target_, input.features)) {
        source_images_ = target_.positions;
        target_images_ = source_.positions;
    }
    for (const IndexPair& f : pinned) {
        source_images_.row(f.source) = target_.positions.row(f.target);
        target_images_.row(f.target) = source_.positions.row(f.source);
    }
    pairs_ = pairs_in_domain({source_domain_, target_domain_}, input.features, pinned, progress);
    report_.pairs = to_index(pairs_.size());
    report_.diagnostics = report_.diagnostics.with_rows(source_vertices, target_vertices);
    for (auto& [s, t] : report_.extremities)
        s = source_vertices[to_size(s)], t = target_vertices[to_size(t)];
}

/// Vertices moved so that marks meet, with those around, where the samples have been moved.
void Morph::meet_smoothly(std::span<const IndexPair> pinned) {
    const MeshSides& meshes = meshes_->sides();
    if (meshes.source)
        source_images_ = pinned_to_marks(
            std::move(source_images_), source_.positions, target_.positions,
            {pinned, &IndexPair::source, &IndexPair::target}, meshes.source->spacing());
    if (meshes.target)
        target_images_ = pinned_to_marks(
            std::move(target_images_), target_.positions, source_.positions,
            {pinned, &IndexPair::target, &IndexPair::source}, meshes.target->spacing());
}

Morph::Morph(KeptMorph kept, const MorphOptions& options)
    : options_(options),
      source_(std::move(kept.source)),
      target_(std::move(kept.target)),
      pairs_(std::move(kept.pairs)),
      source_images_(std::move(kept.images.source_images)),
      target_images_(std::move(kept.images.target_images)),
      caches_(std::make_unique<Caches>()) {
    for (const Cloud* cloud : {&source_, &target_}) {
        validate(*cloud, 0);
        if (cloud->normals.rows() == 0 || cloud->radii.rows() == 0)
            throw CloudError(cloud->name, "normals and radii", "none",
                             "Use those of the morph's frame(0) and frame(1).");
    }
    check_pairs(pairs_, source_, target_);
    check_start({source_images_, target_images_}, source_, target_);
    delays_ = delays(source_.positions, kept.delays, options.stagger);
    if (kept.resampling)
        caches_->resampling.emplace(std::move(*kept.resampling), to_index(pairs_.size()),
                                    options.resampling);
    caches_->wrapped_source.keep(source_, target_, std::move(kept.source_ends));
    caches_->wrapped_target.keep(target_, source_, std::move(kept.target_ends));
    if (source_images_.rows() > 0) return;
    source_images_ = mean_of_partners(source_.size(), pairs_, &IndexPair::source, target_.positions,
                                      &IndexPair::target);
    target_images_ = mean_of_partners(target_.size(), pairs_, &IndexPair::target, source_.positions,
                                      &IndexPair::source);
}

Morph::Morph(std::vector<std::shared_ptr<const Morph>> legs, const MorphOptions& options,
             const Values& delays)
    : Morph(KeptMorph{.source = checked(legs).front()->source_,
                      .target = checked(legs).back()->target_,
                      .pairs = pairs_through(checked(legs)),
                      .delays = delays},
            options) {
    legs_ = std::move(legs);
}

Pairing Morph::pairs_through(const std::vector<std::shared_ptr<const Morph>>& legs) {
    Pairing pairs = legs.front()->pairs_;
    for (const auto& leg : legs | std::views::drop(1)) {
        const bool fits =
            std::ranges::equal(pairs, leg->pairs_, {}, &IndexPair::target, &IndexPair::source);
        if (!fits)
            throw CloudError(leg->source_.name, "pairs that continue those of the previous morph",
                             "others", "Give morphs of the same points, in order.");
        for (std::size_t i = 0; i < pairs.size(); ++i) pairs[i].target = leg->pairs_[i].target;
    }
    return pairs;
}

}  // namespace pointmorph

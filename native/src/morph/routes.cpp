#include "morph/routes.hpp"

#include <algorithm>
#include <iterator>
#include <optional>
#include <utility>

#include "morph/cut_route.hpp"
#include "morph/disk_route.hpp"
#include "morph/input_checks.hpp"
#include "morph/product_route.hpp"
#include "morph/sphere_route.hpp"
#include "morph/words.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

/// Whether the largest component is closed and not known to have no handles.
bool may_have_handles(const PreparedShape& shape) {
    const Component& largest = shape.topology.components.front();
    return !largest.is_open && largest.genus.value_or(1) > 0;
}

bool both_may_have_handles(const PreparedShapes& shapes) {
    return may_have_handles(shapes.source) && may_have_handles(shapes.target);
}

/// The paper's method, left to choose, takes what the loops and the handles ask for.
bool may_choose(const MorphOptions& options) {
    return options.method == Method::kPaper && options.domain == Domain::kAuto;
}

/// kAuto: the product space.
Domain chosen_domain(const PreparedShapes& shapes, const MorphInput& input,
                     const MorphOptions& options) {
    if (!may_choose(options)) return options.domain;
    if (!input.more_loops.empty() || both_may_have_handles(shapes)) return Domain::kNetwork;
    return input.loop.empty() ? Domain::kDisk : Domain::kCut;
}

PatchOptions patch_options(const MorphOptions& options) {
    return {.neighbors = options.covariance_neighbors,
            .parameterization = options.parameterization,
            .alignment = options.alignment,
            .pairing = options.pairing};
}

/// Runs the route over a common domain of the paper's method.
RouteResult match_in_domain(Domain domain, const RouteInput& shapes, const MorphInput& input,
                            const CutGrounds* grounds, const MorphOptions& options,
                            Progress& progress) {
    switch (domain) {
        case Domain::kNetwork:
            return match_in_network(shapes, loops_of(input),
                                    {.decomposition = options.decomposition,
                                     .patches = patch_options(options),
                                     .transfer = options.transfer},
                                    progress);
        case Domain::kCut:
            return match_in_patches(
                shapes, input.loop, grounds,
                {.decomposition = options.decomposition, .patches = patch_options(options)},
                progress);
        case Domain::kSphere:
            return match_on_sphere(shapes,
                                   {.parameterization = options.spherical_parameterization,
                                    .alignment = options.spherical_alignment,
                                    .pairing = options.pairing},
                                   progress);
        default:
            break;
    }
    progress.enter("boundary");
    const Boundary source =
        find_boundary(shapes.source, input.source_boundary, options.boundary, progress);
    const Boundary target =
        find_boundary(shapes.target, input.target_boundary, options.boundary, progress);
    return match_in_disk(shapes, source, target,
                         {.parameterization = options.parameterization,
                          .alignment = options.alignment,
                          .pairing = options.pairing},
                         progress);
}

/// The maps that go through the common domain.
RefinementStart images_through(const RouteResult& route, const RouteInput& shapes,
                               const TransferOptions& options, Progress& progress) {
    if (route.images.source_images.rows() > 0) return route.images;
    progress.enter("transfer");
    const auto images = [&]<int Dim>(const DomainPoints& from, const DomainPoints& to,
                                     const PreparedShape& other) {
        const typename KdTree<Dim>::Points places = to;
        return transfer<Dim>(KdTree<Dim>(places), other.positions, from, options, progress);
    };
    const auto both = [&]<int Dim>() -> RefinementStart {
        return {images.template operator()<Dim>(route.source_domain, route.target_domain,
                                                shapes.target),
                images.template operator()<Dim>(route.target_domain, route.source_domain,
                                                shapes.source)};
    };
    return route.source_domain.cols() == 2 ? both.operator()<2>() : both.operator()<3>();
}

/// The result of the product space with what the route before it found out.
RouteResult joined(RouteResult first, RouteResult refined) {
    refined.source_boundary = std::move(first.source_boundary);
    refined.target_boundary = std::move(first.target_boundary);
    refined.genus = first.genus;
    first.warnings.insert(first.warnings.end(), std::make_move_iterator(refined.warnings.begin()),
                          std::make_move_iterator(refined.warnings.end()));
    refined.warnings = std::move(first.warnings);
    first.facts.diagnostics = std::move(refined.facts.diagnostics);
    first.facts.feature_residual = 0.0;  // features are put onto their partners to the bit
    refined.facts = std::move(first.facts);
    return refined;
}

/// For what is fast, and looks for borders and handles only.
TopologyOptions fast(TopologyOptions options) {
    options.points = std::min<Index>(options.points, 5000);
    options.cells = std::min<Index>(options.cells, 400);
    return options;
}

/// Why both shapes must be closed; none where they needn't be.
std::optional<Closed> needs_closed(Domain domain, const MorphInput& input) {
    if (!input.loop.empty()) return Closed::kLoop;
    if (domain == Domain::kNetwork) return Closed::kNetwork;
    if (domain == Domain::kSphere) return Closed::kSphere;
    return {};
}

/// Both shapes with their handles counted closely, for the choice of a domain.
PreparedShapes looked_at_closely(PreparedShapes shapes, const MorphInput& input,
                                 const MorphOptions& options, Progress& progress) {
    progress.enter("handles");
    on_both(progress, [&](bool is_source, Progress& p) {
        PreparedShape& shape = is_source ? shapes.source : shapes.target;
        const KnownParts parts{is_source ? input.source_parts : input.target_parts,
                               is_source ? input.source_counts : input.target_counts};
        shape = with_topology(std::move(shape), parts, options.boundary, options.topology, p);
    });
    return shapes;
}

/// From the maps through the common domain, or from an earlier morph's, to those in the product
/// space.
RouteResult refined(const RouteInput& input, const std::optional<RefinementStart>& start,
                    Domain domain, const MorphOptions& options, Progress& progress) {
    // The disk's maps are refined with neighbors as the product space itself finds them.
    const NeighborSource neighbors =
        domain == Domain::kDisk ? NeighborSource::kSearched : NeighborSource::kPrepared;
    return match_in_product_space(
        input, start,
        {.refinement = options.refinement,
         .components = options.components,
         .neighbors = neighbors,
         .leave_missing = leaves_missing(options, input.source.positions, input.target.positions)},
        progress);
}

}  // namespace

void reverse_normals(PreparedShapes& shapes, const RouteResult& route) {
    if (route.source_is_inside_out) shapes.source = with_normals_reversed(std::move(shapes.source));
    if (route.target_is_inside_out) shapes.target = with_normals_reversed(std::move(shapes.target));
}

std::optional<RefinementStart> earlier_map(const PreparedShapes& shapes, const MorphInput& input) {
    const PreparedShape &source = shapes.source, &target = shapes.target;
    if (input.start.source_images.rows() == 0) return {};
    return RefinementStart{target.unit.apply(gather(input.start.source_images, source.given_rows)),
                           source.unit.apply(gather(input.start.target_images, target.given_rows))};
}

PreparationOptions preparation(const MorphOptions& options) {
    const bool glance = options.method == Method::kPaper && options.domain != Domain::kNetwork;
    return {.neighbors = options.covariance_neighbors,
            .boundary = options.boundary,
            .topology = glance ? fast(options.topology) : options.topology,
            .keep_trees =
                glance && (options.domain == Domain::kCut || options.domain == Domain::kSphere)};
}

void require_closed(Closed purpose, const PreparedShapes& shapes, const MorphInput& input,
                    const MorphOptions& options, Progress& progress) {
    progress.enter("boundary");
    require_closed(purpose, shapes.source, input.source_boundary, options.boundary, progress);
    require_closed(purpose, shapes.target, input.target_boundary, options.boundary, progress);
}

Loops loops_of(const MorphInput& input) {
    Loops loops = input.more_loops;
    if (!input.loop.empty()) loops.insert(loops.begin(), input.loop);
    return loops;
}

std::vector<IndexPair> single_points(std::span<const Feature> features) {
    std::vector<IndexPair> rows;
    for (const Feature& f : features)
        if (f.kind == FeatureKind::kPoint)
            rows.push_back({f.source.rows.front(), f.target.rows.front()});
    return rows;
}

std::vector<std::string> loop_through(const RouteInput& input, const CutGrounds& grounds) {
    std::vector<std::string> names;
    for (const Feature& f : input.features)
        if (f.kind == FeatureKind::kPoint) names.push_back(f.name);
    std::vector<std::string> loop;
    for (const Index k : propose_loop(feature_reach(grounds[true]), feature_reach(grounds[false])))
        loop.push_back(names[to_size(k)]);
    if (loop.size() < 3)
        throw FeatureError("loop", "at least 3 features for domain cut",
                           std::to_string(loop.size()),
                           "Mark the tips of all limbs on both models.");
    return loop;
}

Correspondence find_correspondence(PreparedShapes shapes, MorphInput given,
                                   std::span<const Feature> features, const MorphOptions& options,
                                   Progress& progress) {
    if (may_choose(options) && given.loop.empty() && both_may_have_handles(shapes))
        shapes = looked_at_closely(std::move(shapes), given, options, progress);
    const RouteInput input{shapes.source, shapes.target, features};
    const Domain domain = chosen_domain(shapes, given, options);
    std::string suggested, ignored;
    std::optional<CutGrounds> grounds;
    if (domain == Domain::kCut && given.loop.empty()) {
        progress.enter("decomposition");
        {
            const Progress::Part part(progress, 0.0, 0.2);  // the rest is the cut's
            grounds.emplace(input, single_points(features), options.decomposition, progress);
        }
        given.loop = loop_through(input, *grounds);
        suggested = loop_was_suggested(given.loop);
    }
    if (const auto purpose = needs_closed(domain, given))
        require_closed(*purpose, shapes, given, options, progress);
    RouteResult result;
    if (domain == Domain::kAuto) {
        result = refined(input, earlier_map(shapes, given), domain, options, progress);
    } else {
        result =
            match_in_domain(domain, input, given, grounds ? &*grounds : nullptr, options, progress);
        if (given.start.source_images.rows() > 0) ignored = earlier_map_was_ignored(result.domain);
        reverse_normals(shapes, result);
        if (options.method == Method::kAuto)
            result =
                joined(std::move(result),
                       refined(input, images_through(result, input, options.transfer, progress),
                               domain, options, progress));
    }
    if (result.domain == "product") reverse_normals(shapes, result);
    result.facts.loop = std::move(given.loop);
    for (const std::string& warning : {ignored, suggested})
        if (!warning.empty()) result.warnings.insert(result.warnings.begin(), warning);
    return {std::move(shapes), std::move(result)};
}

}  // namespace pointmorph

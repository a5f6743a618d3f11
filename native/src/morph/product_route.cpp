#include "morph/product_route.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "morph/words.hpp"

namespace pointmorph {

namespace {

RefinementCloud cloud_of(const PreparedShape& shape, NeighborSource neighbors) {
    return {shape.positions, shape.normals,
            neighbors == NeighborSource::kPrepared ? &shape.nearest : nullptr};
}

/// The map of the whole shapes, with each component in its counterpart where they have several.
Refinement refine_by_component(const RouteInput& input, const std::optional<RefinementStart>& start,
                               const ProductRouteOptions& options,
                               std::vector<std::string>& warnings, Progress& progress) {
    const PreparedShape &source = input.source, &target = input.target;
    const RefinementCloud source_cloud = cloud_of(source, options.neighbors),
                          target_cloud = cloud_of(target, options.neighbors);
    Refinement whole = refine(source_cloud, target_cloud, input.features, options.refinement,
                              progress, start ? &*start : nullptr);
    if (source.topology.main().size() == 1 && target.topology.main().size() == 1) return whole;

    progress.enter("pieces");
    const ComponentView source_view{source.topology, source.positions, source.normals,
                                    whole.source_images};
    const ComponentView target_view{target.topology, target.positions, target.normals,
                                    whole.target_images};
    const ComponentMatching matching =
        match_components(source_view, target_view, whole.alignment, options.components);
    for (std::string& words : components_in_words(matching, {source.topology, source.name},
                                                  {target.topology, target.name}))
        warnings.push_back(std::move(words));
    const auto marked = std::ranges::count(input.features, FeatureKind::kRegion, &Feature::kind);
    const std::vector<Feature> regions = component_regions(
        source.topology, target.topology, matching.matched, kMostRegions - to_index(marked));
    if (regions.empty()) return whole;
    if (marked == 0 && are_small(regions, source.size(), target.size(), options.components))
        return kept_apart(whole, source_view, target_view, {regions, pinned_pairs(input.features)},
                          options.components, progress);

    std::vector<Feature> all(input.features.begin(), input.features.end());
    all.insert(all.end(), regions.begin(), regions.end());
    const RefinementStart again =
        component_start(source_view, target_view, regions, whole.alignment, options.components);
    Refinement apart =
        refine(source_cloud, target_cloud, all, options.refinement, progress, &again);
    apart.diagnostics = whole.diagnostics.followed_by(apart.diagnostics);
    return apart;
}

}  // namespace

void judge_normals(bool inside_out, const PreparedShape& source, const PreparedShape& target,
                   RouteResult& result) {
    if (!inside_out) return;
    if (!target.normals_given)
        result.target_is_inside_out = true;
    else if (!source.normals_given)
        result.source_is_inside_out = true;
    else if (std::ranges::count(result.warnings, normals_disagree()) == 0)
        result.warnings.push_back(normals_disagree());
}

RouteResult match_in_product_space(const RouteInput& input,
                                   const std::optional<RefinementStart>& start,
                                   const ProductRouteOptions& options, Progress& progress) {
    RouteResult result;
    result.domain = "product";
    Refinement refined = refine_by_component(input, start, options, result.warnings, progress);
    judge_normals(refined.inside_out, input.source, input.target, result);
    result.source_domain = refined.source_product;
    result.target_domain = refined.target_product;
    result.pairs = std::move(refined.pairs);
    result.images = {std::move(refined.source_images), std::move(refined.target_images)};
    result.facts.diagnostics = std::move(refined.diagnostics);
    return result;
}

}  // namespace pointmorph

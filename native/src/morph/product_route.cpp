#include "morph/product_route.hpp"

#include <algorithm>
#include <string>
#include <utility>

namespace pointmorph {

namespace {

/// The map of the whole shapes, with each component in its counterpart where they have several.
Refinement refine_by_component(const RouteInput& input, const std::optional<RefinementStart>& start,
                               const ProductRouteOptions& options,
                               std::vector<std::string>& warnings, Progress& progress) {
    const PreparedShape &source = input.source, &target = input.target;
    const KnownNeighborhoods known = options.reuse_neighborhoods
                                         ? KnownNeighborhoods{&source.nearest, &target.nearest}
                                         : KnownNeighborhoods{};
    Refinement whole =
        refine(source.positions, source.normals, target.positions, target.normals, input.features,
               options.refinement, progress, start ? &*start : nullptr, known);
    if (source.topology.main().size() == 1 && target.topology.main().size() == 1) return whole;

    progress.enter("pieces");
    const PieceView source_view{source.topology, source.positions, whole.source_images};
    const PieceView target_view{target.topology, target.positions, whole.target_images};
    const PieceMatching matching =
        match_pieces(source_view, target_view, whole.alignment, options.pieces);
    for (std::string& words :
         pieces_in_words(matching, source.topology, source.name, target.topology, target.name))
        warnings.push_back(std::move(words));
    const auto regions = std::ranges::count(input.features, FeatureKind::kRegion, &Feature::kind);
    const std::vector<Feature> pieces =
        piece_regions(source.topology, target.topology, matching.matched,
                      kMostRegions - static_cast<Index>(regions));
    if (pieces.empty()) return whole;
    if (regions == 0 && are_small(pieces, source.size(), target.size(), options.pieces)) {
        keep_apart(whole, source_view, source.normals, target_view, target.normals, pieces,
                   pinned_pairs(input.features), options.pieces, progress);
        return whole;
    }

    std::vector<Feature> all(input.features.begin(), input.features.end());
    all.insert(all.end(), pieces.begin(), pieces.end());
    const RefinementStart again =
        piece_start(source_view, target_view, pieces, whole.alignment, options.pieces);
    Refinement apart = refine(source.positions, source.normals, target.positions, target.normals,
                              all, options.refinement, progress, &again, known);
    apart.diagnostics = whole.diagnostics.followed_by(apart.diagnostics);
    return apart;
}

}  // namespace

RouteResult match_in_product_space(const RouteInput& input,
                                   const std::optional<RefinementStart>& start,
                                   const ProductRouteOptions& options, Progress& progress) {
    RouteResult result;
    result.domain = "product";
    Refinement refined = refine_by_component(input, start, options, result.warnings, progress);
    if (refined.inside_out) {
        if (!input.target.normals_given)
            result.target_turned = true;
        else if (!input.source.normals_given)
            result.source_turned = true;
        else
            result.warnings.emplace_back(
                "The normals of one model point inwards, so its shading will flip during the "
                "morph. Recalculate them to point outwards.");
    }
    result.source_domain = refined.source_product;
    result.target_domain = refined.target_product;
    result.pairs = std::move(refined.pairs);
    result.images = {std::move(refined.source_images), std::move(refined.target_images)};
    result.facts.diagnostics = std::move(refined.diagnostics);
    return result;
}

}  // namespace pointmorph

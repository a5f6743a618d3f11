#include "morph/product_route.hpp"

#include <algorithm>
#include <utility>

#include "pointmorph/registration/components.hpp"

namespace pointmorph {

Refinement match_in_product_space(const Side& source, const Side& target,
                                  std::span<const Feature> features,
                                  const std::optional<RefinementStart>& start,
                                  const MorphOptions& options, MorphReport& report,
                                  Progress& progress) {
    // The way by the disk has let them go.
    const auto known_of = [](const Side& side) {
        return side.nearest.size() == side.positions.rows() ? &side.nearest : nullptr;
    };
    const KnownNeighborhoods known{known_of(source), known_of(target)};
    Refinement whole =
        refine(source.positions, source.normals, target.positions, target.normals, features,
               options.refinement, progress, start ? &*start : nullptr, known);
    if (source.topology.main().size() == 1 && target.topology.main().size() == 1) return whole;

    progress.enter("pieces");
    const PieceView source_view{source.topology, source.positions, whole.source_images};
    const PieceView target_view{target.topology, target.positions, whole.target_images};
    const PieceMatching matching =
        match_pieces(source_view, target_view, whole.alignment, options.pieces);
    for (std::string& words : pieces_in_words(matching, source.topology, source.cloud.name,
                                              target.topology, target.cloud.name))
        report.warnings.push_back(std::move(words));
    const auto regions = std::ranges::count(features, FeatureKind::kRegion, &Feature::kind);
    const std::vector<Feature> pieces =
        piece_regions(source.topology, target.topology, matching.matched,
                      kMostRegions - static_cast<Index>(regions));
    if (pieces.empty()) return whole;
    if (regions == 0 && are_small(pieces, static_cast<Index>(source.positions.rows()),
                                  static_cast<Index>(target.positions.rows()), options.pieces)) {
        keep_apart(whole, source_view, source.normals, target_view, target.normals, pieces,
                   pinned_pairs(features), options.pieces, progress);
        return whole;
    }

    std::vector<Feature> all(features.begin(), features.end());
    all.insert(all.end(), pieces.begin(), pieces.end());
    const RefinementStart again =
        piece_start(source_view, target_view, pieces, whole.alignment, options.pieces);
    Refinement apart = refine(source.positions, source.normals, target.positions, target.normals,
                              all, options.refinement, progress, &again, known);
    apart.diagnostics = whole.diagnostics.followed_by(apart.diagnostics);
    return apart;
}

}  // namespace pointmorph

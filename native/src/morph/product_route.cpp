#include "morph/product_route.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "morph/words.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/covariance.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "registration/divided_components.hpp"
#include "registration/lost_parts.hpp"
#include "registration/part_on_whole.hpp"
#include "surface/plugged_loops.hpp"

namespace pointmorph {

namespace {

RefinementCloud cloud_of(const PreparedShape& shape, NeighborSource neighbors,
                         std::span<const Index> ends) {
    return {shape.positions, shape.normals,
            neighbors == NeighborSource::kPrepared ? &shape.nearest : nullptr, ends};
}

double border_length(const PreparedShape& shape, std::span<const BoundaryLoop> loops) {
    double length = 0.0;
    for (const BoundaryLoop& loop : loops) length += loop_length(shape.positions, loop);
    return length / std::sqrt(estimated_area(shape.positions, shape.nearest));
}

/// Sorted rows along borders where a shape ends while the other goes on.
struct Ends {
    std::vector<Index> source, target;
};

Ends ends_of(const PreparedShape& source, const PreparedShape& target) {
    const auto rows_of = [](std::span<const BoundaryLoop> loops) {
        std::vector<Index> rows;
        for (const BoundaryLoop& loop : loops) rows.insert(rows.end(), loop.begin(), loop.end());
        std::ranges::sort(rows);
        return rows;
    };
    if (!source.loops || !target.loops) return {};
    const auto open = [](const PreparedShape& shape) {
        return unplugged_loops(shape.positions, shape.nearest, *shape.loops, shape.topology.labels);
    };
    const std::vector<BoundaryLoop> its = open(source), others = open(target);
    const double of_source = border_length(source, its), of_target = border_length(target, others);
    Ends ends;
    if (goes_on(of_source, of_target)) ends.source = rows_of(its);
    if (goes_on(of_target, of_source)) ends.target = rows_of(others);
    return ends;
}

/// Share of the points whose images lie at the other's ends, less what lies there on average.
double share_beyond(const Positions& images, const PreparedShape& other,
                    std::span<const Index> ends) {
    if (ends.empty()) return 0.0;
    std::vector<char> is_end(to_size(other.size()), 0);
    for (const Index row : ends) is_end[to_size(row)] = 1;
    Index beyond = 0;
    for (const Index nearest : nearest_rows(KdTree<3>(other.positions), images))
        beyond += is_end[to_size(nearest)];
    return std::max(0.0, static_cast<double>(beyond) / static_cast<double>(images.rows()) -
                             static_cast<double>(ends.size()) / other.size());
}

/// The turn and translation of a map as it has become, with its scale. Those that it began with may
/// be a trial's, tilted by where other parts lie.
Similarity alignment_of(const Refinement& map, const Positions& source, const Positions& target) {
    Positions from(source.rows() + target.rows(), 3), to(from.rows(), 3);
    from << map.alignment.scale * target, map.alignment.scale * map.source_images;
    to << map.target_images, source;
    return composed(fit_rigid_motion(from, to), {.scale = map.alignment.scale});
}

/// The map of the whole shapes, with each component in its counterpart where they have several.
Refinement refine_by_component(const RouteInput& input, const std::optional<RefinementStart>& start,
                               const Ends& ends, const ProductRouteOptions& options,
                               std::vector<std::string>& warnings, Progress& progress) {
    const PreparedShape &source = input.source, &target = input.target;
    const RefinementCloud source_cloud = cloud_of(source, options.neighbors, ends.source),
                          target_cloud = cloud_of(target, options.neighbors, ends.target);
    PartOrWhole found =
        refine_part_or_whole(source_cloud, target_cloud, input.features, options.refinement,
                             progress, start ? &*start : nullptr);
    Refinement whole = std::move(found.map);
    if (source.topology.main().size() == 1 && target.topology.main().size() == 1) return whole;
    const auto as_one = [&] {
        const std::string words =
            difference_in_words(source.topology, source.name, target.topology, target.name);
        if (!words.empty()) warnings.push_back(words);
        return whole;
    };
    if (found.is_part) return as_one();

    progress.enter("pieces");
    const ComponentView source_view{source.topology, source.positions, source.normals,
                                    whole.source_images, ends.source};
    const ComponentView target_view{target.topology, target.positions, target.normals,
                                    whole.target_images, ends.target};
    const std::vector<IndexPair> joined = joining_marks(input.features);
    const Similarity alignment = alignment_of(whole, source.positions, target.positions);
    const ComponentMatching matching =
        match_components(source_view, target_view, joined, alignment, options.components, progress);
    if (matching.matched.empty()) return as_one();
    DividedComponents divided = divide_components(
        source_view, target_view, matching, {joined, alignment, options.components}, progress);
    const ComponentView source_parts{divided.source, source.positions, source.normals,
                                     whole.source_images, ends.source};
    const ComponentView target_parts{divided.target, target.positions, target.normals,
                                     whole.target_images, ends.target};
    match_rest(divided.matching, source_parts, target_parts, alignment, options.components,
               progress);
    ComponentGroups groups = group_components(source_parts, target_parts, divided.matching,
                                              options.components, progress);
    groups.kinds = divided.kinds;
    for (std::string& words :
         components_in_words(divided.matching, groups, {divided.source, source.name},
                             {divided.target, target.name}))
        warnings.push_back(std::move(words));
    for (std::string& words : divisions_in_words(divided, source.name, target.name))
        warnings.push_back(std::move(words));
    const ComponentMarks marks{groups, input.features};
    whole.diagnostics.source_loose = groups.source.loose;
    whole.diagnostics.target_loose = groups.target.loose;
    const Refinement by_group =
        mapped_by_group(whole, source_parts, target_parts, marks,
                        {options.components, options.refinement, alignment.rotation}, progress);
    return kept_apart(by_group,
                      {divided.source, source.positions, source.normals, by_group.source_images},
                      {divided.target, target.positions, target.normals, by_group.target_images},
                      marks, progress);
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

bool leaves_missing(const MorphOptions& options, const Positions& source, const Positions& target) {
    constexpr double kFlat = 0.02;  // of its width, in root mean squares
    const auto is_flat = [&](const Positions& shape) {
        const Positions arms = shape.rowwise() - shape.colwise().mean();
        const PrincipalAxes spread = principal_axes(arms.transpose() * arms);
        return spread.eigenvalues[0] < kFlat * kFlat * spread.eigenvalues[1];
    };
    return options.missing_parts == MissingParts::kLeave && is_flat(source) == is_flat(target);
}

RouteResult match_in_product_space(const RouteInput& input,
                                   const std::optional<RefinementStart>& start,
                                   const ProductRouteOptions& options, Progress& progress) {
    RouteResult result;
    result.domain = "product";
    Ends ends = options.leave_missing ? ends_of(input.source, input.target) : Ends{};
    const SampledSurface source = input.source.surface(), target = input.target.surface();
    Refinement refined =
        refine_by_component(input, start, ends, options, result.warnings, progress);
    const LostPoints lost = send_lost_parts_to_ends(
        refined, {source, ends.source}, {target, ends.target}, input.features, progress);
    constexpr double kSaid = 0.02;  // a share of the points, where nothing is lost
    const auto say = [&](const Positions& images, const PreparedShape& whole,
                         const PreparedShape& part, std::span<const Index> its_ends,
                         Index lost_points) {
        const double share = std::max(share_beyond(images, part, its_ends),
                                      static_cast<double>(lost_points) / whole.size());
        if (share > kSaid || lost_points > 0)
            result.warnings.push_back(goes_beyond(whole.name, part.name, share));
    };
    say(refined.target_images, input.target, input.source, ends.source, lost.of_target);
    say(refined.source_images, input.source, input.target, ends.target, lost.of_source);
    progress.finish();
    judge_normals(refined.inside_out, input.source, input.target, result);
    on_both(progress, [&](bool is_source, Progress&) {
        ProductPoints& product = is_source ? refined.source_product : refined.target_product;
        (is_source ? result.source_domain : result.target_domain) = product;
        product.resize(0, product.cols());
    });
    result.pairs = std::move(refined.pairs);
    result.images = {std::move(refined.source_images), std::move(refined.target_images)};
    result.facts.diagnostics = std::move(refined.diagnostics);
    result.facts.diagnostics.source_ends = std::move(ends.source);
    result.facts.diagnostics.target_ends = std::move(ends.target);
    return result;
}

}  // namespace pointmorph

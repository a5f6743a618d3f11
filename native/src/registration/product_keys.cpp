#include "registration/product_keys.hpp"

#include <tuple>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "registration/few_matches.hpp"

namespace pointmorph {

namespace {

bool are_few(const ProductKeys& keys) {
    return keys.labeled.rows() == 0 && keys.plain.rows() > 0 && keys.plain.rows() <= kFewPoints &&
           fits_floats(keys.plain);
}

}  // namespace

ProductKeys::ProductKeys(ProductPoints points, const Labels& labels, const LocalAreas& areas) {
    if (labels.rows() == 0 && areas.rows() == 0)
        plain = std::move(points);
    else
        labeled = labeled_points(points, labels, areas);
}

ProductKeyTree::ProductKeyTree(const ProductKeys& keys) {
    if (keys.labeled.rows() == 0)
        plain_.emplace(keys.plain);
    else
        labeled_.emplace(keys.labeled);
}

Matches ProductKeyTree::nearest(const ProductKeys& keys, Progress& progress,
                                const Matches* guess) const {
    return labeled_ ? nearest_matches<32>(keys.labeled, *labeled_, progress, guess)
                    : nearest_matches<12>(keys.plain, *plain_, progress, guess);
}

void match_both_ways(const ProductKeys& source, const ProductKeys& target, Matches& source_matches,
                     Matches& target_matches, Progress& progress) {
    const bool again = !source_matches.to.empty();
    if (are_few(source) && are_few(target)) {
        std::tie(source_matches, target_matches) =
            matches_both_ways_of_few(source.plain, target.plain, again ? &target_matches : nullptr);
        return;
    }
    std::optional<ProductKeyTree> source_tree, target_tree;
    parallel_invoke(2, [&](int k, bool) {
        k == 0 ? source_tree.emplace(source) : target_tree.emplace(target);
    });
    source_matches = target_tree->nearest(source, progress, again ? &source_matches : nullptr);
    target_matches = source_tree->nearest(target, progress, again ? &target_matches : nullptr);
}

Matches nearest_of(const ProductKeys& keys, const ProductKeys& others, Progress& progress) {
    if (are_few(keys) && are_few(others)) return matches_of_few(keys.plain, others.plain);
    return ProductKeyTree(others).nearest(keys, progress);
}

Labels labels_of(const CoarseShape& shape, std::span<const Index> coarse_rows) {
    return shape.labels.rows() == 0 ? Labels() : gather(shape.labels, coarse_rows);
}

}  // namespace pointmorph

#include "registration/product_keys.hpp"

#include <utility>

#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

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

Labels labels_of(const CoarseShape& shape, std::span<const Index> coarse_rows) {
    return shape.labels.rows() == 0 ? Labels() : gather(shape.labels, coarse_rows);
}

}  // namespace pointmorph

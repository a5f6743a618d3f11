// Points of the product space with all else by which they are matched: regions' labels and local
// areas, where there are any. Not for callers of the library.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/product_space.hpp"

namespace pointmorph {

/// Short rows where nothing but the product space counts, long ones elsewhere.
struct ProductKeys {
    ProductPoints plain;    ///< empty where there are labels or areas
    LabeledPoints labeled;  ///< empty where there are none

    ProductKeys() = default;
    /// `labels` and `areas` have a row a point, or none.
    ProductKeys(ProductPoints points, const Labels& labels, const LocalAreas& areas = LocalAreas());
};

/// Keys to search; they must outlive it.
class ProductKeyTree {
public:
    explicit ProductKeyTree(const ProductKeys& keys);

    /// The nearest of the tree's points to each of `keys`, which are of the same kind. See
    /// nearest_matches().
    Matches nearest(const ProductKeys& keys, Progress& progress,
                    const Matches* guess = nullptr) const;

private:
    std::optional<KdTree<12>> plain_;
    std::optional<KdTree<32>> labeled_;
};

/// The nearest both ways, into `source_matches` and `target_matches`. Where these hold matches of
/// as many keys already, of any quality, the search begins there.
void match_both_ways(const ProductKeys& source, const ProductKeys& target, Matches& source_matches,
                     Matches& target_matches, Progress& progress);

/// The nearest of `others` to each of `keys`, where there are few; on the calling thread.
Matches nearest_of(const ProductKeys& keys, const ProductKeys& others, Progress& progress);

/// Labels of some coarse points; none where the shape has none.
Labels labels_of(const CoarseShape& shape, std::span<const Index> coarse_rows);

}  // namespace pointmorph

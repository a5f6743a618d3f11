#include "pointmorph/registration/product_space.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

namespace {

/// All rows but those of features; all rows where that would leave none.
std::vector<Index> free_rows(Index count, std::span<const IndexPair> features,
                             Index IndexPair::*side) {
    std::vector<char> taken(to_size(count), 0);
    for (const IndexPair& f : features) taken[to_size(f.*side)] = 1;
    std::vector<Index> rows;
    rows.reserve(to_size(count));
    for (Index i = 0; i < count; ++i)
        if (!taken[to_size(i)]) rows.push_back(i);
    if (rows.empty()) {
        rows.resize(to_size(count));
        std::iota(rows.begin(), rows.end(), 0);
    }
    return rows;
}

/// Marked pairs, those of each of `source_rows` with `forward` of it, and of each of `target_rows`
/// with `backward` of it: ascending, each once. By counting, as a source has few partners, without
/// a list of them all.
Pairing sorted_pairs(std::span<const IndexPair> marked, std::span<const Index> source_rows,
                     std::span<const Index> target_rows, auto&& forward, auto&& backward,
                     Index sources) {
    const auto for_each = [&](auto&& take) {
        for (const IndexPair& pair : marked) take(pair.source, pair.target);
        for (const Index i : source_rows) take(i, forward(i));
        for (const Index j : target_rows) take(backward(j), j);
    };
    std::vector<std::size_t> next(to_size(sources) + 1, 0);
    for_each([&](Index i, Index) { ++next[to_size(i) + 1]; });
    std::partial_sum(next.begin(), next.end(), next.begin());
    std::vector<Index> targets(next.back());
    for_each([&](Index i, Index j) { targets[next[to_size(i)]++] = j; });
    Pairing pairs;
    pairs.reserve(targets.size());
    std::size_t begin = 0;
    for (Index i = 0; i < sources; ++i) {
        const auto first = targets.begin() + static_cast<std::ptrdiff_t>(begin);
        const auto last = targets.begin() + static_cast<std::ptrdiff_t>(next[to_size(i)]);
        std::sort(first, last);
        std::for_each(first, std::unique(first, last), [&](Index target) {
            pairs.push_back({i, target});
        });
        begin = next[to_size(i)];
    }
    return pairs;
}

}  // namespace

ProductPoints product_points(const OrientedView& on_target, const OrientedView& on_source,
                             double normal_weight) {
    ProductPoints product(on_target.positions.rows(), ProductPoints::ColsAtCompileTime);
    // Row by row: column by column, the array would go through memory four times.
    for (Eigen::Index i = 0; i < product.rows(); ++i)
        product.row(i) << on_target.positions.row(i), on_source.positions.row(i),
            normal_weight * on_target.normals.row(i), normal_weight * on_source.normals.row(i);
    return product;
}

LabeledPoints labeled_points(const ProductPoints& points,
                             const Eigen::Ref<const DynamicRows>& labels,
                             const Eigen::Ref<const DynamicRows>& areas) {
    LabeledPoints labeled = LabeledPoints::Zero(points.rows(), LabeledPoints::ColsAtCompileTime);
    labeled.leftCols<ProductPoints::ColsAtCompileTime>() = points;
    if (labels.rows() > 0)
        labeled.middleCols(ProductPoints::ColsAtCompileTime, labels.cols()) = labels;
    if (areas.rows() > 0) labeled.rightCols(areas.cols()) = areas;
    return labeled;
}

template <int Dim>
Matches nearest_matches(const typename KdTree<Dim>::Points& points, const KdTree<Dim>& others,
                        Progress& progress, const Matches* guess) {
    constexpr double kBarelyMore = 1.0 + 1e-12, kAtTheSamePlace = 1e-150;
    const auto count = to_index(points.rows());
    Matches matches{std::vector<Index>(to_size(count)), std::vector<double>(to_size(count))};
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                Index& to = matches.to[to_size(i)];
                double squared, radius = std::numeric_limits<double>::infinity();
                if (guess) {
                    to = guess->to[to_size(i)];
                    squared = (others.points().row(to) - points.row(i)).squaredNorm();
                    // Not 0: others at the same place may come before.
                    radius = std::max(std::sqrt(squared) * kBarelyMore, kAtTheSamePlace);
                }
                others.nearest_within(points.row(i).data(), radius, {&to, 1}, {&squared, 1});
                matches.distances[to_size(i)] = std::sqrt(squared);
            }
        },
        0.0, 1.0, 128);
    return matches;
}

template <int Dim>
Pairing mutual_pairs(const typename KdTree<Dim>::Points& source,
                     const typename KdTree<Dim>::Points& target,
                     std::span<const IndexPair> features, Progress& progress) {
    const auto source_rows = free_rows(to_index(source.rows()), features, &IndexPair::source);
    const auto target_rows = free_rows(to_index(target.rows()), features, &IndexPair::target);
    // One tree at a time and no copies: these are the largest arrays of all.
    const auto nearest = [&](const typename KdTree<Dim>::Points& from,
                             const typename KdTree<Dim>::Points& to, std::span<const Index> rows) {
        if (rows.size() == to_size(to.rows()))
            return nearest_matches<Dim>(from, KdTree<Dim>(to), progress).to;
        const auto tree = [&] {
            const typename KdTree<Dim>::Points some = gather(to, rows);
            return KdTree<Dim>(some);
        }();
        return nearest_matches<Dim>(from, tree, progress).to;
    };
    const std::vector<Index> forward = nearest(source, target, target_rows);
    const std::vector<Index> backward = nearest(target, source, source_rows);
    return sorted_pairs(
        features, source_rows, target_rows,
        [&](Index i) { return target_rows[to_size(forward[to_size(i)])]; },
        [&](Index j) { return source_rows[to_size(backward[to_size(j)])]; },
        to_index(source.rows()));
}

template Matches nearest_matches<12>(const ProductPoints&, const KdTree<12>&, Progress&,
                                     const Matches*);
template Matches nearest_matches<32>(const LabeledPoints&, const KdTree<32>&, Progress&,
                                     const Matches*);
template Pairing mutual_pairs<12>(const ProductPoints&, const ProductPoints&,
                                  std::span<const IndexPair>, Progress&);
template Pairing mutual_pairs<32>(const LabeledPoints&, const LabeledPoints&,
                                  std::span<const IndexPair>, Progress&);

}  // namespace pointmorph

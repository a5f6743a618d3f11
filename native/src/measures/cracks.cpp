#include "pointmorph/measures/cracks.hpp"

#include <algorithm>
#include <numeric>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

namespace {

constexpr Index kNearest = 6;
constexpr double kOpen = 2.0;  // spacings

/// Edges of one cloud as rows of the pairing, and every point's spacing.
struct Edges {
    std::vector<std::pair<Index, Index>> pairs;
    Values spacing;
};

template <class RowOf>
Edges edges_of(const Positions& positions, std::span<const IndexPair> pairs, RowOf row_of,
               Index max_edges, Progress& progress) {
    const auto nearest = nearest_neighbors(KdTree<3>(positions), kNearest, progress);
    std::vector<Index> pair_of(to_size(positions.rows()), -1);
    for (std::size_t i = pairs.size(); i-- > 0;)
        pair_of[to_size(row_of(pairs[i]))] = static_cast<Index>(i);

    Edges edges;
    edges.spacing = local_spacing(positions, nearest);
    const auto all = static_cast<std::int64_t>(nearest.indices.size());
    const std::int64_t step = std::max<std::int64_t>(1, all / std::max<Index>(max_edges, 1));
    std::int64_t next = 0, edge = 0;
    for (Index i = 0; i < nearest.size(); ++i)
        for (const Index j : nearest[i])
            if (edge++ == next) {
                edges.pairs.emplace_back(pair_of[to_size(i)], pair_of[to_size(j)]);
                next += step;
            }
    return edges;
}

double open_share(const Edges& edges, const KdTree<3>& frame, std::span<const double> spacing,
                  Progress& progress) {
    std::vector<char> open(edges.pairs.size());
    parallel_for(static_cast<Index>(open.size()), progress, [&](Index begin, Index end) {
        for (Index e = begin; e < end; ++e) {
            const auto [a, b] = edges.pairs[to_size(e)];
            const Vector3 middle = (frame.points().row(a) + frame.points().row(b)) / 2.0;
            Index nearest = 0;
            double squared_distance = 0.0;
            frame.nearest(middle.data(), {&nearest, 1}, {&squared_distance, 1});
            const double limit = kOpen / 2.0 * (spacing[to_size(a)] + spacing[to_size(b)]);
            open[to_size(e)] = squared_distance > limit * limit;
        }
    });
    return open.empty() ? 0.0
                        : static_cast<double>(std::accumulate(open.begin(), open.end(), 0L)) /
                              static_cast<double>(open.size());
}

}  // namespace

std::vector<Cracks> find_cracks(const Positions& source, const Positions& target,
                                std::span<const IndexPair> pairs, std::span<const double> times,
                                Progress& progress, Index max_edges) {
    const auto source_edges = edges_of(
        source, pairs, [](const IndexPair& p) { return p.source; }, max_edges, progress);
    const auto target_edges = edges_of(
        target, pairs, [](const IndexPair& p) { return p.target; }, max_edges, progress);

    std::vector<Cracks> cracks;
    Positions frame(static_cast<Eigen::Index>(pairs.size()), 3);
    std::vector<double> spacing(pairs.size());
    for (const double t : times) {
        parallel_for(static_cast<Index>(pairs.size()), progress, [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                const auto [s, d] = pairs[to_size(i)];
                frame.row(i) = (1.0 - t) * source.row(s) + t * target.row(d);
                spacing[to_size(i)] =
                    (1.0 - t) * source_edges.spacing[s] + t * target_edges.spacing[d];
            }
        });
        const KdTree<3> tree(frame);
        cracks.push_back({t, std::max(open_share(source_edges, tree, spacing, progress),
                                      open_share(target_edges, tree, spacing, progress))});
    }
    return cracks;
}

}  // namespace pointmorph

#include "pointmorph/surface/surface_graph.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

namespace {

/// The shortest edge from every component but the largest to the largest one.
std::vector<IndexPair> joining_edges(const Positions& positions,
                                     const ConnectedComponents& components) {
    const auto largest =
        to_index(std::ranges::max_element(components.sizes) - components.sizes.begin());
    std::vector<Index> rows;
    for (Index i = 0; i < positions.rows(); ++i)
        if (components.label[to_size(i)] == largest) rows.push_back(i);
    Positions main(static_cast<Eigen::Index>(rows.size()), 3);
    for (std::size_t i = 0; i < rows.size(); ++i)
        main.row(static_cast<Eigen::Index>(i)) = positions.row(rows[i]);
    const KdTree<3> tree(main);

    std::vector<IndexPair> best(to_size(components.count()), IndexPair{-1, -1});
    std::vector<double> shortest(to_size(components.count()),
                                 std::numeric_limits<double>::infinity());
    for (Index i = 0; i < positions.rows(); ++i) {
        const auto label = to_size(components.label[to_size(i)]);
        if (components.label[to_size(i)] == largest) continue;
        Index nearest;
        double squared;
        tree.nearest(positions.row(i).data(), {&nearest, 1}, {&squared, 1});
        if (squared >= shortest[label]) continue;
        shortest[label] = squared;
        best[label] = {i, rows[to_size(nearest)]};
    }
    std::erase_if(best, [](const IndexPair& e) { return e.source < 0; });
    return best;
}

constexpr std::size_t kSpacingSamples = 7;

double disk_spacing(double squared_radius, std::size_t samples) {
    return std::sqrt(std::numbers::pi * squared_radius / static_cast<double>(samples));
}

/// Adds lengths.
SurfaceGraph finished(const Positions& positions, Neighborhoods joined) {
    joined = in_one_piece(positions, std::move(joined));
    SurfaceGraph graph;
    graph.lengths.resize(joined.indices.size());
    // Coincident points: a length of 0 would do, but divides elsewhere.
    constexpr double kShortest = 1e-12;
    for (Index i = 0; i < joined.size(); ++i)
        for (auto e = joined.offsets[to_size(i)]; e < joined.offsets[to_size(i) + 1]; ++e)
            graph.lengths[to_size(e)] = std::max(
                kShortest, (positions.row(joined.indices[to_size(e)]) - positions.row(i)).norm());
    graph.offsets = std::move(joined.offsets);
    graph.neighbors = std::move(joined.indices);
    return graph;
}

}  // namespace

Neighborhoods in_one_piece(const Positions& positions, Neighborhoods joined) {
    const ConnectedComponents components = connected_components(joined);
    if (components.count() > 1) {
        // symmetrized() takes one direction of an edge as well as both.
        Neighborhoods bridges;
        const auto edges = joining_edges(positions, components);
        std::vector<std::vector<Index>> more(to_size(joined.size()));
        for (const IndexPair& e : edges) more[to_size(e.source)].push_back(e.target);
        for (Index i = 0; i < joined.size(); ++i) {
            bridges.indices.insert(bridges.indices.end(), joined[i].begin(), joined[i].end());
            bridges.indices.insert(bridges.indices.end(), more[to_size(i)].begin(),
                                   more[to_size(i)].end());
            bridges.offsets.push_back(static_cast<std::int64_t>(bridges.indices.size()));
        }
        joined = symmetrized(bridges);
    }
    return joined;
}

Values spacings_around(const KdTree<3>& dense, const Positions& places, Progress& progress) {
    Values spacings(places.rows());
    parallel_for(places.rows(), progress, [&](Index begin, Index end) {
        std::vector<Index> near(std::min(kSpacingSamples, to_size(dense.size())));
        std::vector<double> squared(near.size());
        for (Index i = begin; i < end; ++i) {
            dense.nearest(places.row(i).data(), near, squared);
            spacings[i] = disk_spacing(squared.back(), near.size());
        }
    });
    return spacings;
}

Values spacings_around(const Positions& dense, const Neighborhoods& nearest,
                       std::span<const Index> rows) {
    Values spacings(static_cast<Eigen::Index>(rows.size()));
    for (std::size_t k = 0; k < rows.size(); ++k) {
        const auto near = nearest[rows[k]];
        const auto used = std::min(kSpacingSamples - 1, near.size());
        const double squared =
            used > 0 ? (dense.row(near[used - 1]) - dense.row(rows[k])).squaredNorm() : 0.0;
        spacings[static_cast<Eigen::Index>(k)] = disk_spacing(squared, used + 1);
    }
    return spacings;
}

SurfaceGraph surface_graph(const KdTree<3>& tree, const Normals& normals,
                           const SurfaceGraphOptions& options, Progress& progress,
                           const KdTree<3>* dense) {
    const Values spacings = dense ? spacings_around(*dense, tree.points(), progress) : Values();
    return surface_graph(tree.points(), normals,
                         nearest_neighbors(tree, options.neighbors, progress), options, dense,
                         spacings);
}

SurfaceGraph surface_graph(const Positions& positions, const Normals& normals,
                           const Neighborhoods& nearest, const SurfaceGraphOptions& options,
                           const KdTree<3>* dense, const Values& spacings) {
    const auto on_surface = [&](Index i, Index j) {
        if (!dense) return true;
        const Eigen::RowVector3d middle = 0.5 * (positions.row(i) + positions.row(j));
        const double length = (positions.row(i) - positions.row(j)).norm();
        return dense->any_within(
            middle.data(),
            options.bulge * length + options.gap * std::max(spacings[i], spacings[j]));
    };
    // Each pair is looked at once.
    const Neighborhoods near = symmetrized(nearest);
    Neighborhoods joined = symmetrized(filtered(near, [&](Index i, Index j) {
        return i < j && normals.row(i).dot(normals.row(j)) > options.smallest_agreement &&
               on_surface(i, j);
    }));
    return finished(positions, std::move(joined));
}

SurfaceGraph surface_graph(const Positions& positions, const Normals& normals,
                           const Neighborhoods& nearest, std::span<const Index> nodes,
                           std::span<const Index> cells) {
    constexpr std::size_t kNear = 8;  // farther ones reach over gaps
    std::vector<std::vector<Index>> ring(nodes.size());
    for (Index i = 0; i < nearest.size(); ++i) {
        const auto near = nearest[i];
        for (const Index j : near.first(std::min(kNear, near.size()))) {
            const Index a = cells[to_size(i)], b = cells[to_size(j)];
            if (a == b || normals.row(i).dot(normals.row(j)) <= 0.0) continue;
            ring[to_size(a)].push_back(b);
            ring[to_size(b)].push_back(a);
        }
    }
    for (auto& around : ring) {
        std::ranges::sort(around);
        around.erase(std::unique(around.begin(), around.end()), around.end());
    }
    Neighborhoods joined;
    std::vector<Index> around;
    for (std::size_t a = 0; a < nodes.size(); ++a) {
        around = ring[a];
        for (const Index b : ring[a])
            for (const Index c : ring[to_size(b)])
                if (to_size(c) != a &&
                    normals.row(nodes[a]).dot(normals.row(nodes[to_size(c)])) > 0.0)
                    around.push_back(c);
        joined.indices.insert(joined.indices.end(), around.begin(), around.end());
        joined.offsets.push_back(static_cast<std::int64_t>(joined.indices.size()));
    }
    Positions places(static_cast<Eigen::Index>(nodes.size()), 3);
    for (std::size_t a = 0; a < nodes.size(); ++a)
        places.row(static_cast<Eigen::Index>(a)) = positions.row(nodes[a]);
    return finished(places, symmetrized(joined));
}

GeodesicSearch::GeodesicSearch(const SurfaceGraph& graph)
    : graph_(graph), distance_(to_size(graph.size()), std::numeric_limits<double>::infinity()) {}

std::span<const std::pair<Index, double>> GeodesicSearch::from(Index source, double limit) {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    settled_.clear();
    queue_.clear();
    distance_[to_size(source)] = 0.0;
    queue_.emplace_back(0.0, source);
    // Rows break ties, so that the order of the result doesn't depend on the heap's history.
    constexpr auto later = std::greater<std::pair<double, Index>>();
    while (!queue_.empty()) {
        std::ranges::pop_heap(queue_, later);
        const auto [distance, i] = queue_.back();
        queue_.pop_back();
        if (distance > distance_[to_size(i)]) continue;
        settled_.emplace_back(i, distance);
        for (auto e = to_size(graph_.offsets[to_size(i)]);
             e < to_size(graph_.offsets[to_size(i) + 1]); ++e) {
            const Index j = graph_.neighbors[e];
            const double through = distance + graph_.lengths[e];
            if (through >= limit || through >= distance_[to_size(j)]) continue;
            distance_[to_size(j)] = through;
            queue_.emplace_back(through, j);
            std::ranges::push_heap(queue_, later);
        }
    }
    // Everything that got a distance below the limit was settled.
    for (const auto& [i, distance] : settled_) distance_[to_size(i)] = kFar;
    return settled_;
}

}  // namespace pointmorph

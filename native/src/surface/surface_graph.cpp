#include "pointmorph/surface/surface_graph.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
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
constexpr double kNowhere = std::numeric_limits<double>::infinity();

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
    const auto join = [&](Index a, Index b) {
        std::vector<Index>& around = ring[to_size(a)];
        if (std::ranges::find(around, b) != around.end()) return;
        around.push_back(b);
        ring[to_size(b)].push_back(a);
    };
    for (Index i = 0; i < nearest.size(); ++i) {
        const auto near = nearest[i];
        for (const Index j : near.first(std::min(kNear, near.size()))) {
            const Index a = cells[to_size(i)], b = cells[to_size(j)];
            if (a == b || normals.row(i).dot(normals.row(j)) <= 0.0) continue;
            join(a, b);
        }
    }
    for (auto& around : ring) std::ranges::sort(around);
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
    : graph_(graph),
      distance_(to_size(graph.size()), kNowhere),
      walked_(distance_.size(), kNowhere) {
    const Eigen::Map<const Values> lengths(graph.lengths.data(),
                                           static_cast<Eigen::Index>(graph.lengths.size()));
    const double longest = lengths.size() > 0 ? lengths.maxCoeff() : 0.0;
    // Half an edge's length holds few points of a search's front, and few of these are reached
    // from each other. Some edges tell how long they are. They may be longer by any factor where
    // parts were joined.
    constexpr std::size_t kEnough = 256;
    constexpr double kMostBuckets = 1000.0;
    const std::size_t step = graph.lengths.size() / kEnough + 1;
    double sum = 0.0, some = 1.0;
    for (std::size_t e = 0; e < graph.lengths.size(); e += step, some += 1.0)
        sum += graph.lengths[e];
    const double width = std::max(0.5 * sum / some, longest / kMostBuckets);
    inverse_width_ = width > 0.0 ? 1.0 / width : 1.0;
    const auto ahead = static_cast<std::size_t>(std::ceil(longest * inverse_width_)) + 2;
    buckets_.resize(std::bit_ceil(ahead));
}

std::span<const std::pair<Index, double>> GeodesicSearch::from(Index source, double limit) {
    walk(std::span(&source, 1), limit, true);
    return settled_;
}

std::span<const std::pair<Index, double>> GeodesicSearch::reached(Index source, double limit) {
    return reached(std::span(&source, 1), limit);
}

std::span<const std::pair<Index, double>> GeodesicSearch::reached(std::span<const Index> sources,
                                                                  double limit) {
    walk(sources, limit, false);
    return settled_;
}

// By buckets instead of a heap (Dial 1969). Within one, points are walked on from again when they
// turn out to be nearer (Meyer and Sanders 2003); the distances are the same.
void GeodesicSearch::walk(std::span<const Index> sources, double limit, bool sorted) {
    constexpr double kDone = -1.0;
    settled_.clear();
    const std::size_t last = buckets_.size() - 1;
    for (const Index source : sources)
        if (std::exchange(distance_[to_size(source)], 0.0) > 0.0) buckets_[0].push_back(source);
    std::size_t open = buckets_[0].size();
    for (std::size_t here = 0; open > 0; ++here) {
        std::vector<Index>& bucket = buckets_[here & last];
        for (std::size_t k = 0; k < bucket.size(); ++k) {
            const Index i = bucket[k];
            const double distance = distance_[to_size(i)];
            if (walked_[to_size(i)] <= distance) continue;
            walked_[to_size(i)] = distance;
            find_nearer(i, distance, limit);
            for (const auto& [through, j] : std::span(nearer_).first(found_)) {
                distance_[to_size(j)] = through;
                buckets_[bucket_of(through) & last].push_back(j);
            }
            open += found_;
        }
        open -= bucket.size();
        nearer_.clear();
        for (const Index i : bucket)
            if (bucket_of(distance_[to_size(i)]) == here &&
                std::exchange(walked_[to_size(i)], kDone) != kDone)
                nearer_.emplace_back(distance_[to_size(i)], i);
        bucket.clear();
        if (sorted) std::ranges::sort(nearer_);
        for (const auto& [distance, i] : nearer_) settled_.emplace_back(i, distance);
    }
    for (const auto& [i, distance] : settled_)
        distance_[to_size(i)] = walked_[to_size(i)] = kNowhere;
}

// Which are nearer this way than before nobody can foresee: no branch looks for them.
void GeodesicSearch::find_nearer(Index i, double distance, double limit) {
    const auto begin = to_size(graph_.offsets[to_size(i)]);
    const auto end = to_size(graph_.offsets[to_size(i) + 1]);
    if (nearer_.size() < end - begin) nearer_.resize(end - begin);
    std::size_t found = 0;
    for (std::size_t e = begin; e < end; ++e) {
        const Index j = graph_.neighbors[e];
        const double through = distance + graph_.lengths[e];
        nearer_[found] = {through, j};
        found += (through < distance_[to_size(j)] ? 1u : 0u) & (through < limit ? 1u : 0u);
    }
    found_ = found;
}

}  // namespace pointmorph

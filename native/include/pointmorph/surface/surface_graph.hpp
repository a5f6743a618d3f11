// Stage `surface_graph`: a cloud as a connected graph along its surface, and shortest paths in it.
#pragma once

#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// Symmetric weighted graph. The neighbors of i are `neighbors[offsets[i]] …
/// neighbors[offsets[i + 1] − 1]`, ascending by row, at the same places of `lengths` (plain
/// distances, > 0).
struct SurfaceGraph {
    std::vector<std::int64_t> offsets{0};
    std::vector<Index> neighbors;
    std::vector<double> lengths;

    Index size() const { return to_index(offsets.size()) - 1; }
    /// Rows next to a row.
    std::span<const Index> operator[](Index row) const {
        const auto begin = to_size(offsets[to_size(row)]), end = to_size(offsets[to_size(row) + 1]);
        return std::span(neighbors).subspan(begin, end - begin);
    }
};

/// A symmetric graph with an edge more for every component but the largest: the shortest to that
/// one.
Neighborhoods in_one_piece(const Positions& positions, Neighborhoods joined);

struct SurfaceGraphOptions {
    Index neighbors = 16;
    /// Neighbors whose normals have a smaller scalar product than this lie on different sheets
    /// and aren't joined; −1 to 1.
    double smallest_agreement = -0.1;
    /// How far off the surface the middle of an edge may lie: a share of its length, for curvature,
    /// and a share of the dense cloud's spacing there.
    double bulge = 0.15, gap = 0.8;
};

/// Joins nearest neighbors on the same sheet; then every component to the largest one by the
/// shortest edge, so that the whole graph hangs together. `dense`, where there is one, is the cloud
/// that `tree` holds a part of: an edge whose middle lies off the surface, as its nearest sample
/// shows, leads from one limb to another and isn't taken.
SurfaceGraph surface_graph(const KdTree<3>& tree, const Normals& normals,
                           const SurfaceGraphOptions& options, Progress& progress,
                           const KdTree<3>* dense = nullptr);

/// The same where more is known: the nearest neighbors of the points themselves, as many as are to
/// be taken, and the spacing of the dense cloud around each of them.
SurfaceGraph surface_graph(const Positions& positions, const Normals& normals,
                           const Neighborhoods& nearest, const SurfaceGraphOptions& options,
                           const KdTree<3>* dense, const Values& dense_spacings);

/// Distance between samples of `dense` around places, from the disk that holds the nearest ones.
Values spacings_around(const KdTree<3>& dense, const Positions& places, Progress& progress);

/// The same around some of the samples, whose neighborhoods, ascending by distance, are known.
Values spacings_around(const Positions& dense, const Neighborhoods& nearest,
                       std::span<const Index> rows);

/// The graph of some points of a cloud, from the cloud's own neighborhoods `nearest` (ascending by
/// distance), which see gaps that the few points don't: feet that nearly touch stay apart. Every
/// point of the cloud belongs to one of the `nodes`, `cells[i]`; nodes are joined where neighbors
/// belong to both, and, for straighter paths, with their neighbors' neighbors; never on different
/// sheets. What falls apart is joined as above. `positions` and `normals` are those of the cloud.
SurfaceGraph surface_graph(const Positions& positions, const Normals& normals,
                           const Neighborhoods& nearest, std::span<const Index> nodes,
                           std::span<const Index> cells);

/// Shortest paths (Dijkstra 1959). Keeps its scratch memory between calls: one object a thread.
class GeodesicSearch {
public:
    explicit GeodesicSearch(const SurfaceGraph& graph);

    /// All points closer than `limit` along the graph, as (row, distance), ascending by distance;
    /// valid until the next call.
    std::span<const std::pair<Index, double>> from(
        Index source, double limit = std::numeric_limits<double>::infinity());
    /// The same in no particular order, which takes less time, and from the nearest of several.
    std::span<const std::pair<Index, double>> reached(
        Index source, double limit = std::numeric_limits<double>::infinity());
    std::span<const std::pair<Index, double>> reached(
        std::span<const Index> sources, double limit = std::numeric_limits<double>::infinity());

private:
    void walk(std::span<const Index> sources, double limit, bool sorted);
    /// Fills `nearer_` with the points around i that are nearer through it than they were.
    void find_nearer(Index i, double distance, double limit);

    std::size_t bucket_of(double distance) const {
        return static_cast<std::size_t>(distance * inverse_width_);
    }

    const SurfaceGraph& graph_;
    std::vector<double> distance_, walked_;  ///< of each point, and when it was last walked on from
    double inverse_width_;
    /// Points by distance; after the last bucket the first one follows.
    std::vector<std::vector<Index>> buckets_;
    std::vector<std::pair<double, Index>> nearer_;
    std::size_t found_ = 0;  ///< of these
    std::vector<std::pair<Index, double>> settled_;
};

}  // namespace pointmorph

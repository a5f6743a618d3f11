// One cloud of a map that is judged: at unit area, with evenly spread nodes and samples. Internal.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/cloud/subset.hpp"

namespace pointmorph {

using SidedPoints = KdTree<6>::Points;
using SidedPoint = Eigen::Matrix<double, 1, 6>;

/// One cloud at unit area, and evenly spread points of it.
struct JudgedSurface {
    static constexpr Index kNodes = 1500;       ///< where confidence is found
    static constexpr double kSamples = 6000.0;  ///< about as many points stand for all of them
    /// Of unit normals, to tell both sides of thin parts apart.
    static constexpr double kSideWeight = 0.1;

    JudgedSurface(const Cloud& given, const OrderedNeighbors& neighbors, Progress& progress)
        : cloud(given), order(neighbors.order), unit(normalization(given.positions)) {
        positions = unit.apply(given.positions);
        const Values spacing = local_spacing(gather(positions, neighbors.order), neighbors.nearest);
        const double area = spacing.squaredNorm();
        scale = area > 0.0 ? 1.0 / std::sqrt(area) : 1.0;
        samples = drawn_samples(spacing, area);
        const Positions sampled = gather(positions, samples);
        const Normals normals = gather(cloud.normals, samples).rowwise().normalized();
        const KdTree<3> tree(sampled);
        rows = gather(samples, poisson_disk_subset(tree, normals, {}, kNodes, progress).rows);
        scale_up(1.0);
    }

    void scale_up(double factor) {
        scale *= factor;
        nodes = sided(rows);
        places = nodes.leftCols<3>();
    }

    /// The same number for the same row everywhere, in [0, 1).
    static double drawn(Index row) {
        auto x = static_cast<std::uint64_t>(row) + 0x9e3779b97f4a7c15ULL;  // splitmix64
        x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
        x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
        return static_cast<double>((x ^ (x >> 31)) >> 11) * 0x1.0p-53;
    }

    /// More of them where points are far apart, but some everywhere; ascending.
    std::vector<Index> drawn_samples(const Values& spacing, double area) const {
        const double each = 1.0 / static_cast<double>(size());
        std::vector<Index> result;
        for (Index i = 0; i < size(); ++i) {
            const double share = area > 0.0 ? spacing[i] * spacing[i] / area : each;
            const Index row = order[to_size(i)];
            if (drawn(row) < kSamples * (share + each) / 2.0) result.push_back(row);
        }
        if (result.empty()) result.push_back(0);
        std::ranges::sort(result);
        return result;
    }

    Index size() const { return to_index(positions.rows()); }
    Index count() const { return to_index(rows.size()); }
    /// Places of this cloud's coordinates, at unit area.
    Positions at_unit_area(const Positions& given) const { return scale * unit.apply(given); }
    SidedPoint sided(Index row) const {
        SidedPoint result;
        result << scale * positions.row(row), kSideWeight * cloud.normals.row(row).normalized();
        return result;
    }
    SidedPoints sided(std::span<const Index> some) const {
        SidedPoints result(static_cast<Eigen::Index>(some.size()), 6);
        for (std::size_t k = 0; k < some.size(); ++k)
            result.row(static_cast<Eigen::Index>(k)) = sided(some[k]);
        return result;
    }
    Eigen::RowVector3d node_normal(Index node) const {
        return nodes.row(node).tail<3>() / kSideWeight;
    }
    bool same_side(Index node, Index other) const {
        return nodes.row(node).tail<3>().dot(nodes.row(other).tail<3>()) > 0.0;
    }

    const Cloud& cloud;
    const std::vector<Index>& order;  ///< its spatial order
    Normalization unit;
    Positions positions;
    double scale = 1.0;
    std::vector<Index> samples;  ///< rows that stand for all
    std::vector<Index> rows;     ///< of the nodes, which are some of the samples
    SidedPoints nodes;
    Positions places;  ///< of the nodes
};

/// Both clouds' nodes, to look up.
struct NodeTrees {
    explicit NodeTrees(const JudgedSurface& surface)
        : by_place(surface.places), by_side(surface.nodes) {}
    KdTree<3> by_place;
    KdTree<6> by_side;
};

}  // namespace pointmorph

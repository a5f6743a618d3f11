#include "morph/prepared_shape.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "pointmorph/base/error.hpp"
#include "pointmorph/cloud/covariance.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"

namespace pointmorph {

void Side::order_points(Index minimum_points) {
    unit = normalization(cloud.positions);
    rank.resize(to_size(cloud.size()));
    for (const Index row : spatial_order(cloud.positions)) {
        const bool twin =
            !order.empty() && cloud.positions.row(row) == cloud.positions.row(order.back());
        if (!twin)
            order.push_back(row);
        else
            order.back() = std::min(order.back(), row);
        rank[to_size(row)] = static_cast<Index>(order.size()) - 1;
    }
    if (static_cast<Index>(order.size()) < minimum_points)
        throw CloudError(
            cloud.name, "at least " + std::to_string(minimum_points) + " places",
            std::to_string(cloud.size()) + " points at " + std::to_string(order.size()) + " places",
            "Subdivide the mesh or sample the surface more densely.");
    positions = unit.apply(gather(cloud.positions, order));
    normals_given = cloud.normals.rows() > 0;
    if (!normals_given) return;
    normals = Normals::Zero(positions.rows(), 3);
    for (Index row = 0; row < cloud.size(); ++row)
        normals.row(rank[to_size(row)]) += cloud.normals.row(row).normalized();
    for (Eigen::Index i = 0; i < normals.rows(); ++i) {
        // Both sides of a sheet in one place: the normal of one of them will do.
        constexpr double kOpposed = 1e-6;
        if (normals.row(i).norm() < kOpposed) normals.row(i) = cloud.normals.row(order[to_size(i)]);
        normals.row(i).normalize();
    }
}

void Side::find_normals(Progress& progress) {
    if (!normals_given) {
        normals = covariance_analysis(positions, nearest, progress).normals;
        orient_normals(positions, nearest, normals, progress);
    }
    if (cloud.radii.rows() == 0)
        cloud.radii = gather(local_spacing(positions, nearest), rank) * unit.scale;
}

const std::vector<BoundaryLoop>& Side::loops(const BoundaryOptions& options, Progress& progress) {
    if (!loops_) loops_ = find_boundary_loops(positions, normals, nearest, options, progress);
    return *loops_;
}

void Side::find_topology(std::span<const Index> parts, const BoundaryOptions& boundary,
                         const TopologyOptions& options, Progress& progress) {
    if (!parts.empty() && static_cast<Index>(parts.size()) != cloud.size())
        throw CloudError(cloud.name,
                         "a part for each of " + std::to_string(cloud.size()) + " points",
                         std::to_string(parts.size()), "Give one label a point, or none.");
    std::vector<Index> ranked;
    if (!parts.empty())
        for (const Index row : order) ranked.push_back(parts[to_size(row)]);
    topology = pointmorph::find_topology({positions, normals, nearest, cloud.name},
                                         loops(boundary, progress), ranked, options, progress);
}

Index Side::leave_out_specks(Index neighbors, Progress& progress) {
    constexpr double kMuch = 0.05;
    std::vector<Index> kept, left_out;
    const auto main = static_cast<Index>(topology.main().size());
    for (Index i = 0; i < static_cast<Index>(order.size()); ++i)
        (topology.labels[to_size(i)] < main ? kept : left_out).push_back(i);
    if (left_out.empty() ||
        static_cast<double>(left_out.size()) > kMuch * static_cast<double>(order.size()))
        return 0;

    std::vector<Index> stand_in(order.size());
    for (std::size_t k = 0; k < kept.size(); ++k)
        stand_in[to_size(kept[k])] = static_cast<Index>(k);
    const Positions all = std::exchange(positions, gather(positions, kept));
    const KdTree<3> tree(positions);
    for (const Index i : left_out) {
        double squared;
        tree.nearest(all.row(i).data(), {&stand_in[to_size(i)], 1}, {&squared, 1});
    }
    normals = gather(normals, kept);
    std::vector<Index> kept_order, kept_labels;
    for (const Index i : kept) {
        kept_order.push_back(order[to_size(i)]);
        kept_labels.push_back(topology.labels[to_size(i)]);
    }
    order = std::move(kept_order);
    topology.labels = std::move(kept_labels);
    for (Index& place : rank) place = stand_in[to_size(place)];
    nearest = nearest_neighbors(tree, neighbors, progress);
    loops_.reset();
    return static_cast<Index>(left_out.size());
}

Index Side::find_boundary(std::span<const Index> given, const BoundaryOptions& options,
                          Progress& progress) {
    if (!given.empty()) {
        BoundaryLoop ranked;
        for (std::size_t k = 0; k < given.size(); ++k) {
            const Index row = given[k];
            if (row < 0 || row >= cloud.size())
                throw FeatureError("boundary of " + cloud.name,
                                   "points 0 to " + std::to_string(cloud.size() - 1),
                                   "point " + std::to_string(row), "Give the boundary again.");
            const Index here = rank[to_size(row)];
            // Points at one place are one; a row given twice is a mistake that is said later.
            const bool again = std::ranges::find(given.first(k), row) != given.first(k).end();
            if (again || std::ranges::find(ranked, here) == ranked.end()) ranked.push_back(here);
        }
        loop = oriented_loop(positions, normals, nearest, std::move(ranked), cloud.name);
        return 1;
    }
    const auto& found = loops(options, progress);
    if (!found.empty()) loop = found.front();
    return static_cast<Index>(found.size());
}

bool Side::is_open() const {
    if (loop.empty()) return false;
    return is_rim(loop_length(positions, loop), estimated_area(KdTree<3>(positions)));
}

void Side::flip() {
    normals = -normals;
    std::reverse(loop.begin(), loop.end());
    if (loops_)
        for (BoundaryLoop& found : *loops_) std::reverse(found.begin(), found.end());
}

bool Side::turn_outwards() {
    if (!normals_given || topology.components.front().is_open) return false;
    const Values spacing = local_spacing(positions, nearest);
    double area = 0.0, flux = 0.0;  // ∫ dA, ∫ p·n dA, which is three times the volume
    Eigen::RowVector3d middle = Eigen::RowVector3d::Zero();
    for (Index i = 0; i < nearest.size(); ++i) {
        if (topology.labels[to_size(i)] != 0) continue;
        const double share = spacing[i] * spacing[i];
        area += share;
        middle += share * positions.row(i);
    }
    if (!(area > 0.0)) return false;
    middle /= area;
    for (Index i = 0; i < nearest.size(); ++i)
        if (topology.labels[to_size(i)] == 0)
            flux += spacing[i] * spacing[i] * (positions.row(i) - middle).dot(normals.row(i));
    constexpr double kSomeVolume = 0.005;  // of a unit area; a ball has 0.09
    if (flux / 3.0 > -kSomeVolume * area * std::sqrt(area)) return false;
    flip();
    cloud.normals = -cloud.normals;
    return true;
}

std::vector<Index> Side::as_given(std::span<const Index> rows) const {
    std::vector<Index> result;
    for (const Index row : rows) result.push_back(order[to_size(row)]);
    return result;
}

void Side::hand_over_normals() {
    if (normals_given) return;
    cloud.normals = gather(normals, rank);
}

Pairing as_given(std::span<const IndexPair> pairs, const Side& source, const Side& target) {
    // Rows as given that each row stands for, the one in `order` first.
    const auto represented = [](const Side& side) {
        std::vector<std::vector<Index>> rows;
        for (const Index row : side.order) rows.push_back({row});
        for (Index row = 0; row < side.cloud.size(); ++row) {
            auto& stands_for = rows[to_size(side.rank[to_size(row)])];
            if (stands_for.front() != row) stands_for.push_back(row);
        }
        return rows;
    };
    const auto s = represented(source), t = represented(target);
    std::vector<char> source_seen(s.size(), 0), target_seen(t.size(), 0);
    Pairing result;
    for (const IndexPair& pair : pairs) {
        const auto i = to_size(pair.source), j = to_size(pair.target);
        // All of them at the first pair, along each other: seams stay seams.
        const std::size_t sources = std::exchange(source_seen[i], 1) ? 1 : s[i].size();
        const std::size_t targets = std::exchange(target_seen[j], 1) ? 1 : t[j].size();
        for (std::size_t k = 0; k < std::max(sources, targets); ++k)
            result.push_back({s[i][std::min(k, sources - 1)], t[j][std::min(k, targets - 1)]});
    }
    std::ranges::sort(result);
    result.erase(std::ranges::unique(result).begin(), result.end());
    return result;
}

}  // namespace pointmorph

#include "side.hpp"

#include <algorithm>

#include "pointmorph/covariance.hpp"
#include "pointmorph/error.hpp"
#include "pointmorph/subset.hpp"

namespace pointmorph {

void Side::order_points() {
    order = spatial_order(cloud.positions);
    rank = inverse_order(order);
    unit = normalization(cloud.positions);
    positions = unit.apply(gather(cloud.positions, order));
    normals_given = cloud.normals.rows() > 0;
    if (normals_given) normals = gather(cloud.normals, order).rowwise().normalized();
}

void Side::find_normals(Progress& progress) {
    if (!normals_given) {
        normals = covariance_analysis(positions, nearest, progress).normals;
        orient_normals(positions, nearest, normals, progress);
    }
    if (cloud.radii.rows() == 0) {
        const Values spacing = local_spacing(positions, nearest);
        cloud.radii.resize(spacing.size());
        for (std::size_t i = 0; i < order.size(); ++i)
            cloud.radii[order[i]] = spacing[static_cast<Eigen::Index>(i)] * unit.scale;
    }
}

Index Side::find_boundary(const BoundaryLoop& given, const BoundaryOptions& options,
                          Progress& progress) {
    if (!given.empty()) {
        BoundaryLoop ranked;
        for (const Index row : given) {
            if (row < 0 || row >= cloud.size())
                throw FeatureError("boundary of " + cloud.name,
                                   "points 0 to " + std::to_string(cloud.size() - 1),
                                   "point " + std::to_string(row), "Give the boundary again.");
            ranked.push_back(rank[static_cast<std::size_t>(row)]);
        }
        loop = oriented_loop(positions, normals, nearest, std::move(ranked), cloud.name);
        return 1;
    }
    auto loops = find_boundary_loops(positions, normals, nearest, options, progress);
    const auto count = static_cast<Index>(loops.size());
    if (count > 0) loop = std::move(loops.front());
    return count;
}

bool Side::is_open() const {
    if (loop.empty()) return false;
    // 4π for a flat disk, 2π for half a sphere, and less the more of a sphere is there.
    constexpr double kSquaredLengthToArea = 4.0;
    const double length = loop_length(positions, loop);
    return length * length > kSquaredLengthToArea * estimated_area(KdTree<3>(positions));
}

void Side::flip() {
    normals = -normals;
    std::reverse(loop.begin(), loop.end());
}

std::vector<Index> Side::as_given(std::span<const Index> rows) const {
    std::vector<Index> result;
    for (const Index row : rows) result.push_back(order[static_cast<std::size_t>(row)]);
    return result;
}

void Side::hand_over_normals() {
    if (normals_given) return;
    cloud.normals.resize(normals.rows(), 3);
    for (std::size_t i = 0; i < order.size(); ++i)
        cloud.normals.row(order[i]) = normals.row(static_cast<Eigen::Index>(i));
}

}  // namespace pointmorph

#include "morph/patch_cloud.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "morph/words.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

/// Limbs of small clouds need finer simplified patches than the paper's threshold leaves them, and
/// separate parts (eyes, a button) go with the patch around them.
ParameterizationOptions for_patches(ParameterizationOptions options, Index points) {
    constexpr Index kPointsToSize = 1500;
    options.join_parts = true;
    options.lod.max_cluster_size =
        std::clamp<Index>(points / kPointsToSize, 1, options.lod.max_cluster_size);
    return options;
}

}  // namespace

PatchCloud::PatchCloud(const PreparedShape& shape, std::vector<Index> inside,
                       const SurfaceCurve& boundary)
    : rows(std::move(inside)),
      positions(static_cast<Eigen::Index>(rows.size()) + boundary.size(), 3),
      normals(positions.rows(), 3),
      loop(to_size(boundary.size())) {
    positions << gather(shape.positions, rows), boundary.points;
    normals << gather(shape.normals, rows), boundary.normals;
    std::iota(loop.begin(), loop.end(), to_index(rows.size()));
}

Index PatchCloud::patch_row(Index sorted) const {
    return to_index(std::ranges::lower_bound(rows, sorted) - rows.begin());
}

std::array<std::vector<double>, 2> rim_angles(const SurfaceCurve& source,
                                              std::span<const Index> source_corners,
                                              const SurfaceCurve& target,
                                              std::span<const Index> target_corners,
                                              BoundarySpacing spacing) {
    const auto all = [](const SurfaceCurve& rim) {
        std::vector<Index> loop(to_size(rim.size()));
        std::iota(loop.begin(), loop.end(), 0);
        return loop;
    };
    const auto source_loop = all(source), target_loop = all(target);
    std::vector<IndexPair> corners;
    for (std::size_t k = 0; k < source_corners.size(); ++k)
        corners.push_back({source_corners[k], target_corners[k]});
    const MatchedPins pins =
        match_pins(source.points, source_loop, target.points, target_loop, spacing, corners);
    return {boundary_angles(source.points, source_loop, spacing, pins.source),
            boundary_angles(target.points, target_loop, spacing, pins.target)};
}

PatchOnDisk on_disk(const PreparedShape& shape, const PatchCloud& patch,
                    std::span<const double> angles, const PatchOptions& options,
                    Progress& progress) {
    Neighborhoods nearest;
    if (options.parameterization.solve == SolveMode::kFull)
        nearest = nearest_neighbors(KdTree<3>(patch.positions), options.neighbors, progress);
    auto result =
        parameterize({patch.positions, patch.normals, nearest, shape.name}, {patch.loop, angles},
                     for_patches(options.parameterization, shape.size()), progress);
    return {std::move(result.points),
            {result.unknowns, result.iterations, result.relative_residual, result.solve_seconds, 0},
            result.joined};
}

void warn_of_joined(const PatchOnDisk& disk, const PreparedShape& shape,
                    std::vector<std::string>& warnings) {
    if (disk.joined > 0) warnings.push_back(separate_parts(shape.name, disk.joined));
}

}  // namespace pointmorph

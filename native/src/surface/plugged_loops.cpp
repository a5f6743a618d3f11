#include "surface/plugged_loops.hpp"

#include <algorithm>
#include <numbers>

#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

std::vector<BoundaryLoop> unplugged_loops(const Positions& positions, const Neighborhoods& nearest,
                                          std::span<const BoundaryLoop> loops,
                                          std::span<const Index> labels) {
    constexpr double kNext = 0.25;               // of the radius of the loop …
    constexpr double kLeast = 3.0, kMost = 6.0;  // … but so many spacings
    constexpr double kAllRound = 0.8;
    std::vector<BoundaryLoop> result(loops.begin(), loops.end());
    const auto is_like_first = [&](Index label) { return label == labels.front(); };
    if (loops.empty() || std::ranges::all_of(labels, is_like_first)) return result;
    const KdTree<3> tree(positions);
    const Values spacing = local_spacing(positions, nearest);
    std::vector<std::pair<Index, double>> near;
    std::erase_if(result, [&](const BoundaryLoop& loop) {
        const double radius = loop_length(positions, loop) / (2.0 * std::numbers::pi);
        const auto has_other = [&](Index row) {
            tree.within_unsorted(
                positions.row(row).data(),
                std::clamp(kNext * radius, kLeast * spacing[row], kMost * spacing[row]), near);
            return std::ranges::any_of(near, [&](const auto& found) {
                return labels[to_size(found.first)] != labels[to_size(row)];
            });
        };
        return static_cast<double>(std::ranges::count_if(loop, has_other)) >=
               kAllRound * static_cast<double>(loop.size());
    });
    return result;
}

}  // namespace pointmorph

#include "mesh/coarse_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <functional>
#include <limits>
#include <optional>
#include <queue>
#include <tuple>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"

namespace pointmorph {

namespace {

/// The places that triangles connect with each place.
class Connections {
public:
    explicit Connections(const Mesh& mesh)
        : offsets_(to_size(mesh.positions.rows()) + 1, 0),
          places_(to_size(2 * mesh.triangles.size())) {
        for (Index c = 0; c < mesh.triangles.size(); ++c)
            offsets_[to_size(mesh.triangles(c / 3, c % 3)) + 1] += 2;
        for (std::size_t v = 1; v < offsets_.size(); ++v) offsets_[v] += offsets_[v - 1];
        std::vector<Index> next(offsets_.begin(), offsets_.end() - 1);
        for (Index c = 0; c < mesh.triangles.size(); ++c)
            for (Index step = 1; step < 3; ++step)
                places_[to_size(next[to_size(mesh.triangles(c / 3, c % 3))]++)] =
                    mesh.triangles(c / 3, (c + step) % 3);
    }

    std::span<const Index> of(Index place) const {
        const Index begin = offsets_[to_size(place)];
        return std::span(places_).subspan(to_size(begin),
                                          to_size(offsets_[to_size(place) + 1] - begin));
    }

private:
    std::vector<Index> offsets_, places_;
};

/// The number of the seed nearest to each place along the edges; −1 where none is connected.
std::vector<Index> nearest_seeds(const Mesh& mesh, const Connections& connections,
                                 const std::vector<Index>& seeds, Progress& progress) {
    const auto count = to_size(mesh.positions.rows());
    std::vector<Index> owner(count, -1);
    std::vector<double> distance(count, std::numeric_limits<double>::infinity());
    using Entry = std::tuple<double, Index, Index>;  // distance, seed's number, place
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
    for (std::size_t s = 0; s < seeds.size(); ++s) {
        distance[to_size(seeds[s])] = 0.0;
        queue.emplace(0.0, to_index(s), seeds[s]);
    }
    for (Index popped = 0; !queue.empty(); ++popped) {
        const auto [so_far, seed, place] = queue.top();
        queue.pop();
        if (popped % 4096 == 0) progress.report(0.0);
        if (owner[to_size(place)] >= 0) continue;
        owner[to_size(place)] = seed;
        for (const Index to : connections.of(place)) {
            const double there =
                so_far + (mesh.positions.row(to) - mesh.positions.row(place)).norm();
            if (owner[to_size(to)] >= 0 || there >= distance[to_size(to)]) continue;
            distance[to_size(to)] = there;
            queue.emplace(there, seed, to);
        }
    }
    return owner;
}

CoarseMesh coarse_mesh(const Mesh& fine, const KdTree<3>& tree, const Connections& connections,
                       Index count, std::span<const Index> kept, Progress& progress) {
    CoarseMesh result;
    result.rows = poisson_disk_subset(tree, fine.place_normals, kept, count, progress).rows;
    std::ranges::sort(result.rows);
    const std::vector<Index> owner = nearest_seeds(fine, connections, result.rows, progress);

    std::vector<std::array<Index, 3>> triangles;
    for (Index f = 0; f < fine.triangles.rows(); ++f) {
        std::array<Index, 3> t;
        for (Index k = 0; k < 3; ++k) t[to_size(k)] = owner[to_size(fine.triangles(f, k))];
        std::ranges::rotate(t, std::ranges::min_element(t));
        if (t[0] >= 0 && t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) triangles.push_back(t);
    }
    std::ranges::sort(triangles);
    triangles.erase(std::ranges::unique(triangles).begin(), triangles.end());

    Positions positions = gather(fine.positions, result.rows);
    std::erase_if(triangles, [&](const std::array<Index, 3>& t) {
        const Eigen::RowVector3d u = positions.row(t[1]) - positions.row(t[0]);
        const Eigen::RowVector3d v = positions.row(t[2]) - positions.row(t[0]);
        return !(u.cross(v).norm() > 0.0);
    });
    Triangles all(static_cast<Eigen::Index>(triangles.size()), 3);
    for (std::size_t f = 0; f < triangles.size(); ++f)
        all.row(static_cast<Eigen::Index>(f)) << triangles[f][0], triangles[f][1], triangles[f][2];
    result.mesh = mesh_of(fine.unit, std::move(positions), std::move(all));
    return result;
}

}  // namespace

std::vector<CoarseMesh> coarse_meshes(const Mesh& fine, std::span<const Index> counts,
                                      std::span<const Index> kept, Progress& progress) {
    std::vector<CoarseMesh> result(counts.size());
    if (counts.empty()) return result;
    const Progress::Part part(progress, 0.0, 0.0);
    std::optional<KdTree<3>> tree;
    std::optional<Connections> connections;
    parallel_invoke(2, progress, [&](int k, Progress&) {
        if (k == 0)
            tree.emplace(fine.positions);
        else
            connections.emplace(fine);
    });
    parallel_invoke(static_cast<int>(counts.size()), progress, [&](int k, Progress& its) {
        result[to_size(k)] = coarse_mesh(fine, *tree, *connections, counts[to_size(k)], kept, its);
    });
    return result;
}

}  // namespace pointmorph

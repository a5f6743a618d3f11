#include "mesh/rigid_regions.hpp"

#include <utility>

#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/similarity.hpp"

namespace pointmorph {

RigidRegions::RigidRegions(const Mesh& mesh, const Values& weights) : weights_(weights) {
    if (weights.rows() == 0 || !(weights.maxCoeff() > 0.0)) return;
    const auto count = to_index(mesh.positions.rows());
    std::vector<std::vector<Index>> next(to_size(count));
    Values areas = Values::Zero(count);
    for (Index f = 0; f < mesh.triangles.rows(); ++f)
        for (Index k = 0; k < 3; ++k) {
            const Index from = mesh.triangles(f, k), to = mesh.triangles(f, (k + 1) % 3);
            areas[from] += mesh.areas[f] / 3.0;
            if (!(weights[from] > 0.0 && weights[to] > 0.0)) continue;
            next[to_size(from)].push_back(to);
            next[to_size(to)].push_back(from);
        }
    std::vector<char> seen(to_size(count), 0);
    for (Index seed = 0; seed < count; ++seed) {
        if (!(weights[seed] > 0.0) || std::exchange(seen[to_size(seed)], 1)) continue;
        Region region;
        region.places.push_back(seed);
        for (std::size_t k = 0; k < region.places.size(); ++k)
            for (const Index to : next[to_size(region.places[k])])
                if (!std::exchange(seen[to_size(to)], 1)) region.places.push_back(to);
        region.rest = gather(mesh.positions, region.places);
        double sum = 0.0;
        for (const Index place : region.places) {
            region.shares.push_back(weights[place] * areas[place]);
            sum += region.shares.back();
        }
        if (!(sum > 0.0)) continue;
        Eigen::RowVector3d mean = Eigen::RowVector3d::Zero();
        for (std::size_t k = 0; k < region.places.size(); ++k) {
            region.shares[k] /= sum;
            mean += region.shares[k] * region.rest.row(static_cast<Eigen::Index>(k));
        }
        region.rest.rowwise() -= mean;
        region.spread = 0.0;
        for (std::size_t k = 0; k < region.places.size(); ++k)
            region.spread +=
                region.shares[k] * region.rest.row(static_cast<Eigen::Index>(k)).squaredNorm();
        if (region.spread > 0.0) regions_.push_back(std::move(region));
    }
}

void RigidRegions::keep(Positions& x) const {
    for (const Region& region : regions_) {
        Vector3 mean = Vector3::Zero();
        for (std::size_t k = 0; k < region.places.size(); ++k)
            mean += region.shares[k] * x.row(region.places[k]).transpose();
        Matrix3 cross = Matrix3::Zero();
        for (std::size_t k = 0; k < region.places.size(); ++k)
            cross += region.shares[k] * (x.row(region.places[k]).transpose() - mean) *
                     region.rest.row(static_cast<Eigen::Index>(k));
        const BestRotation turn = best_rotation(cross);
        const Matrix3 linear = turn.trace / region.spread * turn.rotation;
        for (std::size_t k = 0; k < region.places.size(); ++k) {
            const Index place = region.places[k];
            const Vector3 kept =
                mean + linear * region.rest.row(static_cast<Eigen::Index>(k)).transpose();
            x.row(place) += weights_[place] * (kept.transpose() - x.row(place));
        }
    }
}

}  // namespace pointmorph

#include "mesh/mending.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "mesh/membrane.hpp"
#include "mesh/mesh_patches.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

Vector3 normal_at(const ElasticSheet& sheet, const Creases& creases, const Positions& x, Index v) {
    Vector3 sum = Vector3::Zero();
    for (const Index c : sheet.around(v)) sum += creases.facing(x, c / 3);
    const double length = sum.norm();
    return length > 0.0 ? Vector3(sum / length) : Vector3(Vector3::UnitZ());
}

class Mending {
public:
    Mending(const Mesh& mesh, const ElasticSheet& sheet, const MendTarget& target,
            TriangleTree& tree, Positions& x)
        : mesh_(mesh), sheet_(sheet), target_(target), creases_(mesh, sheet), tree_(tree), x_(x) {}

    void all(const std::vector<char>& is_fixed, Progress& progress) {
        for (const int rings : {1, 2}) {
            const std::vector<Index> faces = creased_faces(mesh_, sheet_, x_, progress);
            if (faces.empty()) return;
            mend(patches_around(mesh_, sheet_, faces, is_fixed, rings), progress);
        }
    }

private:
    /// Of each patch: the farthest of the samples for which it has the nearest face. `nearest` of
    /// each sample is found where it is empty.
    std::vector<double> farthest(const std::vector<MeshPatch>& patches, std::vector<Index>& nearest,
                                 Progress& progress) const {
        const auto count = to_index(target_.samples.rows());
        std::vector<Index> patch_of(to_size(mesh_.triangles.rows()), -1);
        for (std::size_t p = 0; p < patches.size(); ++p)
            for (const Index f : patches[p].faces) patch_of[to_size(f)] = to_index(p);
        const bool is_first = nearest.empty();
        nearest.resize(to_size(count), -1);
        std::vector<double> distances(to_size(count), 0.0);
        parallel_for(
            count, progress,
            [&](Index begin, Index end) {
                for (Index s = begin; s < end; ++s) {
                    Index& face = nearest[to_size(s)];
                    if (!is_first && (face < 0 || patch_of[to_size(face)] < 0)) continue;
                    const SurfacePoint point =
                        tree_.closest(target_.samples.row(s).transpose(), 0.1, face);
                    if (is_first) face = point.triangle;
                    distances[to_size(s)] = std::sqrt(point.squared_distance);
                }
            },
            0.0, 0.0, 128);
        std::vector<double> result(patches.size(), 0.0);
        for (Index s = 0; s < count; ++s) {
            const Index face = nearest[to_size(s)];
            if (face < 0 || patch_of[to_size(face)] < 0) continue;
            double& most = result[to_size(patch_of[to_size(face)])];
            most = std::max(most, distances[to_size(s)]);
        }
        return result;
    }

    void mend(const std::vector<MeshPatch>& patches, Progress& progress) {
        const Positions before = x_;
        std::vector<Index> creased(patches.size());
        for (std::size_t p = 0; p < patches.size(); ++p)
            creased[p] = creases_.around(x_, patches[p].faces);
        tree_.move(x_, progress);
        std::vector<Index> nearest;
        const std::vector<double> far = farthest(patches, nearest, progress);
        parallel_for(
            to_index(patches.size()), progress,
            [&](Index begin, Index end) {
                Progress silent;
                for (Index p = begin; p < end; ++p)
                    span_membrane(sheet_.laplacian(), patches[to_size(p)].vertices, x_, silent);
            },
            0.0, 0.0, 1);
        land(patches, progress);
        tree_.move(x_, progress);
        const std::vector<double> then = farthest(patches, nearest, progress);
        constexpr double kBarelyMore = 1.05;
        for (std::size_t p = 0; p < patches.size(); ++p) {
            const bool is_better = creases_.around(x_, patches[p].faces) < creased[p];
            const bool covers = then[p] <= std::max(kBarelyMore * far[p], target_.reach) &&
                                moved(patches[p], before) <= target_.farthest;
            for (const Index v : patches[p].vertices) {
                if (!is_better || !covers) x_.row(v) = before.row(v);
            }
        }
        // Patches side by side of which one is taken back.
        take_back_creases(mesh_, sheet_, before, {}, x_, progress);
    }

    /// The farthest way of a vertex.
    double moved(const MeshPatch& patch, const Positions& before) const {
        double most = 0.0;
        for (const Index v : patch.vertices)
            most = std::max(most, (x_.row(v) - before.row(v)).norm());
        return most;
    }

    /// A patch may be most of the mesh.
    void land(const std::vector<MeshPatch>& patches, Progress& progress) {
        std::vector<Index> vertices;
        for (const MeshPatch& patch : patches)
            vertices.insert(vertices.end(), patch.vertices.begin(), patch.vertices.end());
        std::vector<Vector3> landed(vertices.size());
        parallel_for(
            to_index(vertices.size()), progress,
            [&](Index begin, Index end) {
                for (auto i = to_size(begin); i < to_size(end); ++i) {
                    const Index v = vertices[i];
                    landed[i] = target_.landed(v, x_.row(v).transpose(),
                                               normal_at(sheet_, creases_, x_, v));
                }
            },
            0.0, 0.0, 64);
        for (std::size_t i = 0; i < vertices.size(); ++i)
            x_.row(vertices[i]) = landed[i].transpose();
    }

    const Mesh& mesh_;
    const ElasticSheet& sheet_;
    const MendTarget& target_;
    Creases creases_;
    TriangleTree& tree_;
    Positions& x_;
};

}  // namespace

void mend(const Mesh& mesh, const ElasticSheet& sheet, const MendTarget& target,
          const std::vector<char>& is_fixed, TriangleTree& tree, Positions& x, Progress& progress) {
    Mending(mesh, sheet, target, tree, x).all(is_fixed, progress);
}

}  // namespace pointmorph

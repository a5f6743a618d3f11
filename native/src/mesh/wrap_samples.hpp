// Samples of the surface that a mesh is wrapped onto, and which of them are whose partners. Not for
// callers of the library.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "base/grouped.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/mesh/wrapping.hpp"

namespace pointmorph {

/// The closest sample of each vertex: a row a vertex.
struct WrapPartners {
    Positions positions;
    Normals normals;
};

/// The part of the target whose samples lie nearest to most of each part of the mesh, which is at
/// `start`; −1 where none has most, or where it is much of another that nothing else becomes.
/// `parts` says which part each of the samples belongs to.
std::vector<Index> parts_kept_to(const Mesh& mesh, const Positions& start, const Positions& samples,
                                 const std::vector<Index>& parts);

/// Trees of the samples of a target, for all meshes that are wrapped onto it.
class WrapTrees {
public:
    /// kCoarse: coarse samples, with smooth normals that count much; kFine: fine ones, whose
    /// normals only tell both sides of a sheet apart.
    enum Kind { kCoarse, kFine };

    /// Lengths of the target are multiplied by `scale`, to be in √area. Keeps a reference.
    WrapTrees(const WrapTarget& target, double scale);
    ~WrapTrees();

    class Tree;
    /// Of one part of the target; −1: of all of it. Made when first asked for; not in parallel.
    const Tree& of_part(Kind kind, Index part, Progress& progress);
    /// What of_part() has made.
    const Tree& made(Kind kind, Index part) const { return *trees_[kind][to_size(part + 1)]; }

    const WrapTarget& target() const { return target_; }
    double scale() const { return scale_; }

private:
    const WrapTarget& target_;
    double scale_;
    Normals smooth_;                               ///< of the coarse samples, once asked for
    Grouped<Index> rows_[2];                       ///< of each part, once asked for
    std::vector<std::unique_ptr<Tree>> trees_[2];  ///< of all, then by part
};

class WrapSamples {
public:
    using Kind = WrapTrees::Kind;

    /// `start` decides which part of the target each part of the mesh keeps to. `on_mesh`: where
    /// each coarse sample lies on it, as in WrapTarget. Keeps references.
    WrapSamples(const Mesh& mesh, const Positions& start, const std::vector<SurfacePoint>& on_mesh,
                WrapTrees& trees);

    /// The closest in position and normal, from the part of the target that the vertex keeps to.
    /// Remembers them, to be faster the next time.
    WrapPartners partners(const Positions& x, const Normals& normals, Kind kind,
                          Progress& progress);

    /// The partner among fine samples of one vertex of the mesh at a place, facing so: its place
    /// and normal. After partners() of all of them.
    std::pair<Vector3, Vector3> partner(Index vertex, const Vector3& place,
                                        const Vector3& normal) const;

    /// Coarse samples that are farther than `distance` from every face, and have a place on the
    /// mesh on a part that keeps to theirs; ascending.
    std::vector<Index> uncovered(const TriangleTree& mesh, double distance,
                                 Progress& progress) const;

    /// Of the coarse samples.
    const SurfacePoint& on_mesh(Index sample) const { return on_mesh_[to_size(sample)]; }
    Index size() const { return to_index(on_mesh_.size()); }
    Vector3 position(Index sample) const;
    double share() const;  ///< of the area, of each sample

private:
    const Mesh& mesh_;
    const std::vector<SurfacePoint>& on_mesh_;
    WrapTrees& trees_;
    std::vector<Index> target_parts_;  ///< of each part of the mesh; −1: all
    std::vector<Index> last_[2];       ///< partners, rows of the trees; −1: none yet
};

}  // namespace pointmorph

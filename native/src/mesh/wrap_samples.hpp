// Samples of the surface that a mesh is wrapped onto, and which of them are whose partners. Not for
// callers of the library.
#pragma once

#include <memory>
#include <vector>

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

class WrapSamples {
public:
    /// kCoarse: among coarse samples, with smooth normals that count much; kFine: among fine ones,
    /// whose normals only tell both sides of a sheet apart.
    enum Kind { kCoarse, kFine };

    /// `start` decides which part of the target each part of the mesh keeps to. Lengths of the
    /// target are multiplied by `scale`, to be in √area.
    WrapSamples(const Mesh& mesh, const Positions& start, const WrapTarget& target, double scale);
    ~WrapSamples();

    /// The closest in position and normal, from the part of the target that the vertex keeps to.
    /// Remembers them, to be faster the next time.
    WrapPartners partners(const Positions& x, const Normals& normals, Kind kind,
                          Progress& progress);

    /// Coarse samples that are farther than `distance` from every face, and have a place on the
    /// mesh on a part that keeps to theirs; ascending.
    std::vector<Index> uncovered(const TriangleTree& mesh, double distance,
                                 Progress& progress) const;

    /// Of the coarse samples.
    const SurfacePoint& on_mesh(Index sample) const;
    Vector3 position(Index sample) const;
    double share() const;  ///< of the area, of each sample

private:
    struct Tree;
    const Tree& tree(Kind kind, Index part) const;
    void make_trees(Kind kind, Progress& progress);

    const Mesh& mesh_;
    const WrapTarget& target_;
    double scale_;
    std::vector<Index> target_parts_;              ///< of each part of the mesh; −1: all
    std::vector<std::unique_ptr<Tree>> trees_[2];  ///< by part of the target, then all of it
    std::vector<Index> last_[2];                   ///< partners, rows of the trees; −1: none yet
};

}  // namespace pointmorph

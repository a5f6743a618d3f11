// Stage `mesh_motion`: a mesh on its way to where it ends, with its faces kept from turning over.
#pragma once

#include <memory>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/frames/motion.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

/// Like Motion, but on a rigid path every triangle turns by t of its own angle and stretches by t
/// of its own stretch, and the vertices follow from that by a Poisson equation on the mesh (Alexa,
/// Cohen-Or and Levin 2000; Xu et al. 2005). Neighbors turn the same way round, however far. Parts
/// that aren't connected go where Motion takes them.
class MeshMotion {
public:
    /// Vertices of a mesh and their `ends`, all #vertices by 3. Keeps a reference to `mesh`. Throws
    /// Cancelled.
    MeshMotion(const Mesh& mesh, const OrientedView& vertices, const Positions& ends,
               const GradualSimilarity& similarity, PathKind path, Progress& progress);
    ~MeshMotion();
    MeshMotion(MeshMotion&&) noexcept;

    /// #vertices by 3, for t from 0 to 1; at the ends those given, up to rounding. May be called
    /// from several threads at once. Throws Cancelled.
    Positions at(double t, Progress& progress) const;
    Positions at(double t) const;

private:
    struct Bend;

    GradualSimilarity similarity_;
    Motion motion_;
    std::unique_ptr<const Bend> bend_;  ///< null unless the path is rigid
    /// A vertex that lies beside the first one of its place at an end, by rounding or as it is
    /// told.
    struct Beside {
        Index vertex;
        Eigen::RowVector3d here, there;
    };
    std::vector<Beside> beside_;
};

}  // namespace pointmorph

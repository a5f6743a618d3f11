// Stage `mesh_quality`: how good the source's own faces look where they are wrapped onto the
// target, in four figures, and where they don't. Not in the paper, which has no faces.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/mesh/mesh.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

/// A wrapped mesh in figures; 0 is perfect.
struct MeshFigures {
    /// Share of the area: faces that lie against the target and bend by over 120° to a neighbor,
    /// but not at rest.
    double folded = 0.0;
    /// Share of the edges that bend by over 90°, but not at rest, and not along a bend of the
    /// target.
    double creased = 0.0;
    /// 99th percentile of the distance from the target to the mesh, in √area of the target.
    double uncovered = 0.0;
    /// Mean distance from the vertices to the target, in √area of the target.
    double off = 0.0;
};

/// In the order of the figures.
enum class MeshFlaw { kFolded, kCreased, kUncovered, kOff };
/// "folded", "creased" …
std::string name_of(MeshFlaw flaw);

/// kGood: nobody will see a flaw. kFair: in close-ups. kPoor: at once.
enum class MeshGrade { kGood, kFair, kPoor };
/// "good", "fair" or "poor".
std::string name_of(MeshGrade grade);

/// The grade of the figure that is worst, by fixed limits.
MeshGrade grade_of(const MeshFigures& figures);

/// A place where faults of one kind lie together.
struct MeshPlace {
    MeshFlaw flaw;
    Index source;      ///< the vertex there; kUncovered: the one that the mesh comes nearest with
    Index target;      ///< row nearest to the place
    Vector3 position;  ///< on the wrapped mesh; kUncovered: on the target
    /// How much of the figure lies here. kFolded: share of the area; kCreased: of the edges;
    /// kUncovered: of the target's area, what is farther than 0.007 √area; kOff: of the vertices,
    /// what is farther than 0.005 √area.
    double share;
    double distance;    ///< kUncovered, kOff: the largest, in √area; else 0
    std::string where;  ///< "toward +X of Fox", "near \"nose\""
    std::string advice;
};

struct MeshQuality {
    MeshFigures figures;
    MeshGrade grade = MeshGrade::kGood;
    std::string verdict;           ///< a sentence
    std::vector<MeshPlace> worst;  ///< at most five, far apart, the worst first
};

/// A source with faces, and where its vertices end.
struct WrappedMesh {
    const Cloud& cloud;
    const Mesh& mesh;            ///< of the cloud's faces
    const Positions& positions;  ///< #vertices by 3, in the target's coordinates
    /// Whether what the target has beyond the mesh's borders, where it goes on, isn't missed.
    bool leaves_missing = false;
};

/// What it was wrapped onto.
struct WrappedSurface {
    const Cloud& cloud;  ///< with normals
    const Mesh* mesh;    ///< of the cloud's faces; null where it has none
};

/// `features` give the advice its words. The result doesn't depend on scale, position or
/// orientation of either shape, nor on the number of threads.
MeshQuality measure_mesh_quality(const WrappedMesh& wrapped, const WrappedSurface& target,
                                 std::span<const Feature> features, Progress& progress);

}  // namespace pointmorph

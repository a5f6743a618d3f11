// Stage `wrapping`: a mesh, laid over another surface by a map, deformed until its faces fit that
// surface smoothly, into its tips and hollows, without folds or creases.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/mesh/closest_point.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

struct WrapOptions {
    /// Lengths over which the mesh gives way, from the first to the last, each a share of the one
    /// before; in √area of the target.
    double first_length = 0.08;
    double last_length = 0.002;
    double share = 0.6;
    Index iterations = 3;  ///< for each length
    /// Of a mesh with more than twice as many places, so many stand for all while lengths are over
    /// this one, in √area; then four times as many down to half of it, and so on.
    Index coarse_places = 4000;
    double coarse_length = 0.03;
    Index untangling = 3;  ///< rounds in which faces that lie against the target are turned back
    /// How many times vertices slide along the target, at the end, toward where faces are more
    /// like those of the source.
    Index relaxing = 0;
    /// How firmly vertices go onto the target: 1 all the way, 0 only where the map and the faces
    /// around take them.
    double conform = 1.0;
    /// Whether vertices stay off the target where going onto it would crease the mesh.
    bool keep_uncreased = true;
};

/// The surface that a mesh is laid over. Rows of the arrays are samples; lengths are the caller's.
struct WrapTarget {
    const Mesh* mesh = nullptr;  ///< its faces, where it has some
    OrientedPoints coarse;       ///< some thousand, evenly spread: those of the map
    OrientedPoints fine;         ///< many more, or the same
    /// The part of the surface that each belongs to, 0 … #parts − 1; empty: one part.
    std::vector<Index> coarse_parts, fine_parts;
    double area = 1.0;
    std::vector<Positions> borders;  ///< closed polygons along which the surface ends
    /// Where each coarse sample lies on the mesh, by the inverse map; triangle −1: nowhere.
    std::vector<SurfacePoint> on_mesh;
};

/// A place of the mesh that has to end exactly at a point of the target.
struct WrapMark {
    Index place;
    Vector3 target;
};

/// What a mesh keeps while it is wrapped. Arrays have a row a place, or none.
struct WrapHolds {
    std::span<const WrapMark> marks;
    /// How much a place keeps the shape of what is connected and rigid around it, 0 to 1; a region
    /// of them turns, moves and grows as a whole.
    Values rigid{};
    Values fixed{};      ///< how much a place stays at its row of `places`, 0 to 1
    Positions places{};  ///< in the lengths of the target
};

/// Where the places of the mesh end, #places by 3. `start` is where the map takes them; places
/// without triangles stay there. From long lengths to short ones, the mesh as an elastic sheet (see
/// ElasticSheet) is drawn to the tangent planes of the closest samples that face as it does, of the
/// part that most of its own part lies on; where no face reaches, the point that the inverse map
/// names is pulled there. Places that are fixed in full end where they are held, to the bit, and so
/// do marks, which come first. Small parts for which the target has nothing, such as eyeballs, keep
/// their shape and go along with what is around them. A start that is the target's own mesh is the
/// result, to the bit. Turns, scales and moves with the target. The same bits for any number of
/// threads.
Positions wrap(const Mesh& mesh, Positions start, const WrapTarget& target, const WrapHolds& holds,
               const WrapOptions& options, Progress& progress);

}  // namespace pointmorph

// Faces of a wrapped mesh that lie against the target, turned back in their surroundings. Not for
// callers of the library.
#pragma once

#include <functional>
#include <vector>

#include "mesh/creases.hpp"
#include "mesh/elastic_sheet.hpp"
#include "mesh/wrap_samples.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

struct UntangleOptions {
    /// Cosine between a face and the plane at it below which it has to be turned back.
    double least_agreement = 0.3;
    int rings = 4;                ///< of faces around such a face that give way
    double plane_length = 0.003;  ///< distance from the plane that counts as much as a stretch
    int most_rounds = 8;
    int most_steps = 40;  ///< in each round
    /// Which faces are to be turned back; all where there is none.
    std::function<bool(Index)> concerns = {};
    /// What each face would be: its sides from the first corner, in a plane; what the sheet's
    /// metric has it be where there is none.
    std::function<Matrix2(Index)> sides = {};
    /// Whether the least energy is found to many digits, as for places that are to change smoothly.
    bool is_exact = false;
    /// Faces are measured in space instead of by what of them is seen in the planes, and vertices
    /// are drawn to where they were, by as much as a stretch at this distance: on a coarse mesh the
    /// planes alone hold next to nothing. None where it's 0.
    double reach = 0.0;
    /// How far a face that is to be turned back takes its surroundings along, 0 to 1; all the way
    /// where there is none. Of several within reach of a vertex, the one that takes it farthest
    /// counts.
    std::function<double(Index)> share = {};
    /// Surroundings in which more sides of faces would become creases than faces are turned back
    /// stay as they were, where these are given.
    const Creases* creases = nullptr;
    /// Of each face: the area of the target that has its place there and that no face reaches, with
    /// vertices at these places; in the unit of the sheet's metric. Surroundings that would bare
    /// more of it than faces are turned back stay as they were, where this is given; all are judged
    /// with all of them moved.
    std::function<Values(const Positions&)> bare = {};
    /// How far a vertex is off the target at a place; asked by several threads. Where this is
    /// given, vertices stay where they were, with those around them, that would get farther off
    /// than any of their surroundings was and than `most_off`; if they aren't few, so do all of
    /// these surroundings. Planes that cross, as at webs over holes of the target, let vertices go
    /// anywhere.
    std::function<double(Index, const Vector3&)> off = {};
    double most_off = 0.05;
};

/// Moves vertices around faces that lie against `planes`, in these, until none does or nothing gets
/// better: the energy of each face, against what it would be, grows beyond limits as the face
/// collapses (Garanzha et al., Foldover-Free Maps in 50 Lines of Code, 2021, in
/// the tangent planes). `is_fixed` vertices stay. Returns the number of faces that still lie
/// against the planes.
Index untangle(const Mesh& mesh, const ElasticSheet& sheet, const WrapPartners& planes,
               const std::vector<char>& is_fixed, const UntangleOptions& options, Positions& x,
               Progress& progress);

}  // namespace pointmorph

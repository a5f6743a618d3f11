// Edges at which a wrapped mesh bends and the source doesn't. Not for callers of the library.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "mesh/elastic_sheet.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

/// An edge of two faces is a crease where the mesh bends by more than 90° and the source doesn't.
/// Keeps references.
class Creases {
public:
    Creases(const Mesh& mesh, const ElasticSheet& sheet) : mesh_(mesh), sheet_(sheet) {}

    /// A face's normal at `x`, twice as long as its area.
    Vector3 facing(const Positions& x, Index f) const;
    /// How many sides of a face are creases.
    Index of_face(const Positions& x, Index f) const;
    /// Of some faces; edges between two of them count twice.
    Index around(const Positions& x, std::span<const Index> faces) const;

private:
    /// The face on the other side of an edge; −1 unless there are two.
    Index across(Index f, Index k) const;

    const Mesh& mesh_;
    const ElasticSheet& sheet_;
};

/// Faces at creases; ascending.
std::vector<Index> creased_faces(const Mesh& mesh, const ElasticSheet& sheet, const Positions& x,
                                 Progress& progress);

/// Takes the vertices of faces back that are worse, until none is or none of its vertices can be.
/// `is_worse` depends on a face and those at its sides, and is called in parallel; `back` says
/// whether the vertex has moved.
void take_back(const Mesh& mesh, const ElasticSheet& sheet,
               const std::function<bool(Index face)>& is_worse,
               const std::function<bool(Index vertex)>& back, Progress& progress);

/// Takes vertices of `x` back to where they were `before`, until no face has more creases than it
/// had there. `stays` of a vertex: whether it isn't taken back; none where it is empty.
void take_back_creases(const Mesh& mesh, const ElasticSheet& sheet, const Positions& before,
                       const std::vector<char>& stays, Positions& x, Progress& progress);

}  // namespace pointmorph

// What the faces of a patch of a mesh cost by how they are laid into planes. Not for callers of the
// library.
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "base/grouped.hpp"
#include "mesh/elastic_sheet.hpp"
#include "mesh/mesh_patches.hpp"
#include "mesh/wrap_samples.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

/// The normal of the planes at a face's corners, of any length.
Vector3 plane_at(const Mesh& mesh, const WrapPartners& planes, Index f);

/// Grows beyond limits as a face collapses, against what it would be (Garanzha et al.,
/// Foldover-Free Maps in 50 Lines of Code, 2021, in the planes at its corners); and with the
/// distances of vertices from their planes.
class PatchEnergy {
public:
    /// Places of the patch's vertices, x y z of each in turn.
    using Unknowns = Eigen::VectorXd;

    struct Terms {
        /// What a face would be: its sides from the first corner, in a plane.
        std::function<Matrix2(Index)> sides;
        double plane_length;  ///< distance from the plane that counts as much as a stretch
        /// Distance from the start that does so, too; 0 where none counts. Then faces are measured
        /// in space instead of in the planes.
        double reach;
        Values shares;  ///< of the vertices: they are drawn to the start by as much less
    };

    /// Its start is at `x`.
    PatchEnergy(const Mesh& mesh, const WrapPartners& planes, const MeshPatch& patch,
                const Terms& terms, const Positions& x);

    std::size_t faces() const { return faces_.size(); }
    const Unknowns& start() const { return start_; }

    /// The least determinant of a face's map.
    double least_determinant(const Unknowns& at) const;

    /// The energy and its gradient; `soft` lets faces pass through zero. On all threads, with the
    /// same bits for any number of them. Throws Cancelled.
    double operator()(const Unknowns& at, double soft, Unknowns& gradient, Progress& progress);

private:
    using Sides = Eigen::Matrix<double, 3, 2>;
    static constexpr double kArea = 1.0;  ///< how much areas count against angles

    struct Face {
        Eigen::Matrix<double, 2, 3> axes;
        Matrix2 inverse;
        double area;
        std::array<Index, 3> numbers;  ///< of its corners in the patch; −1 − row in held_
    };

    void add_face(const Vector3& normal, const Matrix2& sides);
    void number_corners(const Mesh& mesh, const MeshPatch& patch, const Positions& x);
    void hold_vertices(const WrapPartners& planes, const MeshPatch& patch, const Terms& terms);
    Sides sides_of(const Face& face, const Unknowns& at) const;
    double of_face(std::size_t i, const Unknowns& at, double soft);
    double of_vertex(Index v, const Unknowns& at, Unknowns& gradient) const;

    /// What holds a vertex: its plane, and its start.
    struct Hold {
        Vector3 normal;
        double height;  ///< of the plane along its normal
        double weight;  ///< of the distance from the plane
        double pull;    ///< toward the start; 0 where nothing pulls
    };

    bool is_flat_;  ///< faces are measured in the planes
    std::vector<Face> faces_;
    std::vector<Vector3> held_;  ///< places of corners that don't move
    std::vector<Hold> holds_;
    std::vector<Vector3> forces_;  ///< on the corners of faces
    Grouped<Index> corners_;       ///< of each vertex, rows of forces_
    Unknowns start_;
    std::vector<double> sums_;  ///< of the energies of faces, then vertices, some at a time
};

}  // namespace pointmorph

// A mesh as an elastic sheet that may stretch smoothly. Not for callers of the library.
#pragma once

#include <Eigen/LU>
#include <span>
#include <vector>

#include "base/grouped.hpp"
#include "mesh/block_system.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

using Matrix2 = Eigen::Matrix2d;

/// What each triangle would be is its rest shape, stretched as the map stretches around it on the
/// average (its *metric*): what stretches smoothly isn't resisted, what folds or shears is. The
/// energy is ½ Σ w |(x_j − x_i) − (y_j − y_i)|² over the sides of triangles, with y the triangle as
/// it would be, turned to where it is: as the surface around its corners has turned (spokes and
/// rims; Sorkine and Alexa 2007, Chao et al. 2010), or laid into a plane and turned in that.
class ElasticSheet {
public:
    /// `rest` has a row a place; times `scale`, the surface has about unit area. Keeps references
    /// to both.
    ElasticSheet(const Positions& rest, const Triangles& triangles, Progress& progress,
                 double scale = 1.0);
    ElasticSheet(Positions&&, const Triangles&, Progress&, double = 1.0) = delete;

    const Laplacian& laplacian() const { return laplacian_; }
    /// Triangles around each vertex, as 3 f + corner.
    std::span<const Index> around(Index vertex) const { return corners_[vertex]; }

    /// Takes the metric from the present places, averaged over `sweeps` rings of vertices.
    void set_metric(const Positions& x, int sweeps, Progress& progress);
    /// The triangle as the metric would have it: its sides from the first corner, in a plane.
    Matrix2 metric_sides(Index triangle) const {
        return stretch(triangle) * at_rest(triangle).sides;
    }
    /// Of each triangle: by how much the metric makes the area larger.
    double area_ratio(Index triangle) const;

    /// Right side L y for the local turns that suit `x` best; `flat` says how much triangles lie in
    /// the planes across `normals` (a unit row a vertex, averaged over corners), 0 to 1.
    Positions forces(const Positions& x, const Normals& normals, double flat, Progress& progress);

    /// Right side L y where triangle f would have its corners in the columns of `would(f)`. Forces
    /// of triangles are kept as numbers of the type `Kept` for a while.
    template <class Kept = double, class Would>
    Positions forces_toward(Would&& would, Progress& progress) const;

    /// How much each side of a triangle counts, from corner k to the next: its half cotangents.
    Vector3 weights(Index triangle) const {
        return kept_[to_size(triangle)].weights.cast<double>();
    }

    using Corners = Eigen::Matrix<double, 3, 3>;  ///< a corner a column
    Corners places(const Positions& x, Index f) const;

    /// Unit normals of vertices at `x`, by area; the rest's where there is none.
    Normals normals(const Positions& x, Progress& progress) const;

private:
    /// Axes in the triangle's plane, the first along its first side, and its sides from the first
    /// corner in these.
    struct Rest {
        Eigen::Matrix<double, 2, 3> frame;  ///< rows
        Matrix2 sides;                      ///< columns
    };
    /// What is kept of each triangle, in single precision: there are many. The rest is found anew
    /// from `rest_`.
    struct Triangle {
        Eigen::Vector3f weights;  ///< of the sides from corner k to the next
        Eigen::Vector3f metric;   ///< the stretch in the triangle's axes: xx, xy, yy
    };
    /// A symmetric matrix in space, or its logarithm: xx, xy, xz, yy, yz, zz.
    using Tensor = Eigen::Matrix<float, 6, 1>;

    Rest at_rest(Index f) const;
    Matrix2 stretch(Index f) const;
    void set_log_stretch(const Positions& x, Progress& progress);
    std::vector<Tensor> smoothed_log(int sweeps, Progress& progress) const;
    void find_laplacian(Progress& progress);
    void turn_vertices(const Positions& x, Progress& progress);
    Corners in_plane(const Corners& now, Index f, const Vector3& normal) const;

    const Positions* rest_;
    const Triangles* triangles_;
    double scale_;
    std::vector<Triangle> kept_;
    Laplacian laplacian_;
    Grouped<Index> corners_;      ///< around(), by vertex
    std::vector<Matrix3> turns_;  ///< of the vertices, once they have turned; kept as a start
};

template <class Kept, class Would>
Positions ElasticSheet::forces_toward(Would&& would, Progress& progress) const {
    const auto faces = to_index(kept_.size());
    // On the second and third corner; the first is pulled against both.
    std::vector<Eigen::Matrix<Kept, 3, 2>> of_faces(to_size(faces));
    parallel_for(faces, progress, [&](Index begin, Index end) {
        for (Index f = begin; f < end; ++f) {
            const Corners corners = would(f);
            Corners force = Corners::Zero();
            for (int k = 0; k < 3; ++k) {
                const int next = (k + 1) % 3;
                const Vector3 pull =
                    kept_[to_size(f)].weights[k] * (corners.col(next) - corners.col(k));
                force.col(next) += pull;
                force.col(k) -= pull;
            }
            of_faces[to_size(f)] = force.rightCols<2>().template cast<Kept>();
        }
    });
    const auto count = laplacian_.size();
    Positions result = Positions::Zero(count, 3);
    parallel_for(count, progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v)
            for (const Index c : around(v)) {
                const Eigen::Matrix<double, 3, 2> force =
                    of_faces[to_size(c / 3)].template cast<double>();
                if (c % 3 > 0)
                    result.row(v) += force.col(c % 3 - 1).transpose();
                else
                    result.row(v) -= (force.col(0) + force.col(1)).transpose();
            }
    });
    return result;
}

}  // namespace pointmorph

// Stage `covariance`: normals, surface variation and local frames (paper, Covariance Analysis).
#pragma once

#include <span>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// Eigen-decomposition of a covariance matrix (symmetric, positive semi-definite).
struct PrincipalAxes {
    Vector3 eigenvalues;  ///< λ0 ≤ λ1 ≤ λ2, ≥ 0
    Matrix3 axes;         ///< columns v0, v1, v2, orthonormal, right-handed; signs are arbitrary
};
/// To about 12 digits, whether eigenvalues agree or not. Zero has the identity for axes.
PrincipalAxes principal_axes(const Matrix3& covariance);

/// The covariance C = Σ (p − p̄)(p − p̄)ᵀ of some points.
struct LocalFrame {
    Vector3 centroid;     ///< p̄
    Vector3 eigenvalues;  ///< λ0 ≤ λ1 ≤ λ2, ≥ 0
    Matrix3 axes;         ///< columns v0, v1, v2 as in PrincipalAxes; v0 is the normal
};
LocalFrame local_frame(const Positions& positions, std::span<const Index> rows);

/// What the covariance of every point's neighborhood (and itself) says about the surface.
struct Covariance {
    Normals normals;   ///< v0 of every point, unit length; the sign is arbitrary
    Values variation;  ///< λ0 / (λ0 + λ1 + λ2), 0 (flat) to 1/3; 0 where all points coincide
};
Covariance covariance_analysis(const Positions& positions, const Neighborhoods& neighborhoods,
                               Progress& progress);

/// Makes the signs of `normals` agree over each component of the graph and point outward. Signs
/// spread along the edges of a minimum spanning tree (Hoppe et al. 1992), surest first: those that
/// lie in both tangent planes, between normals that one circular arc would turn into one another.
/// A closed component then gets positive volume, an open one faces away from its centroid, and one
/// that is flat upward (z, else y, else x: the direction that it faces most).
void orient_normals(const Positions& positions, const Neighborhoods& neighborhoods,
                    Normals& normals, Progress& progress);

}  // namespace pointmorph

// Stage `similarity`: the turn, scale and translation that best take points to points.
#pragma once

#include <span>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// The rotation R (determinant 1) with the largest tr(Rᵀ C), and that trace, ≥ 0 (Horn 1987, by
/// unit quaternions: reflections can't occur, whatever the rank of C).
struct BestRotation {
    Matrix3 rotation;
    double trace;
};
BestRotation best_rotation(const Matrix3& covariance);
/// Those of several, but for rounding, in a third of the time. `best` has as many.
void best_rotations(std::span<const Matrix3> covariances, std::span<BestRotation> best);

/// p ↦ scale · rotation · p + translation.
struct Similarity {
    double scale = 1.0;
    Matrix3 rotation = Matrix3::Identity();
    Vector3 translation = Vector3::Zero();

    Positions apply(const Positions& positions) const;  ///< #points by 3
    Normals rotated(const Normals& normals) const;      ///< by the rotation alone
    Similarity inverse() const;
};

/// First `before`, then `after`.
Similarity composed(const Similarity& after, const Similarity& before);

/// The similarity that takes `from` to `to` in the least squares sense, row by row. Scale 1 where
/// all of either coincide; the least turn where the points leave it open (fewer than three, or on
/// one line).
Similarity fit_similarity(const Positions& from, const Positions& to);

/// The same without a scale: the rotation and the translation that take `from` closest to `to`.
Similarity fit_rigid_motion(const Positions& from, const Positions& to);

/// How both ends of pairs lie about their means.
struct JointSpread {
    double from = 0.0, to = 0.0;           ///< sums of squared distances
    Matrix3 covariance = Matrix3::Zero();  ///< Σ to fromᵀ

    double from_size() const;  ///< root of the sum
    double to_size() const;
    double half_way() const;   ///< root of the sum for the places halfway between both ends
    Matrix3 rotation() const;  ///< that of fit_similarity()
};

/// In one pass, without a copy of the ends. There is a pair at least.
JointSpread joint_spread(const Positions& from, const Positions& to,
                         std::span<const IndexPair> pairs);

/// Whether the best similarity leaves them less than half as far apart (root mean square) where
/// `from` is mirrored first: left and right are probably swapped.
bool fits_better_mirrored(const Positions& from, const Positions& to);

}  // namespace pointmorph

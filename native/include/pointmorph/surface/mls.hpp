// Stage `mls`: the smooth surface that a cloud stands for (paper, eqs. (6)-(8); Alexa et al. 2003).
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

struct MlsOptions {
    /// Of the bivariate polynomial; 1 to 4.
    Index degree = 3;
    /// The kernel's h in spacings of the points around, 0.5 to 10; none: 0.9 + degree / 5, which
    /// leaves each polynomial enough points.
    std::optional<double> scale{};
    /// The kernel's h as a plain distance, the same everywhere; > 0. None: from the spacing.
    std::optional<double> width{};

    /// h where points are `spacing` apart.
    double kernel(double spacing) const;
};

/// Where a place is projected to.
struct MlsFoot {
    Vector3 position;
    Vector3 normal;  ///< unit length, from the polynomial's gradient
    /// False where the points around don't tell: too few, all on a line, or none within h of the
    /// foot. Position and normal are those given then.
    bool found;
};

/// The projection Ψ of eq. (6): the reference plane of eqs. (7) and (8) with the Gaussian kernel
/// exp(−d²/h²), then the polynomial over it, fitted with the same weights. The plane's direction
/// and distance are found together by Powell's method (Powell 1964), started at t = 0 with the
/// normal v0 of the points' weighted covariance.
///
/// A point counts by how far its normal agrees with the one given, and not at all from a right
/// angle on: both sides of a thin sheet don't mix. The foot is a continuous function of all input
/// (up to 1e-3 of a weight where the kernel is cut off), with the same bits on all processors of a
/// family. Keeps its memory: one object a thread.
class MlsProjection {
public:
    /// Keeps references to both. `normals`: one a point of the tree, unit length. The same bits
    /// with wide registers and without; `wide`: they may be used, where the processor has any.
    /// Throws OptionError.
    MlsProjection(const KdTree<3>& tree, const Normals& normals, const MlsOptions& options,
                  bool wide = true);

    /// `place` lies within about h of the surface, `normal` (unit length) says on which side;
    /// `spacing` > 0 is that of the points around.
    MlsFoot operator()(const Vector3& place, const Vector3& normal, double spacing);

private:
    /// A plane {x : ⟨n, x⟩ = t}, in units of h around the place.
    struct Plane {
        Vector3 normal;
        double t;
    };

    bool gather(const Vector3& place, const Vector3& normal, double h);
    std::optional<Vector3> covariance_normal(const Vector3& normal) const;
    Plane plane(const Vector3& start);
    double badness(const Vector3& normal, double t);

    const KdTree<3>& tree_;
    const Normals& normals_;
    MlsOptions options_;
    std::vector<std::pair<Index, double>> near_;
    // The points around in units of h from the place, with the kernel's weight at the place times
    // what their normal makes them count. Filled up with points of weight 0.
    Eigen::ArrayXd x_, y_, z_, weight_, height_;
    Eigen::ArrayXd terms_;  ///< scratch memory, as long
    Index padded_ = 0;
    bool wide_;
};

}  // namespace pointmorph

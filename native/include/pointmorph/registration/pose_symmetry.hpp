// A part of stage `pose`: the left and the right side of shapes, and maps that treat them alike.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/registration.hpp"

namespace pointmorph {

struct PoseOptions;

/// When a shape has a left and a right side, and how much a map is to treat them alike.
struct SymmetryOptions {
    /// A reflection is trusted where its energy is no more than the first, and less and less up to
    /// the second …
    double sure_energy = 0.035, most_energy = 0.046;
    /// … and where that of those in other pose clusters is larger by this factor or more: a vase
    /// has many.
    double least_margin = 1.25;
    /// A map's energy is multiplied by 1 + so many times its asymmetry(). 0: symmetry isn't looked
    /// for.
    double weight = 2.5;
    /// Distance in √area at which the two images of a point count as being elsewhere: limbs that
    /// lie on others do, poses that differ don't.
    double far = 0.2;
};

/// The reflection that takes the left side of a shape to its right, bent as the shape is.
struct Symmetry {
    Positions images;  ///< of the shape's points; no rows where no such reflection was found
    std::vector<Index> nearest = {};       ///< the shape's points to its images
    Matrix3 linear = Matrix3::Identity();  ///< what it does to small steps on average; improper
    double trust = 0.0;                    ///< 0 to 1
};

/// Registers a shape with its mirror image, at its coarsest level alone, from all ways in which
/// their principal axes match. `distances` are node_distances().
Symmetry reflection_symmetry(const CoarseShape& shape, const Eigen::MatrixXd& distances,
                             const PoseOptions& options, const RegistrationOptions& registration,
                             Progress& progress);

/// Where a map takes a shape's points: places on the other shape, and its points next to them.
struct Images {
    const Positions& places;
    std::vector<Index> nearest;
};

/// How differently a map treats the sides of the shapes, 0 to 1: for the distance d between the
/// images of a point that is reflected before and after the map, the mean of min(1, (d/far)²) over
/// both shapes, times the lesser trust in the symmetries (of source and target): 0 where one has
/// none. `source_images` are on the target, `target_images` on the source, both at rest; `far` is
/// SymmetryOptions::far.
double asymmetry(const CoarseShape& source, const CoarseShape& target,
                 const std::array<Symmetry, 2>& symmetries, const Images& source_images,
                 const Images& target_images, double far);

}  // namespace pointmorph

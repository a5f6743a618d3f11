// Stage `thin_plate`: where the points of two shapes start when features and guides say how they
// belong together.
#pragma once

#include <Eigen/Core>

#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/registration.hpp"

namespace pointmorph {

/// Places that belong together, a row each: the features', then those of some of the guides.
struct MarkedPlaces {
    Positions source, target;  ///< #places by 3
};
MarkedPlaces marked_places(const CoarsePair& shapes);

/// A smooth map of space with the kernel r (the biharmonic one in three dimensions) that takes
/// places to places, up to a little smoothing.
class ThinPlate {
public:
    /// #places by 3, row by row. What the places leave open (all in one plane) stays as it is.
    ThinPlate(const Positions& from, const Positions& to);

    Eigen::RowVector3d operator()(const Eigen::RowVector3d& place) const;

private:
    Positions from_;
    Eigen::MatrixXd coefficients_;
};

/// The thin plate through the marked places for the source, and the one back for the target; of
/// more than 500 features through so many of them. With fewer than five places the points stay
/// where they are.
RegistrationStart thin_plate_start(const CoarsePair& shapes);

}  // namespace pointmorph

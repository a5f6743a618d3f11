// How alike two surfaces are around points that a map takes to each other. Not a part of the
// library.
#pragma once

#include <array>
#include <span>

#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"

namespace pointmorph {

/// Radii of balls around a point, in √area of each shape.
using FormRadii = std::array<double, 3>;

/// .05, .1 and .2, and no less than two spacings of the sparser shape.
FormRadii form_radii(const CoarseShape& source, const CoarseShape& target);

/// #points by 9, the form of the surface around each, which no rotation changes: for each ball, the
/// area of the surface in it over r², how far that lies behind the point's tangent plane on
/// average, over r, and the mean cosine between its normals and the point's. They tell a nose from
/// an ear, and a thin tail from a leg. (Integral invariants: Pottmann et al., 2009.)
using LocalForms = Eigen::Matrix<double, Eigen::Dynamic, 9, Eigen::RowMajor>;

/// Those of a shape's coarse rows.
LocalForms local_forms(const CoarseShape& shape, std::span<const Index> rows,
                       const FormRadii& radii);

/// Divides each number by its standard deviation over both shapes, or by a least one where that is
/// less, as all of what is flat or round is alike but for its sampling.
void make_comparable(LocalForms& source, LocalForms& target);

/// The mean difference between numbers of points and those of others: `partners` has a row of
/// `there` for each row of `here`. Partners where the surface ends while the other's goes on say
/// nothing: `ends` are CoarseShape::ends of `there`.
double unlikeness(const LocalForms& here, const LocalForms& there, std::span<const Index> partners,
                  std::span<const char> ends);

}  // namespace pointmorph

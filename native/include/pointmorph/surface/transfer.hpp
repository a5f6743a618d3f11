// Stage `transfer`: where every point of one cloud goes on the other surface, smoothly, through
// the common domain. Pairs snap to samples; this doesn't.
#pragma once

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

struct TransferOptions {
    /// Points of the other cloud that take part in the local fit; 6 to 64.
    Index neighbors = 12;
};

/// For every row of `queries` (points of the common domain) the value that `values`, given at the
/// rows of `samples`, has there: a weighted linear least-squares fit over the nearest samples,
/// with weights that fade to 0 at the farthest, so that the result is continuous; exact for linear
/// functions inside the samples and a few spacings around. Farther off the fit fades out: results
/// stay within some standard deviations of the nearest samples' values. Where the samples around
/// lie on a line or a point, what is left of the fit; at the least the weighted mean.
/// `values` is #samples by 3, at least one; the result #queries by 3. Instantiated for Dim 2 and 3.
/// Throws OptionError.
template <int Dim>
Positions transfer(const KdTree<Dim>& samples, const Positions& values,
                   const typename KdTree<Dim>::Points& queries, const TransferOptions& options,
                   Progress& progress);

}  // namespace pointmorph

// The linear system that puts the points of a patch into the disk; not for callers of the library.
#pragma once

#include <Eigen/SparseCore>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

struct DiskSolution {
    DiskPoints points;
    Index iterations = 0;
    double relative_residual = 0;  ///< the larger one of both coordinates
};

/// Solves A x = b for both columns of b, side by side, by conjugate gradients. A is symmetric and
/// positive definite, and no entry beside its diagonal is positive. An incomplete Cholesky factor
/// evens out what differs between neighbors; the rest is that of a coarse system, of which each
/// unknown stands for some consecutive rows (Tang, Nabben, Vuik, Erlangga 2009, A-DEF2), which work
/// best where consecutive rows are points that lie near each other. Ends at a relative residual of
/// `tolerance`, or after `max_iterations`. Throws Cancelled.
DiskSolution solve_for_disk(const Eigen::SparseMatrix<double>& matrix, const DiskPoints& sides,
                            double tolerance, Index max_iterations, Progress& progress);

}  // namespace pointmorph

// Linear systems of a graph's Laplacian and a 3 by 3 block a vertex. Not for callers of the
// library.
#pragma once

#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// (L x)_i = Σ_j w_ij (x_i − x_j), rows of neighbors one after the other.
struct Laplacian {
    std::vector<Index> offsets{0};  ///< #vertices + 1
    std::vector<Index> neighbors;
    std::vector<double> weights;  ///< > 0
    std::vector<double> sums;     ///< of a vertex's weights

    Index size() const { return static_cast<Index>(sums.size()); }
};

struct SolveOptions {
    int most_iterations = 20;
    double tolerance = 1e-2;  ///< of the residual's norm, against the start's
};

/// x of L x + B x = b, with symmetric B ≥ 0 (a block a vertex), from the x given; conjugate
/// gradients, preconditioned by the blocks on the diagonal. Vertices with neither neighbors nor a
/// block keep their x. The same bits for any number of threads. Returns the iterations.
int solve(const Laplacian& laplacian, const std::vector<Matrix3>& blocks, const Positions& right,
          const SolveOptions& options, Positions& x, Progress& progress);

}  // namespace pointmorph

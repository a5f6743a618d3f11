// Linear systems of a graph's Laplacian and a 3 by 3 block a vertex. Not for callers of the
// library.
#pragma once

#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// A symmetric 3 by 3 matrix: of many, six numbers each are kept.
struct SymmetricBlock {
    Eigen::Matrix<double, 6, 1> values =
        Eigen::Matrix<double, 6, 1>::Zero();  ///< xx xy xz yy yz zz

    /// Adds `weight` times the identity.
    void add_isotropic(double weight) {
        values[0] += weight;
        values[3] += weight;
        values[5] += weight;
    }
    /// Adds `weight` n nᵀ.
    void add_along(const Vector3& n, double weight) {
        const Vector3 w = weight * n;
        values[0] += w[0] * n[0];
        values[1] += w[0] * n[1];
        values[2] += w[0] * n[2];
        values[3] += w[1] * n[1];
        values[4] += w[1] * n[2];
        values[5] += w[2] * n[2];
    }
    Vector3 operator*(const Vector3& v) const {
        return {values[0] * v[0] + values[1] * v[1] + values[2] * v[2],
                values[1] * v[0] + values[3] * v[1] + values[4] * v[2],
                values[2] * v[0] + values[4] * v[1] + values[5] * v[2]};
    }
    Matrix3 full() const {
        Matrix3 m;
        m << values[0], values[1], values[2], values[1], values[3], values[4], values[2], values[4],
            values[5];
        return m;
    }
};

/// (L x)_i = Σ_j w_ij (x_i − x_j), rows of neighbors one after the other.
struct Laplacian {
    std::vector<Index> offsets{0};  ///< #vertices + 1
    std::vector<Index> neighbors;
    std::vector<double> weights;  ///< > 0
    std::vector<double> sums;     ///< of a vertex's weights

    Index size() const { return to_index(sums.size()); }
};

struct SolveOptions {
    int most_iterations = 20;
    double tolerance = 1e-2;  ///< of the residual's norm, against the start's
};

/// x of L x + B x = b, with B ≥ 0 (a block a vertex), from the x given; conjugate
/// gradients, preconditioned by the blocks on the diagonal. Vertices with neither neighbors nor a
/// block keep their x. The same bits for any number of threads. Returns the iterations.
int solve(const Laplacian& laplacian, const std::vector<SymmetricBlock>& blocks, Positions right,
          const SolveOptions& options, Positions& x, Progress& progress);

}  // namespace pointmorph

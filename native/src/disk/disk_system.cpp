#include "disk/disk_system.hpp"

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <vector>

namespace pointmorph {

namespace {

using Symmetric = Eigen::SparseMatrix<double>;
/// Both coordinates of a row, side by side in one register.
using Uv = Eigen::Vector2d;
using Uvs = std::vector<Uv>;

/// The rows of the symmetric matrix times x.
void multiply(const Symmetric& matrix, const Uvs& x, Uvs& result) {
    const double* const values = matrix.valuePtr();
    const auto *const rows = matrix.innerIndexPtr(), *const begins = matrix.outerIndexPtr();
    for (std::size_t i = 0; i < x.size(); ++i) {
        Uv sum = Uv::Zero();
        for (auto e = begins[i]; e < begins[i + 1]; ++e) sum += values[e] * x[to_size(rows[e])];
        result[i] = sum;
    }
}

Uv product(const Uvs& a, const Uvs& b) {
    Uv sum = Uv::Zero();
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i].cwiseProduct(b[i]);
    return sum;
}

/// The inverse of L Lᵀ, scaled.
class Factor {
public:
    explicit Factor(const Symmetric& matrix) : factor_(matrix) {}

    void solve(const Uvs& sides, Uvs& x) const {
        const Symmetric& lower = factor_.matrixL();
        const auto& scale = factor_.scalingS();
        const double* const values = lower.valuePtr();
        const auto *const rows = lower.innerIndexPtr(), *const begins = lower.outerIndexPtr();
        const auto count = sides.size();
        for (std::size_t i = 0; i < count; ++i)
            x[i] = scale[static_cast<Eigen::Index>(i)] * sides[i];
        for (std::size_t j = 0; j < count; ++j) {
            const Uv here = x[j] /= values[begins[j]];
            for (auto e = begins[j] + 1; e < begins[j + 1]; ++e)
                x[to_size(rows[e])] -= values[e] * here;
        }
        for (std::size_t j = count; j-- > 0;) {
            Uv here = x[j];
            for (auto e = begins[j] + 1; e < begins[j + 1]; ++e)
                here -= values[e] * x[to_size(rows[e])];
            x[j] = here / values[begins[j]];
        }
        for (std::size_t i = 0; i < count; ++i) x[i] *= scale[static_cast<Eigen::Index>(i)];
    }

private:
    Eigen::IncompleteCholesky<double, Eigen::Lower, Eigen::NaturalOrdering<int>> factor_;
};

constexpr std::size_t kPart = 16;  // rows

/// Zᵀ A Z, where column k of Z is 1 at the k-th so many rows and 0 elsewhere.
class Coarse {
public:
    explicit Coarse(const Symmetric& matrix) {
        const auto count = to_size(matrix.cols()), parts = (count + kPart - 1) / kPart;
        std::vector<Eigen::Triplet<double>> entries;
        std::vector<double> sums(parts, 0.0);
        std::vector<std::size_t> touched;
        for (std::size_t part = 0; part < parts; ++part) {
            const auto first = static_cast<Eigen::Index>(part * kPart),
                       last = static_cast<Eigen::Index>(std::min(count, (part + 1) * kPart));
            for (Eigen::Index c = first; c < last; ++c)
                for (Symmetric::InnerIterator e(matrix, c); e; ++e) {
                    const std::size_t other = to_size(e.row()) / kPart;
                    if (other < part) continue;
                    if (sums[other] == 0.0) touched.push_back(other);
                    sums[other] += e.value();
                }
            for (const std::size_t other : touched) {
                if (sums[other] != 0.0) entries.emplace_back(other, part, sums[other]);
                sums[other] = 0.0;
            }
            touched.clear();
        }
        Symmetric coarse(static_cast<Eigen::Index>(parts), static_cast<Eigen::Index>(parts));
        coarse.setFromTriplets(entries.begin(), entries.end());
        cholesky_.compute(coarse);
    }

    /// Z (Zᵀ A Z)⁻¹ Zᵀ; `x` may be `sides`.
    void solve(const Uvs& sides, Uvs& x) const {
        DiskPoints sums = DiskPoints::Zero(cholesky_.rows(), 2);
        for (std::size_t i = 0; i < sides.size(); ++i)
            sums.row(static_cast<Eigen::Index>(i / kPart)) += sides[i].transpose();
        const DiskPoints solved = cholesky_.solve(sums);
        for (std::size_t i = 0; i < sides.size(); ++i)
            x[i] = solved.row(static_cast<Eigen::Index>(i / kPart)).transpose();
    }

private:
    Eigen::SimplicialLLT<Symmetric, Eigen::Lower> cholesky_;
};

/// Both at once: what the factor leaves of the residual goes through the coarse system.
class Preconditioner {
public:
    explicit Preconditioner(const Symmetric& matrix)
        : matrix_(matrix), factor_(matrix), coarse_(matrix), rest_(to_size(matrix.cols())) {}

    /// From where the search has to start: the error has no share in the coarse system any more.
    void start(const Uvs& right, Uvs& x) const { coarse_.solve(right, x); }

    void solve(const Uvs& sides, Uvs& x) {
        factor_.solve(sides, x);
        multiply(matrix_, x, rest_);
        for (std::size_t i = 0; i < x.size(); ++i) rest_[i] = sides[i] - rest_[i];
        coarse_.solve(rest_, rest_);
        for (std::size_t i = 0; i < x.size(); ++i) x[i] += rest_[i];
    }

private:
    const Symmetric& matrix_;
    Factor factor_;
    Coarse coarse_;
    Uvs rest_;
};

/// 0 where there is nothing left to divide: a coordinate that is solved to the bit.
Uv ratio(const Uv& a, const Uv& b) {
    return {b[0] != 0.0 ? a[0] / b[0] : 0.0, b[1] != 0.0 ? a[1] / b[1] : 0.0};
}

}  // namespace

DiskSolution solve_for_disk(const Symmetric& matrix, const DiskPoints& sides, double tolerance,
                            Index max_iterations, Progress& progress) {
    Preconditioner preconditioner(matrix);
    const auto count = to_size(matrix.cols());
    Uvs x(count), residual(count), better(count), way(count, Uv::Zero()), along(count);
    for (std::size_t i = 0; i < count; ++i)
        residual[i] = sides.row(static_cast<Eigen::Index>(i)).transpose();
    const Uv size = product(residual, residual);
    preconditioner.start(residual, x);
    multiply(matrix, x, along);
    for (std::size_t i = 0; i < count; ++i) residual[i] -= along[i];

    DiskSolution solution;
    Uv left = product(residual, residual), before = Uv::Ones();
    const auto is_solved = [&](int axis) {
        return left[axis] <= tolerance * tolerance * size[axis];
    };
    while (solution.iterations < max_iterations && !(is_solved(0) && is_solved(1))) {
        // The residual falls roughly geometrically, in thirty iterations or so.
        progress.report(1.0 - 1.0 / (1.0 + solution.iterations / 30.0));
        preconditioner.solve(residual, better);
        const Uv now = product(residual, better);
        const Uv kept = solution.iterations++ > 0 ? ratio(now, before) : Uv::Zero();
        before = now;
        for (std::size_t i = 0; i < count; ++i) way[i] = better[i] + kept.cwiseProduct(way[i]);
        multiply(matrix, way, along);
        const Uv step = ratio(now, product(way, along));
        for (std::size_t i = 0; i < count; ++i) {
            x[i] += step.cwiseProduct(way[i]);
            residual[i] -= step.cwiseProduct(along[i]);
        }
        left = product(residual, residual);
    }
    solution.points.resize(static_cast<Eigen::Index>(count), 2);
    for (std::size_t i = 0; i < count; ++i)
        solution.points.row(static_cast<Eigen::Index>(i)) = x[i].transpose();
    for (const int axis : {0, 1})
        if (size[axis] > 0.0)
            solution.relative_residual =
                std::max(solution.relative_residual, std::sqrt(left[axis] / size[axis]));
    return solution;
}

}  // namespace pointmorph

#include "mesh/block_system.hpp"

#include <Eigen/LU>
#include <cmath>

#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr Index kChunk = 512;

/// Calls `body(i)` for all rows and returns the sum of what it gives, added up in the same order
/// for any number of threads.
template <class Body>
double sum_over(Index count, Progress& progress, Body&& body) {
    std::vector<double> sums(to_size((count + kChunk - 1) / kChunk), 0.0);
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            double sum = 0.0;
            for (Index i = begin; i < end; ++i) sum += body(i);
            sums[to_size(begin / kChunk)] = sum;
        },
        0.0, 0.0, kChunk);
    double sum = 0.0;
    for (const double part : sums) sum += part;
    return sum;
}

/// Of a block on the diagonal, in single precision: which way to go may be told less exactly than
/// how far.
struct Inverse {
    Eigen::Matrix<float, 6, 1> values = Eigen::Matrix<float, 6, 1>::Zero();

    Inverse() = default;
    explicit Inverse(const Matrix3& m) {
        Eigen::Matrix<double, 6, 1> upper;
        upper << m(0, 0), m(0, 1), m(0, 2), m(1, 1), m(1, 2), m(2, 2);
        values = upper.cast<float>();
    }
    Vector3 operator*(const Vector3& v) const { return SymmetricBlock{values.cast<double>()} * v; }
};

Vector3 row(const Positions& rows, Index i) {
    return {rows(i, 0), rows(i, 1), rows(i, 2)};
}

Vector3 product(const Laplacian& laplacian, const std::vector<SymmetricBlock>& blocks,
                const Positions& x, Index i) {
    const Vector3 own = row(x, i);
    Vector3 result = blocks[to_size(i)] * own + laplacian.sums[to_size(i)] * own;
    for (Index k = laplacian.offsets[to_size(i)]; k < laplacian.offsets[to_size(i) + 1]; ++k)
        result -= laplacian.weights[to_size(k)] * row(x, laplacian.neighbors[to_size(k)]);
    return result;
}

}  // namespace

int solve(const Laplacian& laplacian, const std::vector<SymmetricBlock>& blocks, Positions right,
          const SolveOptions& options, Positions& x, Progress& progress) {
    const Index count = laplacian.size();
    std::vector<Inverse> inverses(to_size(count));
    Positions& residual = right;
    Positions step(count, 3), image(count, 3);
    double squared = sum_over(count, progress, [&](Index i) {
        SymmetricBlock diagonal = blocks[to_size(i)];
        diagonal.add_isotropic(laplacian.sums[to_size(i)]);
        const bool is_free = diagonal.full().trace() > 0.0;
        if (is_free) inverses[to_size(i)] = Inverse(diagonal.full().inverse());
        const Vector3 r = is_free ? Vector3(row(right, i) - product(laplacian, blocks, x, i))
                                  : Vector3(Vector3::Zero());
        residual.row(i) = r.transpose();
        step.row(i) = (inverses[to_size(i)] * r).transpose();
        return r.dot(row(step, i));
    });
    const double enough = options.tolerance * options.tolerance * squared;
    int iterations = 0;
    while (iterations < options.most_iterations && squared > enough && squared > 0.0) {
        const double curvature = sum_over(count, progress, [&](Index i) {
            const Vector3 a = product(laplacian, blocks, step, i);
            image.row(i) = a.transpose();
            return a.dot(row(step, i));
        });
        if (!(curvature > 0.0)) break;
        const double length = squared / curvature;
        const double next = sum_over(count, progress, [&](Index i) {
            x.row(i) += length * step.row(i);
            residual.row(i) -= length * image.row(i);
            const Vector3 r = row(residual, i);
            return r.dot(inverses[to_size(i)] * r);
        });
        const double share = next / squared;
        squared = next;
        ++iterations;
        parallel_for(
            count, progress,
            [&](Index begin, Index end) {
                for (Index i = begin; i < end; ++i)
                    step.row(i) =
                        (inverses[to_size(i)] * row(residual, i)).transpose() + share * step.row(i);
            },
            0.0, 0.0, kChunk);
    }
    return iterations;
}

}  // namespace pointmorph
